"""The report of ``sensorless gap``: where the gap is, what it is called, how far it closes, and what stays open."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from comparisons.report import style
from comparisons.report.provenance import Provenance
from comparisons.report.report import Report
from comparisons.report.rests import sticking, yielding
from ident.effects.base import Coefficient
from ident.gap.report import ITS_SIZE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.arrays import FloatArray
    from ident.gap import Finding, GapReport, Unexplained
    from ident.gap.evidence import Evidence
    from ident.log import LogSource

WORDS = {
    "payload": "the arm carries a load that the model does not know",
    "base-tilt": "the base is tilted",
    "cable-spring": "a cable or hose pulls as the joint turns",
    "gravity-balancer": "a balancer relieves the joint of gravity",
    "rotor-inertia": "the inertia that turns with the joint is not the model's",
    "coulomb": "dry friction differs from the model's",
    "viscous": "viscous friction differs from the model's",
    "coulomb-asymmetry": "friction differs between the two directions",
    "stribeck": "friction is higher at low speed",
    "sigmoid": "dry friction builds up over a range of speeds",
    "viscous-nonlinear": "friction grows with a power of speed",
    "load-friction": "friction grows with load",
    "position-friction": "friction changes with the joint's position",
    "thermal-friction": "friction changes as the joint warms up",
    "maxwell-slip": "friction remembers how the joint came to where it is",
    "cross-joint-hysteresis": "another joint's motion drives a hysteretic force",
    "backlash": "the load is missing while the gear crosses its play",
    "cross-joint-friction": "friction depends on another joint's speed",
    "elasticity": "the link lags behind the motor on a spring",
    "gear-ripple": "a force repeats with the joint's angle, as gears do",
    "drive-gain": "the drive's gain is not the model's",
    "torque-saturation": "the motor gives less torque at high current",
    "current-offset": "the current has another offset",
    "sensor-drift": "the current's offset drifts",
    "cogging": "a force repeats with the joint's angle, as motor poles do",
    "delay": "the current comes late",
    "filter-lag": "the current passes a filter",
    "contact": "something touched the arm",
}
EARLY = "the current comes early, or the positions late"
"""What is said of a delay of less than no time."""

ANGLE, FORCE = "{angle}", "{current}"
UNITS = {
    **{"mass": "kg", "seconds": "s", "hertz": "Hz", "roll": "rad", "pitch": "rad"},
    **dict.fromkeys(("gap", "slip", "neutral", "slack", "most_at", "least_at"), ANGLE),
    **dict.fromkeys(("force", "offset"), FORCE),
    **dict.fromkeys(("stiffness", "slack_stiffness"), f"{FORCE}/{ANGLE}"),
    **{"per_hour": f"{FORCE}/h", "speed": f"{ANGLE}/s"},
}
"""Units of figures, by their key; friction by load has a force for each of load."""
SIZES = {
    "load": "it is larger where that changes sides, as where gears have play",
    "|dq": "it is larger in slow motion",
    "dq": "it is larger in fast motion",
}
"""What is meant where only the size of what is unexplained follows a signal that begins so."""

POINTS = 4000

MANY = 1e4
"""Times the noise floor from which on the map has no room for digits."""

BINS, A_PERIOD, MOST_BINS, LEAST_ROWS = 24, 12, 600, 6
"""Bins of a mean over a signal; for each period of a force that repeats; at most; rows that one must have."""

HARDLY = 0.005
"""Share by which the gap must change for it to be said to fall or to grow."""


def nameless(one: Unexplained) -> str:
    """Say in one sentence what is there on a joint and has no name."""
    joints = ", ".join(str(j + 1) for j in one.joints)
    follows = ", ".join(one.depends_on) or "no one signal"
    text = f"Joint {joints}: {100 * one.share:.0f} % of the squared residual is unexplained; it follows {follows}"
    if not follows.endswith(ITS_SIZE):
        return f"{text}."
    return f"{text}: {next(words for key, words in SIZES.items() if follows.startswith(key))}."


def sentence(found: GapReport, finding: Finding) -> str:
    """Say a finding in one sentence, with its main figures and the gap before and after on the test logs."""
    where, figures = finding.where, _figures(found, finding)
    if finding.effect == "delay" and not finding.terms:
        where = "Logged velocities come late and are derived from the positions instead. " + where
    seconds = finding.parameters.get("seconds")
    early = finding.effect == "delay" and isinstance(seconds, float) and seconds < 0.0
    words = EARLY if early else WORDS.get(finding.effect, finding.effect)
    text = f"{where}: {words} ({finding.effect}; {figures})"
    if found.evidence is not None and finding.effect != "contact":
        number = found.findings.index(finding)
        steps, part = _errors(found, found.evidence)
        before, after = steps[number], steps[number + 1]
        everywhere = not finding.joints or any(term.effect.acts_on is None for term in finding.terms)
        joint = int(np.argmax(1.0 - after / before)) if everywhere else finding.joints[0]
        unit = found.model.unit
        less = 1.0 - after[joint] / before[joint]
        change = "falls" if less > HARDLY else "hardly changes," if less > -HARDLY else "does not fall: it goes"
        text += f"; the gap on test logs{part} {change} from {before[joint]:.3g} to {after[joint]:.3g} {unit}"
        text += f"{f' on joint {joint + 1}' if everywhere else ''}, noise floor {found.noise_floor[joint]:.3g}"
        if everywhere and (worse := np.flatnonzero(after > (1.0 + HARDLY) * before).tolist()):
            text += f", and rises on joint {', '.join(str(j + 1) for j in worse)}"
    text += "."
    if finding.alternatives:
        text += f" These logs cannot tell it from {', '.join(finding.alternatives)}."
    return text


def _errors(found: GapReport, shown: Evidence) -> tuple[Sequence[FloatArray], str]:
    """Errors (n,) on test logs, step by step, and how to say so: of motion where rests of joints that stick hide it."""
    return (shown.moving, ", in motion,") if found.rests else (shown.steps, "")


def gap_report(found: GapReport, test: Sequence[LogSource], note: Provenance) -> Report:
    """Report what the workflow found.

    Args:
        found: the workflow's report.
        test: logs on which the gap is shown.
        note: the run behind it.
    """
    assert found.evidence is not None
    robot, unit = found.model.robot, found.model.unit
    before, after = found.evidence.before, found.evidence.after
    names = ", ".join(dict.fromkeys(f.effect for f in found.findings)) or "nothing"
    steps, part = _errors(found, found.evidence)
    first, last = steps[0], steps[-1]
    summary = (
        f"Named: {names}. Mean error on the test logs{part} {first.mean():.3g} {unit} before, {last.mean():.3g} after."
    )
    report = Report(f"The gap between simulation and measurement of {robot.name}", summary)
    if found.warnings:
        report.section("Warnings")
    for warning in found.warnings:
        report.text(warning)
    report.section("Findings")
    if not found.findings:
        report.text("No effect of the catalogue passes the gate on these logs.")
    for finding in found.findings:
        report.text(sentence(found, finding))
        if finding.next_experiment:
            files = ", ".join(f"experiments/{name}.csv" for name in finding.telling)
            where = f" Commanded positions: {files}." if files else ""
            nothing = bool(finding.experiments) and not files
            what = "tell most" if files and not finding.motions else "settle it"
            report.text(f"What would {what}{' is not known' if nothing else ''}: {finding.next_experiment}.{where}")
    if found.findings:
        _table(report, found)
    report.section("Where the gap is")
    report.text(
        "RMS residual by joint and regime of motion on the train logs, over the joint's noise floor; one is noise. "
        "Blank: hardly a row, or rows left out because the joint sticks, or noise hides which way it moves."
    )
    report.figure(_map(found), "Before (left) and after (right) what was found is added")
    shown = [before, after, *((first, last) if found.rests else ())]
    rows = [[j + 1, name, *(x[j] for x in shown), found.noise_floor[j]] for j, name in enumerate(robot.joints)]
    moving = [f"before, in motion [{unit}]", f"after, in motion [{unit}]"] if found.rests else []
    columns = ["joint", "name", f"before [{unit}]", f"after [{unit}]", *moving, f"noise floor [{unit}]"]
    report.table(columns, rows, "RMS error on the test logs")
    for finding in found.findings:
        if len(finding.joints) == 1 and finding.effect != "contact":
            caption = f"Joint {finding.joints[0] + 1}: {finding.effect}, in rows of the train logs"
            report.figure(_signal(found, finding), caption)
    _traces(report, found, test)
    _open(report, found)
    return report.provenance(note)


def _table(report: Report, found: GapReport) -> None:
    rows = []
    for finding in found.findings:
        joints = ", ".join(str(j + 1) for j in finding.joints) or "all"
        control = "" if finding.control is None else f"{100 * finding.control:.2g} %"
        figures = _figures(found, finding)
        others = ", ".join(finding.alternatives) or "none"
        rows.append([joints, finding.effect, figures, f"{finding.p_value:.1g}", others, control])
    columns = ["joint", "effect", "parameters", "p-value", "alternatives", "negative control"]
    report.table(
        columns,
        rows,
        "p-value: chance of so good a candidate where there is nothing. Negative control: what the same signal, "
        "its phases drawn at random, gains; about nought is right. The whole robot's effects have none.",
    )


def _map(found: GapReport) -> Figure:
    figure = style.new_figure(9.0, 0.35 * found.model.n + 1.6)
    with style.report_style():
        axes = figure.subplots(1, 2, sharey=True)
        floor = (found.noise_floor * found.model.gain)[:, None]
        shown = [m.rms / np.maximum(floor, 1e-300) for m in (found.map_before, found.map_after)]
        top = max(2.0, float(np.nanmax(shown[0])))
        for axis, values, title in zip(axes, shown, ("before", "after"), strict=True):
            image = axis.imshow(values, aspect="auto", cmap="YlOrRd", vmin=0.8, vmax=top)
            axis.set_title(title)
            axis.set_xticks(range(len(found.map_before.regimes)), found.map_before.regimes, rotation=60, ha="right")
            axis.set_yticks(range(found.model.n), [f"J{j + 1}" for j in range(found.model.n)])
            axis.grid(False)
            for (j, k), value in np.ndenumerate(values):
                if np.isfinite(value):
                    colour = "white" if value > 0.65 * top else "#1f2a33"
                    text = f"{value:.1f}" if value < MANY else f"{value:.0e}"
                    axis.text(k, j, text, ha="center", va="center", fontsize=6, color=colour)
        figure.colorbar(image, ax=axes, label="RMS over noise floor")
    return figure


def _signal(found: GapReport, finding: Finding) -> Figure:
    """The residual against the signal that the effect depends on, before and after."""
    joint = finding.joints[0]
    label, x = _depends_on(found, finding, joint)
    bins = BINS
    if label.startswith("position") and isinstance(often := finding.parameters.get("per_turn"), float):
        bins = max(bins, min(round(A_PERIOD * often * np.ptp(x) / (2.0 * np.pi)), MOST_BINS))
    every = max(1, len(x) // POINTS)
    figure = style.new_figure(9.0, 2.6)
    with style.report_style():
        axes = figure.subplots(1, 2, sharey=True)
        gain = found.model.gain[joint]
        for axis, values, title in zip(axes, found.residuals, ("before", "after"), strict=True):
            y = values[:, joint] / gain
            axis.plot(x[::every], y[::every], ".", color=style.RESIDUAL, markersize=1.5)
            edges = np.quantile(x, np.linspace(0, 1, bins + 1))
            middles, means = [], []
            for low, high in itertools.pairwise(edges):
                rows = (x >= low) & (x <= high) & np.isfinite(y)
                if rows.sum() >= LEAST_ROWS:
                    middles.append(float(x[rows].mean()))
                    means.append(float(y[rows].mean()))
            axis.plot(middles, means, color=style.PREDICTED, linewidth=1.5, label="mean")
            axis.set_title(title)
            axis.set_xlabel(label)
        axes[0].set_ylabel(f"residual [{found.model.unit}]")
        style.legend_above(figure, axes[0])
    return figure


def _depends_on(found: GapReport, finding: Finding, joint: int) -> tuple[str, FloatArray]:
    """The signal that shows an effect best: what its columns follow."""
    panel = found.panel
    slow = ("stribeck", "sigmoid", "viscous-nonlinear", "coulomb", "viscous", "coulomb-asymmetry")
    unit = panel.robot.displacement_unit(joint)
    if finding.effect in slow:
        return f"velocity [{unit}/s]", panel.velocity[:, joint]
    if finding.effect in ("gear-ripple", "cogging", "cable-spring", "gravity-balancer"):
        return f"position [{unit}]", panel.motion.q[:, joint]
    if finding.effect == "sensor-drift":
        return "time [s]", panel.motion.t
    term = finding.terms[0]
    columns = panel.columns(term.effect, term.shape, joint) @ term.coefficients
    return f"what {finding.effect} adds [{found.model.force_unit}]", columns


def _traces(report: Report, found: GapReport, test: Sequence[LogSource]) -> None:
    log, old = next(found.before.predict_blocks(test[0]))
    _, new = next(found.model.predict_blocks(test[0]))
    rows = slice(0, 6000)
    figure, axes = style.joint_grid(found.model.robot.joints, "time [s]", f"residual [{found.model.unit}]")
    t = log.t[rows] - log.t[0]
    for j, axis in enumerate(axes):
        for values, colour, label in ((old, style.MEASURED, "before"), (new, style.PREDICTED, "after")):
            axis.plot(*style.thin(t, (log.current - values)[rows, j]), color=colour, label=label, linewidth=0.7)
    style.legend_above(figure, axes[0])
    report.section("Residuals")
    report.figure(figure, f"The first {t[-1]:.0f} s of `{test[0].name}`, a test log, with all its rows")


def _open(report: Report, found: GapReport) -> None:
    report.section("What is unexplained")
    rows = [
        [", ".join(str(j + 1) for j in u.joints), ", ".join(u.depends_on) or "no one signal", 100 * u.share]
        for u in found.unexplained
    ]
    if rows:
        columns = ["joint", "depends on", "explainable share of the squared residual [%]"]
        report.table(columns, rows, "There, but no effect of the catalogue accounts for it")
    else:
        report.text("Nothing that a flexible regressor could predict on stretches held out.")
    if found.rests:
        report.text(sticking(found.rests))
    if found.model.presliding.any():
        report.text(yielding(found.model.presliding))
    report.section("What could not be tested")
    rows = [[u.effect, ", ".join(str(j + 1) for j in u.joints) or "all", u.reason] for u in found.untestable]
    if rows:
        report.table(["effect", "joint", "why"], rows)
    else:
        report.text("These logs could show every effect of the catalogue.")


def _figures(found: GapReport, finding: Finding) -> str:
    """A finding's figures with their units."""

    def unit_of(key: str) -> str:
        unit = "" if (finding.effect, key) == ("load-friction", "force") else UNITS.get(key, "")
        return found.model.unit_of(finding.terms[0].effect, Coefficient(key, unit)) if finding.terms else unit

    return ", ".join(f"{key} {_number(value)} {unit_of(key)}".rstrip() for key, value in finding.parameters.items())


def _number(value: float | list[float]) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(f"{v:.3g}" for v in value) + "]"
    return f"{value:.3g}"
