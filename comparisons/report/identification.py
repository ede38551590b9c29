"""The report of ``sensorless identify``: what was identified, how well it predicts, and what the logs leave open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.report import style
from comparisons.report.provenance import Provenance
from comparisons.report.report import Report
from comparisons.report.rests import sticking, yielding

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.arrays import FloatArray
    from ident.identification import Identification
    from ident.log import JointLog, LogSource
    from ident.signals import Motion

SHOWN_ROWS = 20_000
"""Rows of the first test log that are plotted."""

SUMMARISED, SUMMARY_ROWS = 6, 200_000
"""Logs that are summarised, and the rows of each."""


def identification_report(
    found: Identification,
    figures: Mapping[str, Mapping[str, Any]],
    train: Sequence[LogSource],
    test: Sequence[LogSource],
    note: Provenance,
) -> Report:
    """Report an identification.

    Args:
        found: what was identified.
        figures: errors on ``train`` and, where there is one, ``test``, as result.json holds them.
        train, test: the logs; the beginning of the first test log, or else of the first training log, is plotted.
        note: the run behind it.
    """
    part = "test" if "test" in figures else "train"
    overall = figures[part]["relative_error_percent_overall"]
    robot = found.model.robot
    held = ", with what friction holds in joints that stick" if found.rests.joints else ""
    summary = f"The model leaves {overall:.1f} % of the measured current unexplained on the {part} logs{held}."
    report = Report(f"Identification of {robot.name}", summary)
    if found.warnings:
        report.section("Warnings")
    for warning in found.warnings:
        report.text(warning)
    _errors(report, found, figures)
    shown = [*test, *train][0]
    log, predicted = next(found.model.predict_blocks(shown))
    log, predicted = log[:SHOWN_ROWS], predicted[:SHOWN_ROWS]
    report.section("Measured and predicted")
    report.figure(_traces(found, log, predicted), f"Beginning of `{shown.name}` ({part})")
    _residuals(report, found, log, predicted)
    _parameters(report, found)
    _structure(report, found)
    _method(report, found)
    _logs(report, found, [*train, *test])
    return report.provenance(note)


def _errors(report: Report, found: Identification, figures: Mapping[str, Mapping[str, Any]]) -> None:
    unit, robot = found.model.unit, found.model.robot
    report.section("Errors")
    report.text(
        "Against the current as logged, unfiltered. Below the cut-off "
        f"({found.cutoff.hertz:.3g} Hz): error and current both low-passed without lag, so that sensor noise does not "
        "count."
    )
    keys = ["rmse", "relative_error_percent", "relative_error_percent_filtered"]
    columns = ["joint", "name", f"RMSE [{unit}]", "relative error [%]", "below the cut-off [%]"]
    if found.rests.joints:
        report.text(sticking(found.rests.joints))
        keys, columns = [*keys, "rmse_moving"], [*columns, f"RMSE in motion [{unit}]"]
    if found.model.presliding.any():
        report.text(yielding(found.model.presliding))
    for part, values in reversed(list(figures.items())):
        rows = [[j + 1, name, *(values[key][j] for key in keys)] for j, name in enumerate(robot.joints)]
        report.table(columns, rows, f"Errors on the {part} logs")
    usual = ("links", "rotor-inertia", "current-offset")
    chosen = [
        [
            j + 1,
            ", ".join(t.effect.name for t in found.model.terms if t.effect.joint == j and t.effect.name not in usual),
        ]
        for j in range(robot.n)
    ]
    report.table(["joint", "effects besides links, rotor and offset"], chosen)


def _traces(found: Identification, log: JointLog, predicted: FloatArray) -> Figure:
    figure, axes = style.joint_grid(found.model.robot.joints, "time [s]", f"current [{found.model.unit}]")
    t = log.t - log.t[0]
    for j, axis in enumerate(axes):
        axis.plot(*style.thin(t, log.current[:, j]), color=style.MEASURED, label="measured", linewidth=0.8)
        axis.plot(*style.thin(t, predicted[:, j]), color=style.PREDICTED, label="predicted", linewidth=0.8)
        axis.plot(*style.thin(t, log.current[:, j] - predicted[:, j]), color=style.RESIDUAL, label="residual", lw=0.6)
    style.legend_above(figure, axes[0])
    return figure


def _residuals(report: Report, found: Identification, log: JointLog, predicted: FloatArray) -> None:
    from ident.signals import derive

    motion: Motion = derive(log, found.cutoff.hertz)
    report.section("Where the residual comes from")
    report.text("Structure in these pictures is something the model lacks.")
    every = max(1, len(log) // 4000)
    slide = found.model.robot.multibody.prismatic
    angle = "m" if slide.all() else "rad" if not slide.any() else "rad or m"
    for what, unit, values in (("velocity", f"{angle}/s", motion.dq), ("position", angle, log.q)):
        figure, axes = style.joint_grid(found.model.robot.joints, f"{what} [{unit}]", f"residual [{found.model.unit}]")
        for j, axis in enumerate(axes):
            axis.plot(
                values[::every, j], (log.current - predicted)[::every, j], ".", color=style.RESIDUAL, markersize=1.5
            )
        report.figure(figure, f"Residual against the joint's {what}, on the same rows as above")


def _parameters(report: Report, found: Identification) -> None:
    listed = found.parameters
    report.section("Parameters")
    columns = ["parameter", "value", "from", "to", "unit", "combines"]
    rows = [[p.name, p.value, *p.interval, p.unit, p.meaning] for p in listed if p.determined and np.isfinite(p.std)]
    report.table(columns, rows, "95 % intervals, with the residual's autocorrelation taken into account")
    report.section("What these logs leave open")
    none = [p.name for p in listed if not p.determined]
    weak = [p for p in listed if p.determined and np.isfinite(p.std) and p.interval[0] <= 0.0 <= p.interval[1]]
    bound = [p.name for p in listed if p.determined and not np.isfinite(p.std)]
    if none:
        report.text(
            "Not identifiable, because no row depends on them, or only in a combination that another parameter already "
            f"stands for: {', '.join(none)}."
        )
    if bound:
        report.text(f"At a bound, or without effect on these logs, so without an interval: {', '.join(bound)}.")
    if weak:
        rows = [[p.name, p.value, p.std, p.unit] for p in weak]
        report.table(["parameter", "value", "std", "unit"], rows, "Not told from nought: the interval contains it")
    if not (none or weak or bound):
        report.text("Nothing: every interval excludes nought.")
    report.text(
        f"Condition number of the scaled regression: {found.fit.solution.condition_number:.3g}. Above about 100 the "
        "motion does not separate the parameters well; `sensorless excite` designs one that does."
    )


def _structure(report: Report, found: Identification) -> None:
    if found.structure is None:
        return
    report.section("Choice of friction terms")
    report.text(
        f"Held out: {found.structure.folds}. A term stays if it lowers the held-out residual by more than 1 % on "
        "average and on every fold. Listed is the best candidate of each joint in each round."
    )
    rows = [
        [c.joint + 1, c.effect, 100 * c.gain, 100 * c.worst_fold, "yes" if c.taken else "no"]
        for c in found.structure.choices
    ]
    columns = ["joint", "best candidate", "residual falls by [%]", "on the worst fold [%]", "taken"]
    report.table(columns, rows, "In the order in which they were tried")


def _method(report: Report, found: Identification) -> None:
    model = found.model
    report.section("How")
    reason = "as given" if found.cutoff.reason == "given" else found.cutoff.reason
    report.text(f"Velocity and acceleration: zero-phase low pass at {found.cutoff.hertz:.3g} Hz ({reason}).")
    gains = {
        "known": "Drive gains are the card's; forces are in N m (N).",
        "shared": "Relative drive gains were estimated together with links that all joints share.",
        "payload": "Drive gains come from logs without and with a known payload; forces are in N m (N).",
        "per-joint": "Drive gains are unknown: every joint has link parameters of its own, in units of its current.",
    }
    report.text(gains[found.gains])
    estimate = found.gain_estimate
    if estimate is not None:
        rows = [
            [j + 1, estimate.value[j], estimate.low[j], estimate.high[j], estimate.reason[j]] for j in range(model.n)
        ]
        unit = f"{model.force_unit} per {model.unit}"
        report.table(["joint", f"gain [{unit}]", "from", "to", "open because"], rows, "Drive gains, 95 % intervals")
    if found.feasible is not None:
        rise = found.feasible.preferred.overall_rise
        report.text(
            f"`identified.urdf` holds the physically feasible parameters nearest to the fit (prior: "
            f"{found.feasible.prior}). Feasibility raises the residual by {rise:.2g} %."
        )


def _logs(report: Report, found: Identification, sources: Sequence[LogSource]) -> None:
    from ident.log_summary import summarise

    report.section("Logs")
    for source in sources[:SUMMARISED]:
        log = next(source.blocks(SUMMARY_ROWS))
        cut = f" (first {len(log)} rows)" if len(log) == SUMMARY_ROWS else ""
        summary = summarise(log, found.model.robot.limits)
        report.table(*summary.table(), summary.headline() + cut)
    if len(sources) > SUMMARISED:
        report.text(f"{len(sources) - SUMMARISED} more logs are not shown.")
