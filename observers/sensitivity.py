"""The smallest contact that thresholds let be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.robot import Robot

DIRECTIONS = 2000
"""Directions of force tried."""


@dataclass(frozen=True, eq=False)
class Detectable:
    """The smallest contact seen at a pose.

    Attributes:
        torque: at each motor, on its joint's side [N m, prismatic N], (n,).
        along_axes: force at the frame along the base's x, y and z [N], (3,); inf where no joint feels it.
        best, worst: force in the direction felt best and worst [N].
        worst_direction: unit vector of the latter, in the base, (3,).
    """

    torque: FloatArray
    along_axes: FloatArray
    best: float
    worst: float
    worst_direction: FloatArray


def smallest_detectable(
    robot: Robot, q: FloatArray, threshold: FloatArray, gain: FloatArray | None = None, frame: str | None = None
) -> Detectable:
    """Return the smallest joint torque and force at a frame that exceed a residual threshold.

    Args:
        robot: the robot.
        q: pose [rad or m], (n,).
        threshold: of the residual current, (n,).
        gain: joint torque per unit of current (n,); by default the robot's.
        frame: where the force acts, by default the tool.

    Raises:
        InputError: the drive gains are unknown, or no frame has that name.
    """
    gain = robot.gain if gain is None else gain
    if gain is None:
        raise InputError("drive gains are unknown", f"robot {robot.name}", "give [drive] gain in the card")
    torque = np.asarray(threshold * np.abs(gain))
    jacobian = robot.multibody.frame_jacobian(q, frame)[:3]
    if robot.coupling is not None:
        jacobian = robot.coupling.motor_force(jacobian)
    around = _sphere(DIRECTIONS)
    with np.errstate(divide="ignore"):
        along = (torque / np.maximum(np.abs(jacobian), 1e-9 * np.abs(jacobian).max())).min(axis=1)
        needed = (torque / np.abs(around @ jacobian)).min(axis=1)
    along[~(np.abs(jacobian).max(axis=1) > 1e-9 * np.abs(jacobian).max())] = np.inf
    worst = int(np.argmax(needed))
    return Detectable(torque, along, float(needed.min()), float(needed[worst]), around[worst])


def _sphere(count: int) -> FloatArray:
    """Directions (count, 3) spread over half a sphere by Fibonacci's spiral: a force and its opposite are alike."""
    k = np.arange(count) + 0.5
    z, turn = k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
