"""From the figures of a scenario file to one figure a joint, scaled to the robot where the file leaves them out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comparisons.virtual_robot.scenario import Scenario
from comparisons.virtual_robot.tables import Effect, PerJoint
from ident.arrays import FloatArray
from ident.errors import InputError
from ident.robot import Robot

POSES = 128  # random poses from which a robot's usual torques are taken
USUAL_ACCELERATION = 4.0  # [rad/s^2] at those poses


def reach(robot: Robot) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper ends of the positions to use, (n,) each; half a turn or metre where unlimited."""
    free = np.where(robot.multibody.prismatic, 0.5, np.pi)
    lower = np.where(np.isfinite(robot.limits.lower), robot.limits.lower, -free)
    upper = np.where(np.isfinite(robot.limits.upper), robot.limits.upper, free)
    return lower, upper


def link_torque(robot: Robot) -> FloatArray:
    """Return the largest torque [N m] that gravity and moderate acceleration ask at random poses, (n,)."""
    rng = np.random.default_rng(0)
    lower, upper = reach(robot)
    torques = np.full(robot.n, 1e-3)
    for _ in range(POSES):
        q = rng.uniform(lower, upper)
        ddq = USUAL_ACCELERATION * rng.choice([-1.0, 1.0], robot.n)
        torques = np.maximum(torques, np.abs(robot.multibody.inverse_dynamics(q, np.zeros(robot.n), ddq)))
    return torques


def usual_torque(robot: Robot) -> FloatArray:
    """Return the torque [N m] that ordinary motion asks of each joint, (n,).

    That of the links, but no less than a tenth of the joint's effort limit or a fiftieth of the strongest joint's: the
    motor of a wrist mostly moves itself.
    """
    torques = link_torque(robot)
    effort = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, 0.0)
    usual: FloatArray = np.maximum(torques, np.maximum(0.1 * effort, 0.02 * torques.max()))
    return usual


@dataclass(frozen=True)
class Figures:
    """Reads a scenario for a robot of ``n`` joints; a table with another number of values raises InputError."""

    scenario: Scenario
    n: int

    def each(self, value: PerJoint | None, key: str, default: FloatArray | None = None) -> FloatArray:
        """Return ``value``, or ``default`` where it is None, as one figure a joint (n,); errors name it ``key``."""
        chosen = default if value is None else np.asarray(value, dtype=np.float64)
        if chosen is None:
            raise InputError(f"{key} has no value", f"scenario {self.scenario.name}", "give one")
        if chosen.ndim and len(chosen) != self.n:
            what = f"{key} has {len(chosen)} values where the robot has {self.n} joints"
            raise InputError(what, f"scenario {self.scenario.name}", "give one figure, or one a joint")
        return np.broadcast_to(chosen, (self.n,)).copy()

    def strength(self, key: str) -> FloatArray:
        """Return how strong the effect ``key`` is in each joint, (n,): 0 where it is absent, 1 as its table says."""
        effect: Effect | None = getattr(self.scenario, key)
        if effect is None:
            return np.zeros(self.n)
        strength = self.each(effect.scale, f"{key}.scale")
        if effect.joints is not None:
            chosen = np.array(effect.joints, dtype=np.int64) - 1
            if np.any((chosen < 0) | (chosen >= self.n)):
                what = f"{key}.joints names a joint the robot does not have"
                raise InputError(what, f"scenario {self.scenario.name}", f"count joints from 1 to {self.n}")
            strength[~np.isin(np.arange(self.n), chosen)] = 0.0
        return strength

    def effect(self, key: str, figure: str, default: FloatArray) -> FloatArray:
        """Return a figure of an effect times its strength, (n,); zero where the effect is absent."""
        effect: Effect | None = getattr(self.scenario, key)
        if effect is None:
            return np.zeros(self.n)
        return self.strength(key) * self.each(getattr(effect, figure), f"{key}.{figure}", default)

    def weakened(self, key: str, figure: str) -> FloatArray:
        """Return a figure that weakens its effect as it grows, over the strength (n,); inf where there is no effect."""
        effect: Effect | None = getattr(self.scenario, key)
        if effect is None:
            return np.full(self.n, np.inf)
        strength, value = self.strength(key), self.each(getattr(effect, figure), f"{key}.{figure}")
        weakened: FloatArray = np.divide(value, strength, out=np.full(self.n, np.inf), where=strength > 0.0)
        return weakened

    def loosening(self) -> tuple[FloatArray, FloatArray]:
        """Return how fast stored friction is shaken loose, joint by moving joint (n, n), and what share stays (n,)."""
        effect = self.scenario.cross_joint_hysteresis
        if effect is None:
            return np.zeros((self.n, self.n)), np.ones(self.n)
        rate = np.asarray(effect.per_radian, dtype=np.float64)
        if rate.ndim == 0:
            rate = rate * (1.0 - np.eye(self.n))
        if rate.shape != (self.n, self.n):
            what = f"cross_joint_hysteresis.per_radian is {rate.shape} where the robot has {self.n} joints"
            raise InputError(what, f"scenario {self.scenario.name}", "give one figure, or a row a joint")
        strength = self.strength("cross_joint_hysteresis")
        return strength[:, None] * rate, self.each(effect.kept, "cross_joint_hysteresis.kept")
