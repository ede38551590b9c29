"""``sensorless demo``: the main job on the virtual VS060, in minutes and without any hardware."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from comparisons.output import OutputDirectory

if TYPE_CHECKING:
    from comparisons.experiments.demonstration import Demonstration


def demo(*, out: Path = Path("sensorless-demo"), seed: int = 1) -> None:
    """Excite, identify, find a hidden effect, train, compare and comply on the virtual VS060, without any hardware.

    Args:
        out: directory for report.html with all steps, result.json, the logs, and a folder a step.
        seed: of motion and noise.
    """
    from comparisons.experiments.demonstration import demonstrate, swept
    from comparisons.report.demo import demo_report, demo_rows
    from comparisons.report.provenance import provenance

    with OutputDirectory(out, "demo") as output:
        with swept(output.path):
            done = demonstrate(output.path, seed)
            note = provenance(seed=seed, libraries=("torch", "casadi", "coal"))
            rows = demo_rows(done)
            demo_report(done, rows, note).write(output.path / "report.html")
        output.result({**_result(done), "provenance": note.to_dict()})
    width = [max(len(row[k]) for row in rows) for k in range(2)]
    for step, seconds, told in rows:
        print(f"{step:<{width[0]}}  {seconds:>{width[1]}}  {told}")
    print(out / "report.html")


def _result(done: Demonstration) -> dict[str, Any]:
    """Figures of all steps, as result.json holds them."""
    from comparisons.commands.gap import gap_result
    from comparisons.experiments.demonstration import TOOL

    robot = done.virtual.robot
    assert done.gap.evidence is not None
    return {
        "joints": list(robot.joints),
        "unit": robot.unit,
        "seconds": done.seconds,
        "excite": {"condition_number": done.excitation.condition_number, "log_det": done.excitation.log_det},
        "identify": done.identified.result(),
        "gap": {
            "hidden": {"effect": "payload", **TOOL},
            "rmse": {"before": done.gap.evidence.before, "after": done.gap.evidence.after},
            **gap_result(done.gap),
        },
        "methods": done.comparison.methods,
        "comply": {"deadzone": done.boundary, **done.push},
    }
