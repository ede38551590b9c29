"""The report of ``sensorless compare``: who errs how much, when, and at what price."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.report import comparison_figures as figures
from comparisons.report.report import Report, strong

if TYPE_CHECKING:
    from comparisons.comparison.run import Comparison
    from ident.arrays import FloatArray
    from ident.robot import Robot

Figures = dict[str, Any]


def comparison_report(robot: Robot, comparison: Comparison) -> Report:
    """Report a comparison."""
    unit, methods = robot.unit, comparison.methods
    report = Report(f"Estimators of {robot.name} side by side", _summary(comparison, unit))
    _prediction(report, robot, comparison)
    _residual(report, robot, comparison)
    report.section("When they err")
    report.text(
        "A joint moves above 5 mrad/s and is static below; transition is the first 0.5 s after a start or a stop, "
        "counted among moving or static as well. Rows in which somebody touches the robot, and the second after, count "
        "nowhere. Residuals at the common bandwidth, root mean square, mean over joints."
    )
    report.figure(figures.regimes(methods, unit), "Residuals in each regime, to one scale")
    _rest(report, comparison, unit)
    _needs(report, robot, comparison)
    if any("contact" in one for one in methods.values()):
        _contacts(report, methods)
    report.section("Where it is worst")
    figure, told = figures.worst_stretch(robot, comparison)
    report.figure(figure, told)
    _cost(report, methods)
    return report


def _summary(comparison: Comparison, unit: str) -> str:
    tests, methods = comparison.tests, comparison.methods
    best = min(methods, key=lambda name: _average(methods[name]["smoothed"]["rmse"]))
    least = _average(methods[best]["smoothed"]["rmse"])
    return (
        f"On {len(tests.whole)} rows of {len(tests.logs)} test log{'s' * (len(tests.logs) > 1)}, {best} leaves the "
        f"least residual at {comparison.bandwidth:g} Hz: {least:.3g} {unit} on average over the joints."
    )


def _prediction(report: Report, robot: Robot, comparison: Comparison) -> None:
    direct = {name: one for name, one in comparison.methods.items() if one["kind"] == "direct"}
    if not direct:
        return
    report.section("Error of the prediction")
    report.text(
        "Against the current as logged, unfiltered, with the filters that run online: a physical model pays for the "
        "lag of its filter here, a network has learned with it. Observers predict no current; the next table has them."
    )
    _joint_table(report, robot, direct, lambda one: one["rmse"], f"RMSE [{robot.unit}], least in bold")
    offline = {name: one for name, one in direct.items() if "rmse_without_lag" in one}
    if offline:
        what = f"RMSE [{robot.unit}] with filters that do not lag, as `identify` reports it and no robot can run online"
        _joint_table(report, robot, offline, lambda one: one["rmse_without_lag"], what)
    spread = {name: one for name, one in direct.items() if "rmse_spread" in one}
    if spread:
        what = f"Standard deviation of that RMSE over the seeds [{robot.unit}]"
        _joint_table(report, robot, spread, lambda one: one["rmse_spread"], what, best=False)


def _residual(report: Report, robot: Robot, comparison: Comparison) -> None:
    report.section("Residual at one bandwidth")
    hertz = comparison.bandwidth
    report.text(
        "What each would take for the outside world while nobody touches the robot. All are alike here: observers have "
        f"a bandwidth of {hertz:g} Hz, and the residuals of predictions pass a first-order low pass of {hertz:g} Hz, "
        "after the current has been delayed as the motion is where the model filters it."
    )
    methods, gain = comparison.methods, _gain(comparison.methods)
    _joint_table(report, robot, methods, lambda one: one["smoothed"]["rmse"], f"RMS [{robot.unit}], least in bold")
    if gain is not None:
        size = gain
        _joint_table(report, robot, methods, lambda one: one["smoothed"]["rmse"] * size, "RMS [N m], least in bold")


def _rest(report: Report, comparison: Comparison, unit: str) -> None:
    report.section("At rest")
    report.text(
        "Bias is the mean residual over static frames: stops after motion either way cancel in it, but not in the root "
        "mean square. Drift is how far the residual runs away in a minute of rest, whichever way; the noise of the "
        "current alone makes some of it. Before a joint has moved, a method with memory cannot know how it came to "
        "rest; those frames count everywhere, and the RMS after and before the first motion tells them apart. Mean "
        "over joints; bias without its sign."
    )
    columns = ["method", "memory", "static RMS", "bias", "drift a minute", "after first motion", "before it"]
    rows = []
    for name, one in comparison.methods.items():
        own = one["smoothed"]
        keys = ("rmse_static", "static_bias", "static_drift_per_minute", "rmse_known_history")
        values = [_average(own[key]) for key in keys]
        rows.append([name, one["memory"], *values, _average(own["rmse_unknown_history"])])
    report.table(columns, _with_best(rows, 2), f"Residuals at the common bandwidth [{unit}], least in bold")


def _needs(report: Report, robot: Robot, comparison: Comparison) -> None:
    report.section("What it can feel")
    report.text(
        "The peak is the greatest residual while nobody touches the robot: the deadzone it needs. The smallest joint "
        "torque that is detected exceeds a threshold that would be passed once an hour without contact, drawn from the "
        "tail of the peaks of all seconds."
    )
    methods, unit = comparison.methods, robot.unit
    _joint_table(report, robot, methods, lambda one: one["smoothed"]["peak"], f"Peak [{unit}], least in bold")
    _joint_table(report, robot, methods, lambda one: one["detectable_current"], f"Smallest detectable [{unit}]")
    if _gain(methods) is not None and all("detectable_torque" in one for one in methods.values()):
        _joint_table(report, robot, methods, lambda one: one["detectable_torque"], "Smallest detectable [N m]")


def _contacts(report: Report, methods: dict[str, Figures]) -> None:
    report.section("Contacts")
    one = next(iter(methods.values()))
    report.text(
        f"{one['contact']['contacts']} true contacts, told by thresholds from {one['threshold_from']} of these same "
        "tests for one false alarm an hour. AUROC judges each residual over all thresholds."
    )
    keys = ("missed", "delay_median", "delay_p95", "false_alarms_per_hour", "auroc")
    rows = [[name, *(figures["contact"][key] for key in keys)] for name, figures in methods.items()]
    columns = ["method", "missed", "delay, median [s]", "delay, 95 % [s]", "false alarms an hour", "AUROC"]
    report.table(columns, rows)


def _cost(report: Report, methods: dict[str, Figures]) -> None:
    report.section("What it costs")
    report.figure(
        figures.step_times(methods),
        "Time of a step, from sample to residual: the dot is the median, the line goes to the 99th percentile",
    )
    keys = ("step_us_p50", "step_us_p99", "parameters", "training_seconds")
    rows = [[name, *(one[key] for key in keys)] for name, one in methods.items()]
    columns = ["method", "step, median [µs]", "step, 99 % [µs]", "parameters", "fitting [s]"]
    caption = (
        "Steps of real samples, one after another, the quietest of three rounds in this process; fitting includes the "
        "choice of effects, and for observers it is that of the model below them"
    )
    report.table(columns, rows, caption)


def _gain(methods: dict[str, Figures]) -> FloatArray | None:
    """Size of the joint torque per unit of current (n,), where it is known and the current is not a torque itself."""
    known = [np.abs(one["gain"]) for one in methods.values() if "gain" in one]
    return known[0] if known and not np.all(known[0] == 1.0) else None


def _joint_table(
    report: Report,
    robot: Robot,
    methods: dict[str, Figures],
    of: Callable[[Figures], FloatArray],
    caption: str,
    best: bool = True,
) -> None:
    """A row a method, a column a joint, and the mean of the joints."""
    rows: list[list[Any]] = []
    for name, one in methods.items():
        values = [float(value) for value in np.asarray(of(one), dtype=float)]
        rows.append([name, *values, _average(values)])
    columns = ["method", *(f"joint {j + 1}" for j in range(robot.n)), "mean"]
    report.table(columns, _with_best(rows, 1) if best and len(rows) > 1 else rows, caption)


def _with_best(rows: list[list[Any]], first: int) -> list[list[Any]]:
    """Rows in which the least number of each column from ``first`` on stands out."""
    table = np.array([row[first:] for row in rows], dtype=float)
    least = np.min(np.where(np.isnan(table), np.inf, table), axis=0)
    return [
        [*row[:first], *(strong(v) if v == low else v for v, low in zip(row[first:], least, strict=True))]
        for row in rows
    ]


def _average(values: Sequence[float] | FloatArray) -> float:
    """Mean of the joints' sizes that are known."""
    sizes = np.abs(np.asarray(values, dtype=float))
    return float(np.mean(sizes[np.isfinite(sizes)])) if np.isfinite(sizes).any() else float("nan")
