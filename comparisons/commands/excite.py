"""``sensorless excite``: a feasible motion that shows a robot's parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from ident.errors import InputError

if TYPE_CHECKING:
    from comparisons.output import OutputDirectory
    from ident.arrays import FloatArray
    from ident.excitation.design import Designer, Excitation, Request
    from ident.robot import Robot

Box = tuple[float, float, float, float, float, float]


def excite(
    robot: str,
    /,
    *,
    out: Path,
    period: float = 10.0,
    harmonics: int = 5,
    objective: str = "log-det",
    restarts: int = 5,
    seed: int = 0,
    rate: float = 100.0,
    waypoints: str = "csv",
    given: Annotated[list[Path] | None, Parameter(consume_multiple=True, negative="")] = None,
    model: Path | None = None,
    ground: float = 0.0,
    no_ground: Annotated[bool, Parameter(negative="")] = False,
    box: Box | None = None,
    clearance: float = 0.02,
    position_share: float = 0.95,
    velocity_share: float = 0.9,
    acceleration_share: float = 0.9,
    torque_share: float = 0.8,
) -> None:
    """Design a motion that shows the robot's parameters and keeps all its limits.

    Args:
        robot: a robot card, or the name of a built-in robot.
        out: directory for waypoints, report, view and result.json.
        period: length of the motion [s].
        harmonics: of the Fourier series.
        objective: log-det (D-optimal) or condition (the condition number).
        restarts: random motions to begin from.
        seed: of the random motions.
        rate: of the waypoints [Hz].
        waypoints: csv or parquet.
        given: logs already taken, or folders of them; the motion adds most to these.
        model: output of identify, for the torques to expect; by default the URDF's inertias.
        ground: height of the ground in the base frame [m].
        no_ground: there is no ground.
        box: corners of the box to stay in, in the base frame [m]: x y z of the lower, then of the upper.
        clearance: distance to keep from the ground, the box and the arm itself [m].
        position_share: share of the position ranges to use.
        velocity_share: share of the velocity limits to use.
        acceleration_share: share of the acceleration limits to use.
        torque_share: share of the effort limits to use.
    """
    from comparisons.output import OutputDirectory
    from ident.excitation.design import Designer, Request
    from ident.excitation.geometry import Surroundings
    from ident.excitation.limits import Shares
    from ident.excitation.output import FORMATS, check_rate
    from ident.robot import load_robot

    if waypoints not in FORMATS:
        raise InputError(f"no format {waypoints!r}", "waypoints", f"give one of {', '.join(FORMATS)}")
    corners = (-np.inf,) * 3 + (np.inf,) * 3 if box is None else box
    surroundings = Surroundings(None if no_ground else ground, corners[:3], corners[3:], clearance)
    shares = Shares(position_share, velocity_share, acceleration_share, torque_share)
    request = Request(period, harmonics, objective, restarts, seed, shares, surroundings)
    loaded = load_robot(robot)
    with OutputDirectory(out, "excite") as output:
        designer = Designer(loaded, request, _prior(loaded, model))
        check_rate(designer.family, rate)
        excitation = excite_into(output, designer, rate, waypoints, given or [])
    _say(designer, excitation, out)


def excite_into(
    output: OutputDirectory, designer: Designer, rate: float, waypoints: str, given: list[Path]
) -> Excitation:
    """Design a motion and write everything into an output directory; shared with ``sensorless demo``."""
    from comparisons.progress import show_progress

    with show_progress() as progress:
        known = _known(designer, given)
        excitation = designer.design(known, lambda share: progress("Design", share))
        motion = excitation.trajectory.sample(rate)
        _write(output.path, designer, excitation, known, motion, waypoints, given)
    output.result(_result(designer, excitation, designer.request))
    return excitation


def _prior(robot: Robot, model: Path | None) -> Any:
    from ident.excitation.limits import TorquePrior
    from ident.model_file import load_model

    return None if model is None else TorquePrior.from_model(load_model(model, robot))


def _known(designer: Designer, given: list[Path] | None) -> FloatArray | None:
    from ident.readers import open_logs

    return designer.information.of_logs(open_logs(given, designer.robot)) if given else None


def _write(
    folder: Path,
    designer: Designer,
    excitation: Excitation,
    known: FloatArray | None,
    motion: Any,
    waypoints: str,
    inputs: list[Path],
) -> None:
    from comparisons.report.arm_view import write_arm_view
    from comparisons.report.excitation import excitation_report
    from comparisons.report.provenance import provenance
    from ident.excitation.output import write_joint_trajectory, write_table

    robot = designer.robot
    write_table(motion, folder / f"trajectory.{waypoints}")
    write_joint_trajectory(motion, robot.joints, folder / "trajectory.yaml")
    title, surroundings = f"Excitation of {robot.name}", designer.request.surroundings
    write_arm_view(folder / "motion.html", title, robot.multibody, designer.geometry, motion, surroundings)
    made = provenance(
        [*([robot.urdf] if robot.urdf else []), *inputs], seed=designer.request.seed, libraries=("casadi", "coal")
    )
    excitation_report(designer, excitation, known).provenance(made).write(folder / "report.html")


def _result(designer: Designer, excitation: Excitation, request: Request) -> dict[str, Any]:
    closest, trajectory = excitation.verdict.closest, excitation.trajectory
    series = trajectory.coefficients @ trajectory.family.free.T
    return {
        "joints": list(designer.robot.joints),
        "objective": request.objective,
        "condition_number": excitation.condition_number,
        "links_condition_number": excitation.links_condition_number,
        "log_det": excitation.log_det,
        "period": request.period,
        "harmonics": request.harmonics,
        "mean": series[:, 0],
        "sine": series[:, 1 : 1 + request.harmonics],
        "cosine": series[:, 1 + request.harmonics :],
        "use": excitation.verdict.use,
        "clearance": {"least": closest.least, "between": closest.pair, "time": closest.time},
        "parameters": designer.information.names,
        "starts": [{"log_det": a.log_det, "condition_number": a.condition_number} for a in excitation.attempts],
        "notes": designer.notes(),
    }


def _say(designer: Designer, excitation: Excitation, out: Path) -> None:
    closest = excitation.verdict.closest
    near = f", nothing nearer than {1e3 * closest.least:.0f} mm" if closest.pair else ""
    print(f"condition number {excitation.condition_number:.1f}, log det {excitation.log_det:.1f}{near}")
    for note in designer.notes():
        print(f"note: {note}")
    print(out / "report.html")
