"""The report of a designed excitation: what it tells, what it asks of each joint, and how near it comes to touching."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from comparisons.report.report import Report
from comparisons.report.style import FURTHER, MEASURED, PREDICTED, joint_grid, legend_above, new_figure, report_style
from ident.arrays import FloatArray
from ident.excitation.clearance import ClearanceModel
from ident.excitation.design import Designer, Excitation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = 500
SHOWN = 0.25  # [m] distances that the plot of clearances shows


def excitation_report(designer: Designer, excitation: Excitation, known: FloatArray | None) -> Report:
    """Write the report; ``known`` is the information of earlier logs (size, size), if there were any."""
    request, robot = designer.request, designer.robot
    report = Report(
        f"Excitation of {robot.name}",
        f"{request.period:g} s, {request.harmonics} harmonics from rest to rest. Condition number "
        f"{excitation.condition_number:.1f} with columns of unit length, {excitation.links_condition_number:.1f} for "
        f"the links alone; all limits are kept at every instant.",
    )
    _limits(report, designer, excitation)
    _clearance(report, designer, excitation)
    _starts(report, designer, excitation)
    _information(report, designer, excitation, known)
    return report


def _information(report: Report, designer: Designer, excitation: Excitation, known: FloatArray | None) -> None:
    information = designer.information
    total = excitation.matrix if known is None else excitation.matrix + known
    deviations = information.deviations(total) * information.scale
    report.section("What it tells")
    report.text(
        "The deviation of each parameter is given relative to a parameter that would move the torques of random motion "
        "by one standard deviation of their noise for a second: small is well known. Parameters of links are base "
        "parameters, that is, combinations that motion can tell apart."
    )
    rows = [[name, value] for name, value in zip(information.names, deviations, strict=True)]
    report.table(["parameter", "deviation"], rows, "Parameters and how well this motion shows them")


def _limits(report: Report, designer: Designer, excitation: Excitation) -> None:
    robot, limits, prior = designer.robot, designer.limits, designer.prior
    report.section("Joints against their limits")
    use = excitation.verdict.use
    rows = [[k + 1, name, *(100 * use[kind][k] for kind in use)] for k, name in enumerate(robot.joints)]
    titles = ["joint", "name", *(f"{kind} [%]" for kind in use)]
    report.table(titles, rows, "Greatest use of what the shares of the limits allow, between samples too")
    motion = excitation.trajectory.at(np.linspace(0.0, designer.family.period, SAMPLES))
    slides = robot.multibody.prismatic
    angle, force = ("rad or m", "N m or N") if np.any(slides) else ("rad", "N m")
    room = prior.room(limits)
    for name, unit, values, low, high in (
        ("Position", angle, motion.q, limits.lower, limits.upper),
        ("Velocity", f"{angle}/s", motion.dq, -limits.velocity, limits.velocity),
        ("Acceleration", f"{angle}/s²", motion.ddq, -limits.acceleration, limits.acceleration),
        ("Torque", force, prior.torque(motion), -room, room),
    ):
        figure = _curves(designer, motion.t, values, (low, high), f"[{unit}]")
        caption = f"{name} of each joint, and the limits less the share kept back"
        report.figure(figure, caption + (", of links and rotors" if name == "Torque" else ""))


def _curves(
    designer: Designer, t: FloatArray, values: FloatArray, ends: tuple[FloatArray, FloatArray], unit: str
) -> Figure:
    figure, axes = joint_grid(designer.robot.joints, "Time [s]", unit)
    with report_style():
        for k, axis in enumerate(axes):
            axis.plot(t, values[:, k], color=MEASURED, label="motion")
            for end in ends:
                if np.isfinite(end[k]):
                    axis.axhline(end[k], color=PREDICTED, linestyle="--", label="limit" if end is ends[0] else None)
        legend_above(figure, axes[0])
    return figure


def _clearance(report: Report, designer: Designer, excitation: Excitation) -> None:
    report.section("Clearance")
    for note in designer.notes():
        report.text(note)
    clearance, closest = designer.clearance, excitation.verdict.closest
    if clearance is None or not clearance.watched():
        return
    wanted = clearance.surroundings.clearance
    report.text(
        f"The nearest approach is {1e3 * closest.least:.0f} mm, between {closest.pair}, at {closest.time:.2f} s. "
        f"{1e3 * wanted:.0f} mm are kept along the whole path: between the poses examined, no pair can come closer "
        "than the joints' speeds carry it. Meshes count as their convex hulls. "
        "`motion.html` shows the arm moving."
    )
    motion = excitation.trajectory.at(np.linspace(0.0, designer.family.period, SAMPLES))
    figure = new_figure(9.0, 3.2)
    with report_style():
        axis = figure.subplots()
        for (name, distance), colour in zip(_nearest(clearance, motion.q), (MEASURED, *FURTHER), strict=False):
            axis.plot(motion.t, 1e3 * distance, color=colour, label=name)
        axis.axhline(1e3 * wanted, color=PREDICTED, linestyle="--", label="to be kept")
        axis.set_xlabel("Time [s]")
        axis.set_ylabel("Distance [mm]")
        axis.set_ylim(0.0, 1e3 * max(SHOWN, 3.0 * wanted))
        figure.legend(loc="outside right upper")
    report.figure(figure, "The pairs that come closest")


def _nearest(clearance: ClearanceModel, q: FloatArray) -> list[tuple[str, FloatArray]]:
    """Distance along the motion of each two links, those that come nearest first; a link may have several bodies."""
    distances = np.array([clearance.distances(pose) for pose in q])
    links: dict[str, FloatArray] = {}
    for pair in range(distances.shape[1]):
        name = clearance.name(pair)
        links[name] = np.minimum(links.get(name, np.full(len(q), np.inf)), distances[:, pair])
    return sorted(links.items(), key=lambda link: float(link[1].min()))


def _starts(report: Report, designer: Designer, excitation: Excitation) -> None:
    report.section("Starts")
    report.text(
        f"The {len(excitation.attempts)} random starts were improved for `{designer.request.objective}`, "
        "verified, and drawn together where they overstepped a limit; the best was taken."
    )
    rows = [
        [k + 1, a.log_det, a.condition_number, 100 * a.kept, a.outcome.iterations, a.outcome.status.replace("_", " ")]
        for k, a in enumerate(excitation.attempts)
    ]
    titles = ["start", "log det", "condition number", "amplitude kept [%]", "iterations", "optimiser"]
    report.table(titles, rows, "What came of each start")
