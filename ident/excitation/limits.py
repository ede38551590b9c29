"""What a motion may ask of the robot: its limits less a margin, and the torques that a prior model expects."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.model import NEWTON_METRE, CurrentModel
from ident.robot import Robot
from ident.signals import Motion
from ident.symbolic import inverse_dynamics, motor_forces, motor_motion, regressor

FREE_TURN, FREE_SLIDE = np.pi, 0.5  # positions to either side of zero where a joint has no limit [rad, m]
STATES = 1000  # random poses and velocities at which a model's friction is taken
SEED = 0


@dataclass(frozen=True)
class Shares:
    """Share of each limit that a motion may use, 0 to 1; of the position range it is taken about the middle."""

    position: float = 0.95
    velocity: float = 0.9
    acceleration: float = 0.9
    torque: float = 0.8

    def __post_init__(self) -> None:
        for name, share in vars(self).items():
            if not 0.0 < share <= 1.0:
                raise InputError(f"{name} share {share}", "limits", "give a share above 0 and up to 1")


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits to design within, margins taken off: each (n,), infinite where the robot names none.

    Attributes:
        lower, upper: positions [rad, prismatic m].
        velocity, acceleration, torque: greatest sizes [rad/s, rad/s^2, N m].
    """

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray

    @staticmethod
    def of(robot: Robot, shares: Shares) -> MotionLimits:
        """Take shares of a robot's limits; a joint without position limits gets half a turn or half a metre either way.

        Raises:
            InputError: a joint has no velocity limit.
        """
        given = robot.limits
        unknown = np.flatnonzero(~np.isfinite(given.velocity)) + 1
        if len(unknown):
            what = f"no velocity limit for joint {', '.join(map(str, unknown))}"
            raise InputError(what, f"robot {robot.name}", "give [limits] velocity in the card")
        free = np.where(robot.multibody.prismatic, FREE_SLIDE, FREE_TURN)
        lower, upper = (
            np.where(np.isfinite(given.lower), given.lower, -free),
            np.where(np.isfinite(given.upper), given.upper, free),
        )
        middle, half = 0.5 * (lower + upper), 0.5 * shares.position * (upper - lower)
        return MotionLimits(
            middle - half,
            middle + half,
            shares.velocity * given.velocity,
            shares.acceleration * given.acceleration,
            shares.torque * given.effort,
        )

    @property
    def span(self) -> FloatArray:
        """Lower and upper positions, (2, n)."""
        return np.array([self.lower, self.upper])


@dataclass(frozen=True, eq=False)
class TorquePrior:
    """Torques to expect of a motion.

    Attributes:
        robot: the robot.
        parameters: inertial parameters that row j of the links' equations uses [SI], (n, 10 n).
        rotor_inertia: inertia at each joint beside the links' [kg m^2, kg], (n,).
        friction: greatest size of everything else up to the joint's velocity limit [N m, N], (n,).
    """

    robot: Robot
    parameters: FloatArray
    rotor_inertia: FloatArray
    friction: FloatArray

    @staticmethod
    def from_urdf(robot: Robot) -> TorquePrior:
        """Take the URDF's inertias; rotors and friction, of which they tell nothing, are left to the torque share."""
        parameters = np.broadcast_to(robot.multibody.parameters, (robot.n, 10 * robot.n))
        return TorquePrior(robot, parameters, np.zeros(robot.n), np.zeros(robot.n))

    @staticmethod
    def from_model(model: CurrentModel) -> TorquePrior:
        """Take an identified model; all but its links and rotors count with the largest size they have.

        Raises:
            InputError: the model is in units of current, so that its torques do not compare with the robot's limits.
        """
        robot = model.robot
        if model.force_unit != NEWTON_METRE:
            what = f"the model's torques are in {model.force_unit}, the robot's limits in N m"
            raise InputError(what, "prior model", "give [drive] gain in the card and identify again, or give no model")
        rng = np.random.default_rng(SEED)
        lower, upper = MotionLimits.of(robot, Shares(position=1.0)).span
        q = rng.uniform(lower, upper, (STATES, robot.n))
        dq = rng.choice([-1.0, 1.0], q.shape) * np.linspace(0.0, 1.0, STATES)[:, None] * robot.limits.velocity
        states = Motion(np.arange(float(STATES)), q, dq, np.zeros_like(q))
        friction = np.abs(model.friction(states)).max(axis=0)
        return TorquePrior(robot, model.link_parameters, model.rotor_inertia, friction)

    def torque(self, motion: Motion) -> FloatArray:
        """Torque (N, n) of links and rotors."""
        links = self.robot.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, np.array(self.parameters))
        return links + self.rotor_inertia * self.robot.motors(motion).ddq

    def room(self, limits: MotionLimits) -> FloatArray:
        """Return the torque that friction leaves for links and rotors, (n,).

        Raises:
            InputError: friction alone takes all of it.
        """
        room = limits.torque - self.friction
        short = np.flatnonzero(room <= 0) + 1
        if len(short):
            what = f"friction alone takes all torque of joint {', '.join(map(str, short))}"
            raise InputError(what, "torque limit", "raise the torque share or lower the velocity share")
        return room

    def symbolic(self, q: ca.SX, dq: ca.SX, ddq: ca.SX) -> ca.SX:
        """Torque (n, 1) of links and rotors as an expression."""
        body, coupling = self.robot.multibody, self.robot.coupling
        rotors = ca.DM(self.rotor_inertia) * motor_motion(coupling, ddq)
        if np.all(self.parameters == self.parameters[0]):
            links = inverse_dynamics(body.tree, body.gravity, np.array(self.parameters[0]), q, dq, ddq)
            return motor_forces(coupling, links) + rotors
        rows = motor_forces(coupling, regressor(body.tree, body.gravity, q, dq, ddq))
        return ca.sum2(rows * ca.DM(self.parameters)) + rotors
