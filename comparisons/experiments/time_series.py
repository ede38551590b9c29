"""The paper's figure of predictions along a stretch that stops and goes, with marks where joints start and stop.

Run it by ``python -m comparisons.experiments.time_series --out DIR``; on the DIR of `table_two`, with the same preset,
it takes the logs and models that are there, otherwise it makes them. It writes ``time_series.png``, ``.svg`` and
``time_series.json``, with the error of each method in the stretch, into DIR.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import cyclopts
import numpy as np

from comparisons.cli import run_alone
from comparisons.comparison.held_out import HeldOut
from comparisons.comparison.methods import Preset
from comparisons.experiments.data import paper_data
from comparisons.experiments.table_two import DATA, HIERARCHIES, MODELS, NETWORKS, ROBOT, Rows
from comparisons.metrics import Regimes
from comparisons.output import to_json
from comparisons.progress import show_progress
from comparisons.report import style
from comparisons.report.compliance_figures import save
from comparisons.report.provenance import provenance
from comparisons.virtual_robot import VirtualRobot
from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import JointLog
from ident.robot import load_robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPERS = ("RDL", "LSTM", "model-based, from sinusoids", "RDL-MD")
"""Rows of Table II that the paper's figure shows."""

NAME = "time_series"

COLOURS = dict(
    zip(
        (*PAPERS, "HRDL-MD", "hybrid", "model-based, Maxwell slip"),
        (style.MEASURED, style.RESIDUAL, style.FURTHER[2], style.PREDICTED, *style.FURTHER[:2], style.FURTHER[3]),
        strict=True,
    )
)
"""Colours of rows, the paper's for those of its figure; others take what is left."""


def time_series(
    *,
    out: Path,
    methods: Annotated[list[str] | None, cyclopts.Parameter(consume_multiple=True, negative="")] = None,
    seconds: float = 40.0,
    begin: float | None = None,
    preset: Preset = "quick",
    epochs: int | None = None,
    data: str | None = None,
    seed: int = 0,
    device: str | None = None,
) -> None:
    """Draw the current of all joints along a stretch of the test set, measured and as methods predict it.

    Args:
        out: directory of table_two, or another.
        methods: rows of table_two, at most six; by default those of the paper's figure.
        seconds: length of the stretch.
        begin: time in the last test log at which it begins [s]; by default where most joints start and stop.
        preset: quick, or paper.
        epochs: passes over the training logs at most, instead of the preset's.
        data: another preset of the data sets than table_two has for that of the networks.
        seed: of the data; networks are those of the first training.
        device: that networks learn on: cpu or cuda.
    """
    rows = list(PAPERS if methods is None else methods)
    check_rows(rows)
    out.mkdir(parents=True, exist_ok=True)
    virtual = VirtualRobot(load_robot(ROBOT))
    with show_progress() as progress:
        logs = paper_data(virtual, data or DATA[preset], out / "data", seed, progress)
        tests = HeldOut.of(logs.test[-1:])
        where = stretch(tests, seconds, begin)
        table = Rows(logs, out / "models", preset, epochs, 1, device, progress)
        predicted = {row: next(c for c in table.runs(row) if c.method in (row, HIERARCHIES[-1])).model for row in rows}
        currents = {row: model.predict(tests.whole, causal=True)[where] for row, model in predicted.items()}
    log = tests.whole[where]
    save(time_series_figure(virtual.robot.joints, virtual.robot.unit, log, currents, tests.regimes, where), out / NAME)
    words = ["python", "-m", "comparisons.experiments.time_series", *sys.argv[1:]]
    note = provenance([out / "data"], seed=seed, command=words, libraries=("torch",))
    result = {
        "unit": virtual.robot.unit,
        "log": tests.logs[0].name,
        "begin": float(log.t[0]),
        "seconds": float(log.t[-1] - log.t[0]),
        "rmse": {row: np.sqrt(np.nanmean((values - log.current) ** 2, axis=0)) for row, values in currents.items()},
        "starts": tests.regimes.starts[where].sum(axis=0),
        "stops": tests.regimes.stops[where].sum(axis=0),
        "provenance": note.to_dict(),
    }
    (out / f"{NAME}.json").write_text(to_json(result), encoding="utf-8")
    print(out / f"{NAME}.png")


def check_rows(rows: Sequence[str]) -> None:
    """Refuse rows that there are not, and more than there are colours.

    Raises:
        InputError: so.
    """
    known = [*MODELS, *NETWORKS]
    for row in rows:
        if row not in known:
            raise InputError(f"no row {row!r}", "--methods", f"give some of {'; '.join(known)}")
    if not 1 <= len(rows) <= len(COLOURS):
        raise InputError(f"{len(rows)} methods", "--methods", f"give 1 to {len(COLOURS)}")


def stretch(tests: HeldOut, seconds: float, begin: float | None) -> slice:
    """Rows of the stretch: from ``begin`` [s] on, or where most joints start and stop.

    Raises:
        InputError: the log has no such stretch.
    """
    log = tests.whole
    length = round(seconds * log.rate)
    if not 2 <= length <= len(log):
        what = f"a stretch of {seconds:g} s of {len(log) / log.rate:.0f} s"
        raise InputError(what, "--seconds", "give less")
    if begin is not None:
        first = int(np.searchsorted(log.t, begin))
        if begin < log.t[0] or first + length > len(log):
            what = f"{seconds:g} s from {begin:g} s on, where the log is from {log.t[0]:g} to {log.t[-1]:g} s"
            raise InputError(what, "--begin", "give another time")
        return slice(first, first + length)
    marks = (tests.regimes.starts | tests.regimes.stops).sum(axis=1)
    busy = np.convolve(marks, np.ones(length), mode="valid")
    first = int(np.argmax(busy))
    return slice(first, first + length)


def time_series_figure(
    joints: Sequence[str], unit: str, log: JointLog, currents: dict[str, FloatArray], regimes: Regimes, rows: slice
) -> Figure:
    """Draw the measured current and those predicted; triangles mark starts on the time axis, circles stops."""
    figure, axes = style.joint_grid(joints, "time [s]", f"current [{unit}]", height=2.0)
    t = log.t - log.t[0]
    with style.report_style():
        for joint, axis in enumerate(axes):
            axis.plot(*style.thin(t, log.current[:, joint], 2000), color=style.INK, linewidth=0.7, label="measured")
            for (name, values), colour in zip(currents.items(), _colours(currents), strict=True):
                axis.plot(*style.thin(t, values[:, joint], 2000), color=colour, linewidth=1.0, label=name)
            _mark(axis, t[regimes.starts[rows, joint]], "^", "start")
            _mark(axis, t[regimes.stops[rows, joint]], "o", "stop")
            axis.set_xlim(0.0, float(t[-1]))
        style.legend_above(figure, axes[0])
    return figure


def _colours(rows: Collection[str]) -> list[str]:
    left = [colour for row, colour in COLOURS.items() if row not in rows]
    return [COLOURS[row] if row in COLOURS else left.pop(0) for row in rows]


def _mark(axis: Axes, at: Any, marker: str, label: str) -> None:
    face = style.INK if marker == "^" else "white"
    (drawn,) = axis.plot(
        at, np.zeros(len(at)), marker, color=style.INK, markerfacecolor=face, markersize=4.5, label=label,
        clip_on=False, transform=axis.get_xaxis_transform(), zorder=5,
    )  # fmt: skip
    drawn.set_in_layout(False)


if __name__ == "__main__":
    run_alone(time_series)
