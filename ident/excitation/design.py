"""Designs the motion that tells most of a robot's parameters, never one that it cannot make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.excitation.clearance import ClearanceModel
from ident.excitation.feasibility import Feasibility, Verdict
from ident.excitation.fourier import FourierFamily, Trajectory
from ident.excitation.geometry import ArmGeometry, Surroundings
from ident.excitation.information import DRIVE_COLUMNS, Information
from ident.excitation.limits import MotionLimits, Shares, TorquePrior
from ident.excitation.optimiser import OBJECTIVES, Optimiser, Outcome
from ident.excitation.spheres import gap
from ident.robot import Robot

WIDER = (0.0, 0.005, 0.01)  # [m] room beyond the clearance asked of the optimiser, more each time its answer touches
ENOUGH = 0.98  # share of the amplitude that a repair may leave without another, roomier try
EQUAL = 0.05  # log det a parameter, of no account: it widens intervals by 2.5 % in the geometric mean
FILLED = 0.9  # share of its tightest limit that a random motion fills
SAMPLES_PER_HARMONIC = 100

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Request:
    """What to design.

    Attributes:
        period: length of the motion [s].
        harmonics: of the Fourier series.
        objective: ``log-det`` (D-optimal) or ``condition``.
        restarts: random motions to begin from; the best answer is taken.
        seed: of the random motions.
        shares: of the limits that may be used.
        surroundings: ground, walls and clearance.
        drives: what to identify beside the links: any of rotor-inertia, viscous, coulomb.
        nodes: instants at which the optimiser looks, by default 16 a harmonic.
        iterations: of the optimiser, at most, a run.
    """

    period: float = 10.0
    harmonics: int = 5
    objective: str = "log-det"
    restarts: int = 5
    seed: int = 0
    shares: Shares = field(default_factory=Shares)
    surroundings: Surroundings = field(default_factory=Surroundings)
    drives: tuple[str, ...] = DRIVE_COLUMNS
    nodes: int | None = None
    iterations: int = 60

    def __post_init__(self) -> None:
        if not 0 < self.period < np.inf:
            raise InputError(f"a period of {self.period} s", "excitation", "give seconds above zero")
        if self.harmonics < 2:
            raise InputError(f"{self.harmonics} harmonics", "excitation", "give at least 2: one cannot start at rest")
        if self.objective not in OBJECTIVES:
            raise InputError(f"no objective {self.objective!r}", "excitation", f"give one of {', '.join(OBJECTIVES)}")
        if self.restarts < 1:
            raise InputError(f"{self.restarts} restarts", "excitation", "give at least 1")
        for drive in self.drives:
            if drive not in DRIVE_COLUMNS:
                raise InputError(f"no drive effect {drive!r}", "excitation", f"give any of {', '.join(DRIVE_COLUMNS)}")


@dataclass(frozen=True, eq=False)
class Attempt:
    """One start and what came of it.

    Attributes:
        trajectory: feasible.
        kept: share of the optimiser's amplitude that feasibility left.
        log_det, condition_number: of all information, that of earlier logs included.
        outcome: what the optimiser said.
    """

    trajectory: Trajectory
    kept: float
    log_det: float
    condition_number: float
    outcome: Outcome


@dataclass(frozen=True, eq=False)
class Excitation:
    """A designed motion.

    Attributes:
        trajectory: the motion.
        verdict: what it uses of its limits.
        matrix: its own information, (size, size).
        log_det: of all information, earlier logs included; see `Information.log_det`.
        condition_number: likewise, of the regressor with columns of unit length.
        links_condition_number: of the base parameters' columns alone.
        attempts: all starts.
    """

    trajectory: Trajectory
    verdict: Verdict
    matrix: FloatArray
    log_det: float
    condition_number: float
    links_condition_number: float
    attempts: tuple[Attempt, ...]


class Designer:
    """Designs excitation for one robot; what is expensive to set up is kept between designs.

    Args:
        robot: the robot; without its URDF, from which the collision geometry is read, collisions are not watched.
        request: what to design.
        prior: torques to expect, by default those of the URDF's inertias.
        noise: standard deviation of each joint's torque noise, (n,); see `Information`.

    Raises:
        InputError: the request is wrong, or the robot lacks what is needed for it.
    """

    def __init__(
        self,
        robot: Robot,
        request: Request | None = None,
        prior: TorquePrior | None = None,
        noise: FloatArray | None = None,
    ) -> None:
        self.robot = robot
        self.request = Request() if request is None else request
        self.limits = MotionLimits.of(robot, self.request.shares)
        self.prior = TorquePrior.from_urdf(robot) if prior is None else prior
        self.family = FourierFamily(robot.n, self.request.period, self.request.harmonics)
        self.geometry = None if robot.urdf is None else ArmGeometry.from_urdf(robot.urdf, robot.multibody)
        self.clearance = self._clearance()
        self.feasibility = Feasibility(self.limits, self.prior, self.clearance)
        self.information = Information(robot, self.limits.span, self.request.drives, noise)

    @cached_property
    def optimiser(self) -> Optimiser:
        """The optimisation, set up on first use."""
        request = self.request
        smooth: ca.Function | None = None if self.clearance is None else gap(self.clearance, self.limits.span)
        return Optimiser(
            self.information,
            self.family,
            self.limits,
            self.prior,
            smooth,
            request.objective,
            request.nodes,
            request.iterations,
        )

    def notes(self) -> list[str]:
        """Say what is not watched, for the user to know."""
        if self.clearance is None or self.geometry is None or not self.geometry.bodies:
            return ["The URDF has no collision geometry that could be read: collisions are not watched."]
        found = [f"Mesh {name} was not found: its link is not watched." for name in self.geometry.missing]
        if self.clearance.never_apart:
            found.append(f"Close in every pose, and so not watched: {'; '.join(self.clearance.never_apart)}.")
        if self.clearance.built_close():
            pairs = "; ".join(self.clearance.built_close())
            found.append(f"Built closer than the clearance, kept at half their largest distance: {pairs}.")
        return found

    def start(self, rng: np.random.Generator) -> Trajectory:
        """Draw a motion about a pose of rest, each joint filling the tightest of its own limits.

        It may ask for too much torque, or touch; see `draw`.

        Raises:
            InputError: there is no pose of rest.
        """
        family, limits = self.family, self.limits
        mean = self.feasibility.rest_pose(rng)
        weights = 1.0 / np.arange(1, family.harmonics + 1)
        coefficients = np.column_stack([mean, rng.standard_normal((family.joints, family.size - 1))])
        wanted = np.concatenate([[1.0], weights, weights])  # each harmonic adds about the same speed
        coefficients = (coefficients @ family.free.T * wanted) @ family.free
        swing = Trajectory(family, np.column_stack([np.zeros(family.joints), coefficients[:, 1:]]))
        motion = swing.at(family.times(SAMPLES_PER_HARMONIC * family.harmonics))
        room = np.minimum(
            (limits.upper - mean) / np.maximum(motion.q.max(axis=0), 1e-9),
            (mean - limits.lower) / np.maximum(-motion.q.min(axis=0), 1e-9),
        )
        room = np.minimum(room, limits.velocity / np.abs(motion.dq).max(axis=0))
        room = np.minimum(room, limits.acceleration / np.abs(motion.ddq).max(axis=0))
        return Trajectory(family, np.column_stack([mean, FILLED * room[:, None] * coefficients[:, 1:]]))

    def draw(self, rng: np.random.Generator) -> Trajectory:
        """Draw a feasible motion of the family, as large as repair lets it be."""
        return self.feasibility.repair(self.start(rng))[0]

    def design(self, known: FloatArray | None = None, progress: Progress | None = None) -> Excitation:
        """Design the motion that adds most to what is known.

        Args:
            known: information of logs already taken (`Information.of_logs`), (size, size); by default none.
            progress: told the share of the work done.

        Raises:
            InputError: no feasible motion exists; it says which limit stands in the way.
        """
        rng = np.random.default_rng(self.request.seed)
        attempts = []
        for k in range(self.request.restarts):
            attempts.append(self.attempt(self.start(rng), known))
            if progress is not None:
                progress((k + 1) / self.request.restarts)
        best = self.choose(attempts)
        matrix = self.gain(best.trajectory)
        total = matrix if known is None else matrix + known
        return Excitation(
            best.trajectory,
            self.feasibility.verify(best.trajectory),
            matrix,
            best.log_det,
            best.condition_number,
            self.information.condition_number(total, links_only=True),
            tuple(attempts),
        )

    def attempt(self, start: Trajectory, known: FloatArray | None = None) -> Attempt:
        """Improve one motion and make the answer feasible, leaving more room where it would touch."""
        best: Attempt | None = None
        for room in WIDER:
            improved, outcome = self.optimiser.improve(start, known, room)
            try:
                repaired, kept = self.feasibility.repair(improved)
            except InputError:
                continue  # no pose along the answer is feasible; another with more room may be
            found = self._attempt(repaired, kept, outcome, known)
            best = found if best is None or self._rank(found) < self._rank(best) else best
            if kept >= ENOUGH:
                break
            start = repaired
        if best is None:
            best = self._attempt(*self.feasibility.repair(start), outcome, known)
        return best

    def choose(self, attempts: Sequence[Attempt]) -> Attempt:
        """Take the attempt that meets the objective best.

        Of those whose determinants are as good as equal the one with the least condition number is taken, in which no
        combination of parameters is left far behind the others.
        """
        if self.request.objective == "condition":
            return min(attempts, key=self._rank)
        enough = max(a.log_det for a in attempts) - EQUAL * self.information.size
        return min((a for a in attempts if a.log_det >= enough), key=lambda a: a.condition_number)

    def gain(self, trajectory: Trajectory) -> FloatArray:
        """Information (size, size) of a motion."""
        instants = self.family.times(SAMPLES_PER_HARMONIC * self.family.harmonics)
        return self.information.matrix(trajectory.at(instants), self.family.period)

    def _attempt(self, trajectory: Trajectory, kept: float, outcome: Outcome, known: FloatArray | None) -> Attempt:
        matrix = self.gain(trajectory) if known is None else self.gain(trajectory) + known
        log_det, condition = self.information.log_det(matrix), self.information.condition_number(matrix)
        return Attempt(trajectory, kept, log_det, condition, outcome)

    def _rank(self, attempt: Attempt) -> float:
        return -attempt.log_det if self.request.objective == "log-det" else attempt.condition_number

    def _clearance(self) -> ClearanceModel | None:
        if self.geometry is None or not self.geometry.bodies:
            return None
        span = self.limits.span
        return ClearanceModel.build(self.robot.multibody, self.geometry, self.request.surroundings, span)
