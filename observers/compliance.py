"""An arm that yields: joint velocities from residual currents, tool velocity from a wrench."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray
from ident.causal import CausalButterworth
from ident.errors import InputError
from ident.robot import JointLimits, Robot
from observers.deadzone import Deadzone

BRAKE = 2.0
"""Speed allowed per distance left to a position limit [1/s]."""


class JointAdmittance:
    """Joint velocities proportional to residual currents (the paper's Section VI A), with the sign that yields.

    The paper writes dq = Kp (y - y_est). At rest a motor carries gravity less what the world pushes, y - y_est =
    -tau_ext / gain, so with a positive Kp that moves against the push. Residuals here are positive where the world
    pushes along +q, r = y_est - y, and dq = +Kp r.

    The residual is low-passed, loses what is within the deadzone, and is limited in speed; near a position limit the
    speed towards it falls to nought with the distance left.

    Args:
        gain: Kp [rad/s (m/s) per unit of residual], one or (n,), at least 0.
        deadzone: of the residuals.
        limits: of positions and velocities.
        rate: samples a second [Hz].
        cutoff: low pass on the residual [Hz].
        speed_share: share of the velocity limits to use.
        margin: distance kept from position limits [rad or m].

    Raises:
        InputError: a gain is negative, or the cut-off is not below half the rate.
    """

    def __init__(
        self,
        gain: float | FloatArray,
        deadzone: Deadzone,
        limits: JointLimits,
        rate: float = 100.0,
        cutoff: float = 5.0,
        speed_share: float = 0.2,
        margin: float = 0.05,
    ) -> None:
        n = len(limits.lower)
        self.gain = np.broadcast_to(np.asarray(gain, dtype=np.float64), (n,))
        if np.any(self.gain < 0.0) or not np.all(np.isfinite(self.gain)):
            what = f"gain of {gain}"
            raise InputError(what, "joint admittance", "give gains of at least 0: the sign that yields is built in")
        self.deadzone, self.limits, self.margin = deadzone, limits, margin
        self.speed = speed_share * limits.velocity
        self._filter = CausalButterworth(rate, cutoff, order=2, channels=n)

    def reset(self) -> None:
        """Forget all memory."""
        self._filter.reset()

    def step(self, q: FloatArray, residual: FloatArray) -> FloatArray:
        """Return the joint velocities to command [rad/s or m/s]; all (n,). Nought where a residual is NaN."""
        wanted = self.gain * self.deadzone.apply(self._filter.step(residual))
        wanted = np.clip(np.nan_to_num(wanted), -self.speed, self.speed)
        lowest, highest = speed_window(q, self.limits, self.margin)
        # never told to go back: a joint beyond its margin may stay where it is
        return np.clip(wanted, np.minimum(lowest, 0.0), np.maximum(highest, 0.0))


class TaskAdmittance:
    """Tool velocity proportional to the force on it, its orientation kept (the paper's Section VI B).

    v = Kp f outside the deadzone, with no angular velocity, through the damped inverse of the Jacobian. Where a joint
    would exceed its limits all joints are slowed alike, so that the tool keeps its direction.

    Args:
        robot: the robot, of six joints or more.
        gain: Kp [m/s per N], one or (3,), at least 0.
        deadzone: of the force's three components [N].
        frame: the frame that moves, by default the tool.
        speed: greatest speed of the frame [m/s].
        speed_share: share of the joints' velocity limits to use.
        margin: distance kept from position limits [rad or m].
        damping: of the inverse near singular poses, in the Jacobian's unit.

    Raises:
        InputError: a gain is negative, the robot has fewer than six joints, or no frame has that name.
    """

    def __init__(
        self,
        robot: Robot,
        gain: float | FloatArray,
        deadzone: Deadzone,
        frame: str | None = None,
        speed: float = 0.25,
        speed_share: float = 0.2,
        margin: float = 0.05,
        damping: float = 0.01,
    ) -> None:
        self.gain = np.broadcast_to(np.asarray(gain, dtype=np.float64), (3,))
        if np.any(self.gain < 0.0):
            raise InputError(f"gain of {gain}", "task admittance", "give gains of at least 0")
        if robot.n < 6:
            raise InputError(f"{robot.n} joints", f"robot {robot.name}", "keeping the orientation takes six joints")
        robot.multibody.frame_pose(np.zeros(robot.n), frame)
        self.robot, self.deadzone, self.frame, self.speed = robot, deadzone, frame, speed
        self.joint_speed, self.margin, self.damping = speed_share * robot.limits.velocity, margin, damping

    def step(self, q: FloatArray, wrench: FloatArray) -> FloatArray:
        """Return the joint velocities (n,) for a wrench (6,) in base axes, as `WrenchEstimator` gives it."""
        velocity = self.gain * self.deadzone.apply(np.nan_to_num(wrench[:3]))
        fast = np.linalg.norm(velocity)
        if fast > self.speed:
            velocity = velocity * self.speed / fast
        jacobian = self.robot.multibody.frame_jacobian(q, self.frame)
        damped = jacobian @ jacobian.T + self.damping**2 * np.eye(6)
        wanted = jacobian.T @ np.linalg.solve(damped, np.concatenate([velocity, np.zeros(3)]))
        lowest, highest = speed_window(q, self.robot.limits, self.margin)
        room = np.where(wanted > 0.0, np.maximum(highest, 0.0), np.maximum(-lowest, 0.0))
        allowed = np.minimum(room, self.joint_speed)
        moving = np.abs(wanted) > 1e-12
        share = float(np.min(allowed[moving] / np.abs(wanted[moving]), initial=1.0))
        slowed: FloatArray = share * wanted
        return slowed


def speed_window(q: FloatArray, limits: JointLimits, margin: float) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest velocity (n,) that still stop a joint short of its position limits.

    Args:
        q: joint positions [rad or m], (n,).
        limits: of the joints.
        margin: distance kept from position limits [rad or m].
    """
    return BRAKE * (limits.lower + margin - q), BRAKE * (limits.upper - margin - q)
