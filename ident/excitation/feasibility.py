"""Is a motion feasible at every instant, and what has to give where it is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.excitation.clearance import ClearanceModel, Closest
from ident.excitation.fourier import Trajectory
from ident.excitation.limits import MotionLimits, TorquePrior

SAMPLES_PER_HARMONIC = 200
COARSE = 24  # samples a harmonic for a first look
HALVINGS = 6
MOST_HALVINGS = 14  # where no amplitude has been feasible yet
EASE = 0.01  # [m] beyond the clearance, and share of other limits, left at a pose about which to move
REST_TRIALS = 400
ANCHORS = 12
LIMITS = ("position", "velocity", "acceleration", "torque")
NO_CLEARANCE = Closest(True, np.inf, "", 0.0)


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a motion uses of its limits.

    Attributes:
        use: greatest use of each limit at any time, 1 being all that is allowed: by name of the limit, (n,) each.
        closest: where it comes closest to itself or its surroundings.
    """

    use: dict[str, FloatArray]
    closest: Closest

    @property
    def violations(self) -> list[str]:
        """What is wrong, in words; empty for a feasible motion."""
        found = [
            f"{name} of joint {joint + 1} at {100 * share:.3g} % of what is allowed"
            for name, shares in self.use.items()
            for joint, share in enumerate(shares)
            if not share <= 1.0
        ]
        if not self.closest.kept:
            found.append(f"{self.closest.pair} {1e3 * self.closest.least:.0f} mm apart at {self.closest.time:.2f} s")
        return found

    @property
    def feasible(self) -> bool:
        """Tell whether every limit is kept."""
        return not self.violations


@dataclass(frozen=True, eq=False)
class Feasibility:
    """Verifies and repairs motions.

    Attributes:
        limits: to keep.
        prior: torques to expect.
        clearance: distances to keep; None where the robot has no geometry.
    """

    limits: MotionLimits
    prior: TorquePrior
    clearance: ClearanceModel | None

    def verify(self, trajectory: Trajectory, stop: bool = False) -> Verdict:
        """Examine a motion between its samples too.

        Position, velocity and acceleration exceed their samples by no more than the bound of their second derivative
        allows, distances change no faster than the joints move; torque is allowed what its samples' curvature shows.
        ``stop``: do not look for the least distance once it is known to be too small.
        """
        use = self._use(trajectory, SAMPLES_PER_HARMONIC)
        closest = NO_CLEARANCE if self.clearance is None else self.clearance.along(trajectory, stop)
        return Verdict(use, closest)

    def is_feasible(self, trajectory: Trajectory) -> bool:
        """Tell whether a motion keeps every limit, looking at the cheapest first."""
        for samples in (COARSE, SAMPLES_PER_HARMONIC):
            if any(np.any(~(shares <= 1.0)) for shares in self._use(trajectory, samples).values()):
                return False
        return self.clearance is None or self.clearance.along(trajectory).kept

    def repair(self, trajectory: Trajectory) -> tuple[Trajectory, float]:
        """Draw a motion together about a pose where the robot can rest, as little as makes it feasible.

        The pose is the motion's mean, or failing that the first pose along it that will do.

        Returns:
            The feasible motion, and the share of the amplitude that was kept (1: it was feasible).

        Raises:
            InputError: no pose of the motion is feasible.
        """
        if self.is_feasible(trajectory):
            return trajectory, 1.0
        anchor = self._anchor(trajectory)
        good, bad, trials = 0.0, 1.0, 0
        while trials < HALVINGS or (good == 0.0 and trials < MOST_HALVINGS):
            trials += 1
            share = 0.5 * (good + bad)
            if self.is_feasible(trajectory.scaled(share, anchor)):
                good = share
            else:
                bad = share
        if good == 0.0:
            verdict = self.verify(trajectory.scaled(bad, anchor))
            raise InputError(
                f"no amplitude is feasible ({'; '.join(verdict.violations)})", "excitation", "widen these limits"
            )
        return trajectory.scaled(good, anchor), good

    def rest_pose(self, rng: np.random.Generator) -> FloatArray:
        """Draw a pose (n,) in which the robot can rest.

        Raises:
            InputError: none is found; it says which limit stands in the way most often.
        """
        reasons: dict[str, int] = {}
        for _ in range(REST_TRIALS):
            q = rng.uniform(self.limits.lower, self.limits.upper)
            reason = self._unfit(q, EASE)
            if not reason:
                return q
            reasons[reason] = reasons.get(reason, 0) + 1
        worst = max(reasons, key=lambda reason: reasons[reason])
        what = f"no pose at which the robot can rest: {worst} in {reasons[worst]} of {REST_TRIALS} poses"
        raise InputError(what, f"robot {self.prior.robot.name}", "widen this limit or move the work space")

    def _use(self, trajectory: Trajectory, samples: int) -> dict[str, FloatArray]:
        limits, family = self.limits, trajectory.family
        count = samples * family.harmonics
        motion = trajectory.at(family.times(count))
        between = (family.period / count) ** 2 / 8  # times a second derivative: how far a peak can rise between samples
        torque = self.prior.torque(motion)
        bend = np.abs(torque - 0.5 * (np.roll(torque, 1, axis=0) + np.roll(torque, -1, axis=0))).max(axis=0)
        middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
        peaks = [
            np.abs(motion.q - middle).max(axis=0) + between * trajectory.bound(2),
            np.abs(motion.dq).max(axis=0) + between * trajectory.bound(3),
            np.abs(motion.ddq).max(axis=0) + between * trajectory.bound(4),
            np.abs(torque).max(axis=0) + 0.5 * bend + self.prior.friction,
        ]
        sizes = [half, limits.velocity, limits.acceleration, limits.torque]
        return {name: peak / size for name, peak, size in zip(LIMITS, peaks, sizes, strict=True)}

    def _anchor(self, trajectory: Trajectory) -> FloatArray:
        along = trajectory.at(trajectory.family.times(ANCHORS)).q
        poses = [trajectory.coefficients[:, 0], *along]
        reasons = []
        for pose in poses:
            reason = self._unfit(pose)
            if not reason:
                return np.array(pose)
            reasons.append(reason)
        raise InputError(f"no pose of the motion can be repaired: {reasons[0]}", "excitation", "widen this limit")

    def _unfit(self, q: FloatArray, ease: float = 0.0) -> str:
        """Say why the robot cannot rest at a pose, or not with some ease; empty where it can."""
        rim = ease * (self.limits.upper - self.limits.lower)
        outside = np.flatnonzero((q < self.limits.lower + rim) | (q > self.limits.upper - rim))
        if len(outside):
            return f"joint {outside[0] + 1} is beyond its position limit"
        still = np.zeros(len(q))
        body = self.prior.robot.rigid_body
        hold = np.abs(body.inverse_dynamics(q, still, still, np.array(self.prior.parameters))) + self.prior.friction
        weak = np.flatnonzero(hold > (1.0 - ease) * self.limits.torque)
        if len(weak):
            return f"gravity asks for more than the torque limit of joint {weak[0] + 1}"
        touching = "" if self.clearance is None else self.clearance.touching(q, ease)
        return f"{touching} are too close" if touching else ""
