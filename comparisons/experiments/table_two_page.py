"""Table II as Markdown, beside the paper's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

PAPER: dict[str, tuple[float, ...]] = {
    "model-based, from sinusoids": (3.92, 5.30, 3.90, 9.60, 6.49, 8.08),
    "MLP": (5.33, 5.29, 4.86, 9.58, 4.90, 7.16),
    "RDL": (3.87, 4.31, 3.78, 9.37, 4.72, 7.13),
    "LSTM": (5.72, 4.88, 4.57, 6.78, 3.64, 5.76),
    "RDL-MD": (2.49, 3.90, 3.49, 5.77, 3.56, 3.55),
    "HRDL-MD, H1": (3.38, 4.54, 3.77, 5.97, 4.06, 4.20),
    "HRDL-MD, H1-2": (2.70, 4.10, 3.20, 5.87, 3.73, 3.60),
    "HRDL-MD, H1-3": (2.64, 4.02, 3.18, 5.84, 3.73, 3.53),
}
"""RMSE [%Use] of the paper's Table II (a) and (c) on the real VS060, by the row's name here."""

REGIMES = {
    "rmse": "all frames",
    "rmse_moving": "moving frames",
    "rmse_static": "static frames",
    "rmse_transition": "0.5 s after starts and stops",
}

CLAIMS: tuple[tuple[str, str, str, str], ...] = (
    ("the discriminator helps at rest", "rmse_static", "RDL-MD", "RDL"),
    ("it helps over all frames", "rmse", "RDL-MD", "RDL"),
    ("it beats the memory of an LSTM", "rmse", "RDL-MD", "LSTM"),
    ("blocks with skips beat those without", "rmse", "RDL", "MLP"),
    ("a second hierarchy helps", "rmse", "HRDL-MD, H1-2", "HRDL-MD, H1"),
    ("a third hierarchy helps", "rmse", "HRDL-MD, H1-3", "HRDL-MD, H1-2"),
    ("the network beats the paper's model", "rmse", "HRDL-MD, H1-3", "model-based, from sinusoids"),
    ("hysteresis helps the model at rest", "rmse_static", "model-based, Maxwell slip", "model-based"),
    ("effects that are named help", "rmse", "model-based, named effects", "model-based"),
    ("the hybrid beats the model below it", "rmse", "hybrid", "model-based, Maxwell slip"),
    ("the hybrid beats the network alone", "rmse", "hybrid", "HRDL-MD, H1-3"),
)
"""What the paper, or this project, says: which figure of which row is less than that of which other."""


def table_two_page(result: Mapping[str, Any]) -> str:
    """Return the page of a result of `table_two`."""
    rows, unit, frames = result["rows"], result["unit"], result["frames"]
    epochs = f", {result['epochs']} epochs at most" if result["epochs"] else ""
    parts = [
        "# Table II on the virtual VS060\n",
        f"Preset {result['preset']}, data {result['data']}{epochs}; {frames['train']:,} training and "
        f"{frames['test']:,} test frames; "
        f"{result['seeds']} training(s) of each network, of which means are given, and after ± the standard deviation "
        f"of the mean over the joints. RMSE [{unit}] against the current as logged, unfiltered, with the filters that "
        "run online; least in bold. The models are identified from the same frames as the networks, but for the one "
        "from sinusoids, which is the paper's way.\n",
    ]
    for key, title in REGIMES.items():
        parts += [f"## {title.capitalize()}\n", _errors(rows, key)]
    if result.get("named"):
        told = "; ".join(f"`{name}` on {_joints(joints)}" for name, joints in result["named"].items())
        parts.append(f"Named effects: {told}.\n")
    parts += ["## The paper's, on the real robot, all frames\n", joint_table({k: [*v] for k, v in PAPER.items()})]
    parts += ["## What holds\n", _claims(rows), "## Cost\n", _cost(rows)]
    command = result["provenance"]["command_line"]
    versions = ", ".join(f"{name} {version}" for name, version in result["provenance"]["versions"].items())
    parts.append(f"Made by `{command}`, {result['provenance']['date']}, {versions}.\n")
    return "\n".join(parts)


def _joints(joints: Sequence[int]) -> str:
    return "the whole robot" if not joints else "joints " + ", ".join(map(str, sorted(joints)))


def _errors(rows: Mapping[str, Any], key: str) -> str:
    spread = {row: _spread(figures, key) for row, figures in rows.items()}
    return joint_table({row: figures[key] for row, figures in rows.items()}, spread)


def joint_table(values: Mapping[str, Sequence[float]], spread: Mapping[str, float | None] | None = None) -> str:
    """Return a Markdown table of a figure for each joint and their mean, the least in bold, by the rows' names."""
    table = np.array([[*of, np.mean(of)] for of in values.values()], dtype=float)
    least = table.min(axis=0)
    n = table.shape[1] - 1
    lines = [f"| method | {' | '.join(f'J{j + 1}' for j in range(n))} | mean |", "|---|" + "---:|" * (n + 1)]
    for row, own in zip(values, table, strict=True):
        cells = [f"**{v:.2f}**" if v == low else f"{v:.2f}" for v, low in zip(own, least, strict=True)]
        apart = None if spread is None else spread[row]
        lines.append(f"| {row} | {' | '.join(cells)}{'' if apart is None else f' ± {apart:.2f}'} |")
    return "\n".join(lines) + "\n"


def _claims(rows: Mapping[str, Any]) -> str:
    """Each claim with both means over the joints, and in how many of the trainings it holds."""
    lines = ["| claim | frames | less | than | holds in |", "|---|---|---|---|---|"]
    for claim, key, first, second in CLAIMS:
        if first in rows and second in rows:
            ours, theirs = (_means(rows[row], key) for row in (first, second))
            pairs = np.broadcast_arrays(ours, theirs) if 1 in (len(ours), len(theirs)) else (ours, theirs)
            held = int(np.sum(pairs[0] < pairs[1]))
            numbers = f"{first} {np.mean(ours):.2f} | {second} {np.mean(theirs):.2f}"
            lines.append(f"| {claim} | {REGIMES[key]} | {numbers} | {held} of {len(pairs[0])} |")
    return "\n".join(lines) + "\n"


def _cost(rows: Mapping[str, Any]) -> str:
    lines = ["| method | step, median [µs] | 99 % [µs] | parameters | fitting [s] |", "|---|---:|---:|---:|---:|"]
    for row, one in rows.items():
        seconds = one.get("training_seconds")
        told = "" if seconds is None else f"{seconds:.0f}"
        cells = f"{one['step_us_p50']:.0f} | {one['step_us_p99']:.0f} | {one['parameters']:.0f} | {told}"
        lines.append(f"| {row} | {cells} |")
    return "\n".join(lines) + "\n"


def _means(figures: Mapping[str, Any], key: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Mean over the joints of each training, or of the only one."""
    runs = figures.get("runs", {"": figures})
    return np.array([np.mean(run[key]) for run in runs.values()])


def _spread(figures: Mapping[str, Any], key: str) -> float | None:
    means = _means(figures, key)
    return float(np.std(means, ddof=1)) if len(means) > 1 else None
