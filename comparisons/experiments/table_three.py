"""Table III of the paper on the virtual VS060: the deadzone that joint compliance needs, for each estimator.

Run it by ``python -m comparisons.experiments.table_three --out DIR`` on the DIR of `table_two`; it writes
``table_three.json`` and ``table_three.md`` there. The paper tried boundaries on the robot until it stopped at once when
let go and yet felt light. Here they are taken from the residuals of the test set, which nobody touches: the greatest of
all (nothing less keeps the arm still on these data) and the level that would be passed once an hour. Residuals are at
5 Hz for all.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.cli import run_alone
from comparisons.experiments.table_two_page import joint_table
from comparisons.output import to_json
from comparisons.report.provenance import provenance
from ident.errors import InputError
from observers.deadzone import VS060_CURRENT, VS060_TORQUE

PAPER = {"HRDL-MD, boundary in use on the real robot": VS060_CURRENT}


def table_three(*, out: Path) -> None:
    """Make the paper's Table III from the residuals that table_two left.

    Args:
        out: directory of table_two.
    """
    source = out / "table_two.json"
    if not source.is_file():
        raise InputError("no table_two.json", str(out), "run comparisons.experiments.table_two there first")
    measured = json.loads(source.read_text(encoding="utf-8"))
    words = ["python", "-m", "comparisons.experiments.table_three", *sys.argv[1:]]
    result = deadzones(measured) | {"provenance": provenance([source], command=words).to_dict()}
    (out / "table_three.json").write_text(to_json(result), encoding="utf-8")
    (out / "table_three.md").write_text(table_three_page(result), encoding="utf-8")
    print(out / "table_three.md")


def deadzones(measured: Mapping[str, Any]) -> dict[str, Any]:
    """Return the boundaries of each row of a result of `table_two`: ``peak`` and ``hourly``, in current and N m.

    Torques stand on the paper's rough estimate of the real robot's drive gains.
    """
    gain = np.array(VS060_TORQUE) / np.array(VS060_CURRENT)
    rows: dict[str, Any] = {}
    for row, figures in measured["rows"].items():
        peak = np.array(figures["smoothed"]["peak"], dtype=float)
        hourly = np.array(figures["detectable_current"], dtype=float)
        rows[row] = {"peak": peak, "hourly": hourly, "peak_torque": peak * gain, "hourly_torque": hourly * gain}
    return {"unit": measured["unit"], "frames": measured["frames"], "rows": rows}


def table_three_page(result: Mapping[str, Any]) -> str:
    """Return the page of a result."""
    rows, unit = result["rows"], result["unit"]
    titles = {
        "peak": f"Greatest residual [{unit}]",
        "hourly": f"Passed once an hour [{unit}]",
        "peak_torque": "Greatest residual [N m]",
        "hourly_torque": "Passed once an hour [N m]",
    }
    parts = [
        "# Table III on the virtual VS060\n",
        f"Deadzone boundaries from {result['frames']['test']:,} test frames without contact, residuals at 5 Hz, means "
        "over the trainings; least in bold. N m by the paper's estimate of the real robot's gains.\n",
    ]
    for key, title in titles.items():
        parts += [f"## {title}\n", joint_table({row: figures[key] for row, figures in rows.items()})]
    parts += [f"## The paper's [{unit}]\n", joint_table({row: [*values] for row, values in PAPER.items()})]
    parts.append(f"Made by `{result['provenance']['command_line']}`, {result['provenance']['date']}.\n")
    return "\n".join(parts)


if __name__ == "__main__":
    run_alone(table_three)
