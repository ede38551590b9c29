"""The report of ``sensorless observe``: residuals, thresholds and contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from comparisons.report import style
from comparisons.report.report import Report
from observers.cusum import alarms
from observers.methods import METHODS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.arrays import FloatArray
    from ident.log import JointLog
    from ident.robot import Robot
    from observers.residual import Residual
    from observers.thresholds import Threshold

SHOWN = 120.0
"""Seconds of each log that are plotted."""


def observation_report(
    robot: Robot,
    method: str,
    threshold: Threshold | None,
    logs: Sequence[JointLog],
    residuals: Sequence[Residual],
    figures: Sequence[Mapping[str, Any]],
    sums: Sequence[FloatArray] | None = None,
) -> Report:
    """Report an observation.

    Args:
        robot: the robot.
        method: name of the method.
        threshold: of contact, where there are logs without.
        logs, residuals, figures: of each log; figures as result.json holds them.
        sums: each joint's cumulative sum over its limit along each log, (N, n), where they were asked for.
    """
    found = sum(len(f.get("contacts", [])) for f in figures)
    told = f"{found} contacts."
    summary = told if threshold is not None else "No logs without contact were given, so no contacts are told."
    report = Report(f"Residuals of {robot.name}: {METHODS[method]}", summary)
    report.section("Residuals").text(
        "What the outside world adds to each joint, as the motor current that would cause it; positive pushes along +q."
    )
    for number, (log, residual, of_log) in enumerate(zip(logs, residuals, figures, strict=True)):
        unit = residual.unit
        columns = ["joint", "name", f"RMS [{unit}]", f"mean [{unit}]", f"peak [{unit}]"]
        rows = [
            [j + 1, name, of_log["rms"][j], of_log["mean"][j], of_log["peak"][j]] for j, name in enumerate(robot.joints)
        ]
        if threshold is not None:
            columns.append(f"threshold at rest [{unit}]")
            rows = [[*row, threshold.constant[j]] for j, row in enumerate(rows)]
        report.table(columns, rows, f"Residual of `{log.name}`")
        flagged = ", ".join(f"{count} {name}" for name, count in of_log["flagged"].items() if count)
        report.text(f"Flagged rows of `{log.name}`: {flagged or 'none'}.")
        report.figure(
            _traces(robot, residual, threshold, None if sums is None else sums[number]), f"Beginning of `{log.name}`"
        )
    if threshold is not None:
        _contacts(report, logs, figures)
    if sums is not None:
        _cusum_alarms(report, logs, figures)
    return report


def _contacts(report: Report, logs: Sequence[JointLog], figures: Sequence[Mapping[str, Any]]) -> None:
    report.section("Contacts")
    rows = [
        [log.name, c["start"], c["end"] - c["start"], c["level"], _range(c["links"])]
        for log, of_log in zip(logs, figures, strict=True)
        for c in of_log.get("contacts", [])
    ]
    if rows:
        caption = (
            "Links that can have been pushed: that of the last joint that felt it, and those behind it, on which a "
            "force without a lever about their own joints does the same"
        )
        report.table(["log", "start [s]", "length [s]", "level", "links"], rows, caption)
    else:
        report.text("No residual rose above its threshold.")


def _range(links: Sequence[int]) -> str:
    return str(links[0]) if len(links) == 1 else f"{links[0]} to {links[-1]}"


def _cusum_alarms(report: Report, logs: Sequence[JointLog], figures: Sequence[Mapping[str, Any]]) -> None:
    report.section("Alarms of the cumulative sums").text(
        "Pushes too weak for a threshold that last; an alarm comes some time after its push, and ends some time after."
    )
    rows = [
        [log.name, alarm["start"], alarm["end"] - alarm["start"], ", ".join(map(str, alarm["joints"]))]
        for log, of_log in zip(logs, figures, strict=True)
        for alarm in of_log["cusum_alarms"]
    ]
    if rows:
        report.table(["log", "start [s]", "length [s]", "joints"], rows, "Joints whose sum passed its limit")
    else:
        report.text("No sum passed its limit.")


def _traces(robot: Robot, residual: Residual, threshold: Threshold | None, sums: FloatArray | None) -> Figure:
    figure, axes = style.joint_grid(robot.joints, "time [s]", f"residual [{residual.unit}]")
    rows = residual.t < residual.t[0] + SHOWN
    over = [[] if sums is None else alarms(residual.t[rows], sums[rows, j : j + 1]) for j in range(robot.n)]
    with style.report_style():
        for joint, axis in enumerate(axes):
            axis.plot(
                *style.thin(residual.t[rows], residual.current[rows, joint]), color=style.RESIDUAL, label="residual"
            )
            if threshold is not None:
                for sign in (1.0, -1.0):
                    label = "threshold at rest" if sign > 0.0 else None
                    axis.axhline(sign * threshold.constant[joint], color=style.PREDICTED, linewidth=0.8, label=label)
            for number, alarm in enumerate(over[joint]):
                label = "alarm of the cumulative sum" if number == 0 else None
                axis.axvspan(alarm.start, alarm.end, color=style.FURTHER[0], alpha=0.25, linewidth=0.0, label=label)
        style.legend_above(figure, axes[max(range(robot.n), key=lambda j: bool(over[j]))])
    return figure
