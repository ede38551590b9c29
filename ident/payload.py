"""A known load at the end of the robot, as seen by the regression."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect
from ident.errors import InputError
from ident.pseudo_inertia import body_parameters
from ident.robot import Robot
from ident.signals import Motion
from ident.walk import Block

INERTIA = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@dataclass(frozen=True, eq=False)
class Payload:
    """A body fixed to the robot's last link.

    Attributes:
        mass: [kg].
        com: centre of mass in ``frame`` [m], (3,).
        inertia: rotational inertia about the centre of mass in the frame's axes [kg m^2], (3, 3); None where unknown:
            it is then estimated along with the rest.
        frame: a frame of the last link, such as the flange; None for the last joint's own.
    """

    mass: float
    com: tuple[float, float, float]
    inertia: FloatArray | None = None
    frame: str | None = None

    def parameters(self, robot: Robot) -> FloatArray:
        """Parameters (10,) about the last joint's frame, without inertia of its own where that is unknown.

        Raises:
            InputError: the mass is not positive, or the robot has no such frame.
        """
        if not self.mass > 0.0:
            raise InputError(f"a payload of {self.mass:g} kg", "payload", "give its mass in kg")
        body = robot.multibody
        rotation, origin = np.eye(3), np.zeros(3)
        if self.frame is not None:
            still = np.zeros(robot.n)
            of_link, at_link = body.frame_pose(still, body.joint_names[last_joint(robot)])
            of_frame, at_frame = body.frame_pose(still, self.frame)
            rotation, origin = of_link.T @ of_frame, of_link.T @ (at_frame - at_link)
        com = origin + rotation @ np.asarray(self.com, dtype=float)
        inertia = np.zeros((3, 3)) if self.inertia is None else rotation @ np.asarray(self.inertia) @ rotation.T
        matrix = np.empty((4, 4))
        matrix[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia + self.mass * np.outer(com, com)
        matrix[:3, 3] = matrix[3, :3] = self.mass * com
        matrix[3, 3] = self.mass
        return body_parameters(matrix)


@dataclass(frozen=True, eq=False)
class CarryingMotion(Motion):
    """Motion with the payload on the robot."""


def carrying(blocks: Iterable[Block]) -> Iterator[Block]:
    """Yield blocks whose motion is known to be made with the payload.

    Args:
        blocks: of logs, as `ident.walk` yields them.
    """
    for block in blocks:
        m = block.motion
        yield replace(block, motion=CarryingMotion(m.t, m.q, m.dq, m.ddq))


@dataclass(frozen=True)
class KnownLoad(Effect):
    """What a payload of known parameters asks of the joints [N m] where the robot carries it; nought elsewhere.

    Attributes:
        parameters: of the payload about the last joint's frame, (10,).
    """

    parameters: tuple[float, ...] = ()

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the share of the load that is there: one."""
        return (Coefficient("payload", "1"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the joint torques of the payload, (N, n, 1)."""
        if not isinstance(context.motion, CarryingMotion):
            return np.zeros((*context.motion.q.shape, 1))
        torque: FloatArray = _last_link(context) @ np.array(self.parameters)[:, None]
        return torque


@dataclass(frozen=True)
class UnknownInertia(Effect):
    """What the rotational inertia of a payload asks of the joints, per component of it about its centre of mass."""

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the components."""
        return tuple(Coefficient(f"payload {name}", "kg m^2") for name in INERTIA)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the joint torques per component, (N, n, 6)."""
        if not isinstance(context.motion, CarryingMotion):
            return np.zeros((*context.motion.q.shape, 6))
        return _last_link(context)[..., 4:]


def last_joint(robot: Robot) -> int:
    """Joint, from 0, that carries the payload: the end of the chain.

    Args:
        robot: of one chain, or several.
    """
    return int(robot.multibody.tree.order[-1])


def _last_link(context: Context) -> FloatArray:
    first = 10 * last_joint(context.robot)
    return context.link_regressor[:, :, first : first + 10]
