"""The wrench at the tool from external joint torques."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.robot import Robot

Frame = Literal["base", "tool"]


@dataclass(frozen=True, eq=False)
class WrenchEstimate:
    """A wrench and how far to trust it.

    Attributes:
        wrench: fx fy fz [N], mx my mz [N m] at the tool's origin, in the axes asked for, (6,).
        condition: greatest over smallest singular value of the scaled Jacobian.
        near_singular: whether some direction of the wrench hardly shows in the torques.
        blind: unit wrenches that do not show, rows (k, 6), forces and moments scaled by the estimator's length: what
            the wrench has along them is not known and is given as nought or too small.
    """

    wrench: FloatArray
    condition: float
    near_singular: bool
    blind: FloatArray


class WrenchEstimator:
    """Solves J^T w = tau with damping where the pose is near singular (Nakamura and Hanafusa 1986).

    Moments are measured in units of ``length`` times force, so that singular values compare. The damping grows from
    nought as a singular value falls below ``threshold``; an arm of fewer than six joints is blind in some directions
    at every pose.

    Args:
        robot: the robot.
        frame: the frame at whose origin the wrench acts, by default the tool.
        axes: whether the wrench is given along the base's axes or the frame's own.
        threshold: singular value [m] below which a direction counts as nearly blind.
        length: moments count as much as the same number of newtons at this arm [m].

    Raises:
        InputError: threshold or length is not positive, or no frame has that name.
    """

    def __init__(
        self,
        robot: Robot,
        frame: str | None = None,
        axes: Frame = "base",
        threshold: float = 0.02,
        length: float = 0.2,
    ) -> None:
        if not (threshold > 0.0 and length > 0.0):
            what = f"threshold of {threshold} and length of {length}"
            raise InputError(what, "wrench", "give numbers above 0")
        robot.multibody.frame_pose(np.zeros(robot.n), frame)  # refuses unknown names
        self.robot, self.frame, self.axes, self.threshold, self.length = robot, frame, axes, threshold, length

    def estimate(self, q: FloatArray, torque: FloatArray) -> WrenchEstimate:
        """Estimate the wrench from external joint torques [N m], positive along +q, at a pose; both (n,)."""
        jacobian = self.robot.multibody.frame_jacobian(q, self.frame)
        if self.axes == "tool":
            rotation, _ = self.robot.multibody.frame_pose(q, self.frame)
            jacobian = np.concatenate([rotation.T @ jacobian[:3], rotation.T @ jacobian[3:]])
        scale = np.array([1.0] * 3 + [1.0 / self.length] * 3)
        # a moment in units of force at the arm: w = wrench * scale, torque = (J / scale)^T w
        u, s, vt = np.linalg.svd(jacobian / scale[:, None])
        strength = np.concatenate([s, np.zeros(6 - len(s))])
        short = np.maximum(1.0 - (s / self.threshold) ** 2, 0.0)
        inverse = s / (s * s + short * self.threshold**2)
        wrench = (u[:, : len(s)] @ (inverse * (vt[: len(s)] @ torque))) / scale
        blind = u[:, strength < self.threshold].T
        condition = float(strength[0] / strength[-1]) if strength[-1] > 0.0 else float("inf")
        return WrenchEstimate(wrench, condition, bool(len(blind)), blind)
