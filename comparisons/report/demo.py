"""The report of ``sensorless demo``: every step in a section, with its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from comparisons.experiments.demonstration import CHANGED_TEST, PERIODS, PUSH, TEST, TOOL, Demonstration
from comparisons.report import comparison_figures, style
from comparisons.report.compliance_figures import joint_compliance
from comparisons.report.gap import sentence
from comparisons.report.provenance import Provenance
from comparisons.report.report import Report, strong

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 40.0
"""Seconds of a log that are plotted."""


def demo_report(demo: Demonstration, summary: list[list[str]], note: Provenance) -> Report:
    """Report a demonstration; ``summary`` is what `demo_rows` says of it."""
    robot = demo.virtual.robot
    report = Report(
        f"A sense of touch for the virtual {robot.name.upper()}",
        f"From joint positions and motor currents alone, in {sum(demo.seconds.values()) / 60.0:.1f} minutes: a motion "
        "designed, a model identified, a hidden change found, a network trained, estimators compared, and an arm that "
        "yields to a push. The virtual robot has friction laws that no model here contains.",
    )
    report.section("In short").table(["step", "time", "what came of it"], summary)
    _excite(report, demo)
    _identify(report, demo)
    _gap(report, demo)
    _train(report, demo)
    _compare(report, demo)
    _comply(report, demo)
    return report.provenance(note)


def demo_rows(demo: Demonstration) -> list[list[str]]:
    """Return step, time and result of every step, as words."""
    unit, evidence = demo.virtual.robot.unit, demo.gap.evidence
    assert evidence is not None
    methods = demo.comparison.methods
    found = ", ".join(dict.fromkeys(finding.effect for finding in demo.gap.findings)) or "nothing"
    mass = next((f.parameters["mass"] for f in demo.gap.findings if f.effect == "payload"), None)
    weighed = "" if mass is None else f" of {mass:.2f} kg"
    rmse = {name: float(np.mean(one["smoothed"]["rmse"])) for name, one in methods.items()}
    episode = demo.push["episodes"][0]
    told = {
        "excite": f"condition number {demo.excitation.condition_number:.1f}, all limits kept",
        "record": f"{demo.minutes:.0f} minutes of logs",
        "identify": f"error {np.mean(methods['physics']['rmse_without_lag']):.2f} {unit} on a test log",
        "gap": f"hidden: payload of {TOOL['mass']:.2f} kg; named: {found}{weighed}; error "
        f"{evidence.before.mean():.2f} -> {evidence.after.mean():.2f} {unit}",
        "train": f"{len(demo.network.trained.weights)} weights, error "
        f"{np.mean(methods['hrdl-md']['rmse']):.2f} {unit} on the test logs",
        "compare": ", ".join(f"{name} {value:.2f}" for name, value in rmse.items()) + f" {unit} of residual",
        "comply": f"yields {100 * episode['yielded'][0]:.0f} cm to {PUSH.force[0]:.0f} N, stops "
        + ("as it is let go" if episode["stopped_after"] <= 0 else f"{episode['stopped_after']:.2f} s after"),
    }
    return [[step, f"{demo.seconds[step]:.0f} s", what] for step, what in told.items()]


def _excite(report: Report, demo: Demonstration) -> None:
    motion, robot, limits = demo.designed, demo.virtual.robot, demo.virtual.robot.limits
    report.section("Excite")
    report.text(
        f"A motion of {motion.t[-1]:g} s that tells most about the links and drives and keeps every limit, the ground "
        f"and the arm itself at a distance. Condition number {demo.excitation.condition_number:.1f}; it is driven "
        f"{PERIODS} times. `excite/motion.html` shows the arm moving, `excite/report.html` the design."
    )
    figure, axes = style.joint_grid(robot.joints, "time [s]", "[rad]", columns=3, height=1.4)
    with style.report_style():
        for joint, axis in enumerate(axes):
            axis.plot(motion.t, motion.q[:, joint], color=style.MEASURED, label="position")
            for limit, label in ((limits.lower, "limit"), (limits.upper, None)):
                axis.axhline(limit[joint], color=style.PREDICTED, linestyle="--", linewidth=0.8, label=label)
        style.legend_above(figure, axes[0])
    report.figure(figure, "The designed motion")


def _identify(report: Report, demo: Demonstration) -> None:
    robot, model = demo.virtual.robot, demo.identified.model
    log = demo.logs(TEST)[0].read()
    log = log[: round(SHOWN * log.rate)]
    predicted = model.predict(log)
    report.section("Identify")
    report.text(
        "Links, rotors, friction with memory and offsets, each joint's parameters fitted to the current. The test log "
        "played no part; it stops and goes, and what the current keeps after a stop is friction that remembers the "
        "last motion. Parameters with their intervals are in `identify/report.html`."
    )
    figure, axes = style.joint_grid(robot.joints, "time [s]", f"current [{robot.unit}]", columns=3, height=1.5)
    with style.report_style():
        for joint, axis in enumerate(axes):
            axis.plot(log.t, log.current[:, joint], color=style.MEASURED, label="measured", linewidth=0.8)
            axis.plot(log.t, predicted[:, joint], color=style.PREDICTED, label="predicted", linewidth=0.8)
        style.legend_above(figure, axes[0])
    report.figure(figure, f"The first {SHOWN:g} s of the test log, unfiltered")


def _gap(report: Report, demo: Demonstration) -> None:
    robot, found = demo.virtual.robot, demo.gap
    assert found.evidence is not None
    report.section("Gap")
    report.text(
        f"Somebody mounts a tool of {TOOL['mass']:g} kg and tells nobody. Three logs of the changed robot are given to "
        "the model as it was identified: what has changed? Another log, which plays no part in the answer, shows what "
        "the answer is worth."
    )
    if not found.findings:
        report.text("Nothing is named: no effect of the catalogue passes the gate on these logs.")
    for finding in found.findings:
        report.text(sentence(found, finding))
    if found.unexplained:
        joints = ", ".join(str(j + 1) for one in found.unexplained for j in one.joints)
        report.text(
            f"On joint {joints} something is left that could be predicted and has no name; `gap/report.html` tells "
            "what it depends on. The virtual robot's friction is richer than any law of the catalogue."
        )
    report.figure(_before_and_after(demo), "Error on the test log before and after what was found is added")
    log, before = next(found.before.predict_blocks(demo.logs(CHANGED_TEST)[0]))
    _, after = next(found.model.predict_blocks(demo.logs(CHANGED_TEST)[0]))
    rows = slice(0, round(SHOWN * log.rate))
    figure, axes = style.joint_grid(robot.joints, "time [s]", f"[{robot.unit}]", columns=3, height=1.5)
    with style.report_style():
        for joint, axis in enumerate(axes):
            for values, colour, label in ((before, style.MEASURED, "before"), (after, style.PREDICTED, "after")):
                left = (log.current - values)[rows, joint]
                axis.plot(log.t[rows], left, color=colour, label=label, linewidth=0.7)
        style.legend_above(figure, axes[0])
    report.figure(figure, "What the model leaves of the current on that log")


def _before_and_after(demo: Demonstration) -> Figure:
    found, n = demo.gap, demo.virtual.robot.n
    assert found.evidence is not None
    figure = style.new_figure(9.0, 2.4)
    with style.report_style():
        axis = figure.subplots()
        parts = (
            ("before", found.evidence.before, style.MEASURED),
            ("after", found.evidence.after, style.PREDICTED),
            ("noise floor", found.noise_floor, style.FURTHER[3]),
        )
        for place, (label, values, colour) in enumerate(parts):
            axis.bar(np.arange(n) + 0.27 * (place - 1), values, width=0.25, color=colour, label=label)
        axis.set_xticks(range(n), [f"Joint {j + 1}" for j in range(n)])
        axis.set_ylabel(f"RMSE [{demo.virtual.robot.unit}]")
        axis.grid(axis="x", visible=False)
        style.legend_above(figure, axis)
    return figure


def _train(report: Report, demo: Demonstration) -> None:
    trained = demo.network.trained
    frames = trained.training["frames"]["train"]
    report.section("Train")
    report.text(
        f"HRDL-MD, made small: {demo.network.hierarchies} networks of {trained.architecture.width} neurons a layer, "
        f"each learning what those before it leave, on {frames:,} frames. It is told how far each joint has gone since "
        "it last turned round, up to a few thresholds, and so knows what a stopped joint remembers. The paper's "
        "networks are four times as wide and learn from three million frames; with less, a model of the physics leads."
    )
    figure = style.new_figure(9.0, 2.4)
    with style.report_style():
        stages = trained.training["stages"]
        axes = figure.subplots(1, len(stages), sharey=True, squeeze=False)[0]
        for number, (axis, stage) in enumerate(zip(axes, stages, strict=True), start=1):
            history = np.asarray(stage["history"])
            axis.plot(history[:, 0], "o-", color=style.MEASURED, label="training")
            axis.plot(history[:, 1], "o-", color=style.PREDICTED, label="validation")
            axis.axvline(stage["best_epoch"], color=style.FURTHER[3], linestyle=":", label="kept")
            axis.set_xticks(range(len(history)))
            axis.set_ylim(bottom=0.0)
            axis.set_title(f"Network {number}")
            axis.set_xlabel("epoch")
        axes[0].set_ylabel("mean square error")
        style.legend_above(figure, axes[0])
    report.figure(
        figure,
        "Losses in units of the deviation of what a network is to learn; at 0 nothing is learned, and a network that "
        "makes the validation frames no better is left there",
    )


def _compare(report: Report, demo: Demonstration) -> None:
    methods, unit = demo.comparison.methods, demo.virtual.robot.unit
    report.section("Compare")
    report.text(
        "What each estimator would take for the outside world while nobody touches the robot, all at "
        f"{demo.comparison.bandwidth:g} Hz, and how well it tells the touches of the second test log. "
        "`compare/report.html` has all figures."
    )
    columns = ["method", f"residual [{unit}]", "touches missed", "told after [s]", "false alarms [1/h]", "AUROC"]
    least = min(float(np.mean(one["smoothed"]["rmse"])) for one in methods.values())
    rows = []
    for name, one in methods.items():
        residual, contact = float(np.mean(one["smoothed"]["rmse"])), one.get("contact", {})
        missed = f"{contact['missed']} of {contact['contacts']}" if contact else None
        keys = ("delay_median", "false_alarms_per_hour", "auroc")
        rows.append(
            [name, strong(residual) if residual == least else residual, missed, *(contact.get(k) for k in keys)]
        )
    report.table(columns, rows, "Estimators side by side, means over the joints")
    report.figure(comparison_figures.regimes(methods, unit), "Residuals by what the joint does")
    report.figure(*comparison_figures.worst_stretch(demo.virtual.robot, demo.comparison))


def _comply(report: Report, demo: Demonstration) -> None:
    robot, one = demo.virtual.robot, demo.ride
    episode = demo.push["episodes"][0]
    start = episode["force_at_start"]
    report.section("Comply")
    report.text(
        "The arm stands under control and its joints follow the residual of the momentum observer, outside a deadzone "
        f"that its residuals on the test logs ask for. First every joint moves to and fro; from {PUSH.start:g} s to "
        f"{PUSH.start + PUSH.duration:g} s the forearm is pushed with up to {PUSH.force[0]:g} N. "
        + ("The arm does not move." if start is None else f"It begins to yield at {start:.0f} N.")
        + f" The point that is pushed goes {1e3 * episode['yielded'][0]:.0f} mm along the push; after the release the "
        f"joints travel no more than {1e3 * demo.push['untouched']['travel']:.2g} mrad."
    )
    figure = joint_compliance(robot, one, demo.boundary, [PUSH])
    report.figure(
        figure,
        "What the observer feels, and beside it the network, which leads nothing; the deadzone, and the velocity "
        "commanded; shaded: the push",
    )
