"""The figures of a comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from comparisons.comparison.run import Comparison
    from ident.robot import Robot

REGIMES = {"rmse": "all", "rmse_moving": "moving", "rmse_static": "static", "rmse_transition": "transition"}
COLOURS = {"model": style.MEASURED, "observer": style.RESIDUAL, "network": style.PREDICTED}
STRETCH = 20.0
"""Seconds of the stretch that is shown."""

TRACES = 4
"""Methods whose residuals are drawn over each other."""


def regimes(methods: dict[str, dict[str, Any]], unit: str) -> Figure:
    """Residuals of each method in each regime, a panel a regime."""
    names = list(methods)
    with style.report_style():
        figure = style.new_figure(9.0, 0.9 + 0.24 * len(names))
        axes = figure.subplots(1, len(REGIMES), sharey=True, sharex=True, squeeze=False)[0]
        for axis, (key, title) in zip(axes, REGIMES.items(), strict=True):
            values = [_mean(methods[name], key) for name in names]
            colours = [COLOURS[_kind(methods[name])] for name in names]
            axis.barh(range(len(names)), values, height=0.65, color=colours)
            for place, value in enumerate(values):
                axis.annotate(
                    f"{value:.2f}" if np.isfinite(value) else "none",
                    (np.nan_to_num(value), place),
                    xytext=(3, 0),
                    textcoords="offset points",
                    va="center",
                    fontsize=7.5,
                )
            axis.set_title(title)
            axis.set_xlabel(f"RMS [{unit}]")
            axis.grid(axis="y", visible=False)
            axis.margins(x=0.22)
        _names(axes[0], names)
        _kinds(figure, methods)
    return figure


def step_times(methods: dict[str, dict[str, Any]]) -> Figure:
    """Median and 99th percentile of the time a step takes."""
    names = list(methods)
    with style.report_style():
        figure = style.new_figure(9.0, 0.8 + 0.24 * len(names))
        axis = figure.subplots()
        for place, name in enumerate(names):
            colour = COLOURS[_kind(methods[name])]
            p50, p99 = methods[name]["step_us_p50"], methods[name]["step_us_p99"]
            axis.plot([p50, p99], [place, place], color=colour, linewidth=1.5)
            axis.plot([p50], [place], "o", color=colour, markersize=5)
        axis.set_xscale("log", subs=[2, 5])
        axis.xaxis.set_major_formatter(_plain)
        axis.xaxis.set_minor_formatter(_plain)
        axis.set_xlabel("time of a step [µs]")
        axis.grid(axis="x", which="minor")
        axis.grid(axis="y", visible=False)
        _names(axis, names)
        _kinds(figure, methods)
    return figure


def worst_stretch(robot: Robot, comparison: Comparison) -> tuple[Figure, str]:
    """Residuals of the best method's worst stretch, with those of a few others, and what the figure shows."""
    shown = _shown(comparison)
    rows, log_name = _worst_rows(comparison, comparison.runs[shown[0]][0])
    regimes, whole = comparison.tests.regimes, comparison.tests.whole
    t = whole.t[rows] - whole.t[rows.start]
    colours = dict(zip(shown, (style.PREDICTED, style.MEASURED, *style.FURTHER[:2], style.RESIDUAL), strict=False))
    figure, axes = style.joint_grid(robot.joints, "time [s]", f"residual [{robot.unit}]", height=1.9)
    with style.report_style():
        for joint, axis in enumerate(axes):
            for name in reversed(shown):
                residual = comparison.kept.smooth(comparison.runs[name][0], rows)
                axis.plot(*style.thin(t, residual[:, joint], 1200), color=colours[name], label=name, linewidth=1.0)
            axis.axhline(0.0, color=style.INK, linewidth=0.5)
            for marks, marker, label in ((regimes.starts, "^", "start"), (regimes.stops, "o", "stop")):
                at = t[marks[rows, joint]]
                (drawn,) = axis.plot(
                    at, np.zeros(len(at)), marker, color=style.INK, label=label, markersize=4.5, clip_on=False,
                    transform=axis.get_xaxis_transform(), markerfacecolor=style.INK if marker == "^" else "none",
                )  # fmt: skip
                drawn.set_in_layout(False)
        style.legend_above(figure, axes[0])
    start = float(whole.t[rows.start])
    told = (
        f"Residuals at {comparison.bandwidth:g} Hz on the {STRETCH:g} s of `{log_name}`, from {start:.1f} s on, in "
        f"which {shown[0]} errs most; on the time axis triangles mark where a joint starts and circles where it stops"
    )
    return figure, told


def _shown(comparison: Comparison) -> list[str]:
    """Best method, then the best of each other kind, at most `TRACES` in all."""
    methods = comparison.methods
    order = sorted(methods, key=lambda name: _mean(methods[name], "rmse"))
    kinds: dict[tuple[str, bool], str] = {}
    for name in order:
        kinds.setdefault((_kind(methods[name]), methods[name]["memory"]), name)
    return list(kinds.values())[:TRACES]


def _worst_rows(comparison: Comparison, run: str) -> tuple[slice, str]:
    """Rows of the stretch in which a run errs most, each joint over its own mean, and the name of their log."""
    worst, found, log_name = -np.inf, slice(0, len(comparison.tests.whole)), ""
    for log, place in zip(comparison.tests.logs, comparison.tests.rows, strict=True):
        square = comparison.kept.smooth(run, place) ** 2
        square = np.nan_to_num(square)
        share = (square / np.maximum(square.mean(axis=0), 1e-300)).sum(axis=1)
        # a stretch in which somebody touches the robot comes last
        share = np.where(comparison.tests.regimes.free[place], share, -share.max())
        for segment in log.segments():
            length = min(round(STRETCH * log.rate), segment.stop - segment.start)
            total = np.convolve(share[segment], np.ones(length), mode="valid")
            if total.max() > worst:
                worst, first = float(total.max()), place.start + segment.start + int(np.argmax(total))
                found, log_name = slice(first, first + length), log.name
    return found, log_name


def _mean(figures: dict[str, Any], key: str) -> float:
    """Mean over the joints of which a residual's figure is known; NaN where it is of none."""
    values = np.asarray(figures["smoothed"][key], dtype=float)
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else np.nan


def _kind(figures: dict[str, Any]) -> str:
    """Tell what a method is: an observer, a network, or a model compared with the current as it is."""
    if figures["kind"] == "observer":
        return "observer"
    return "network" if figures["learned"] else "model"


def _kinds(figure: Figure, methods: dict[str, dict[str, Any]]) -> None:
    """Say which colour is which kind."""
    from matplotlib.patches import Patch

    present = {_kind(one) for one in methods.values()}
    patches = [Patch(color=colour, label=kind) for kind, colour in COLOURS.items() if kind in present]
    figure.legend(handles=patches, loc="outside upper right", ncols=len(patches))


def _plain(value: float, _: float) -> str:
    """Write a number on an axis without powers of ten."""
    return f"{value:g}"


def _names(axis: Axes, names: list[str]) -> None:
    """Write the methods' names on a vertical axis, the first on top."""
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
