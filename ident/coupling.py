"""Gears that couple joints: how motors move as joints do, and what force of the motors is which of the joints."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ident.arrays import FloatArray
from ident.signals import Motion


class Coupling:
    """Motors of which some turn as several joints move, as in wrists whose gears pass through one another.

    Motor speeds are C dq and, since power is the same on both sides, forces of the joints C^T those of the motors. A
    motor's angle is told in those of its own joint, so that only the ratios of a row count: the gear ratio may be in it
    or not.

    Args:
        motor_speeds: motor speeds per joint speed, (n, n), not singular.

    Attributes:
        matrix: C, with ones on the diagonal, (n, n); a row whose motor its own joint does not turn is as it was given.
    """

    def __init__(self, motor_speeds: FloatArray) -> None:
        own = np.diagonal(motor_speeds)
        self.matrix: FloatArray = motor_speeds / np.where(own != 0.0, own, 1.0)[:, None]

    @cached_property
    def joints(self) -> FloatArray:
        """Joint speeds per motor speed, (n, n)."""
        return np.asarray(np.linalg.inv(self.matrix))

    @cached_property
    def mixed(self) -> list[int]:
        """Motors, from 0, that bear forces of other joints than their own."""
        off = self.joints - np.diag(np.diagonal(self.joints))
        return [int(j) for j in np.flatnonzero(np.any(off != 0.0, axis=0))]

    def motors(self, motion: Motion) -> Motion:
        """Return the motion of the motors.

        Args:
            motion: of the joints.
        """
        return Motion(motion.t, *map(self.motor_motion, (motion.q, motion.dq, motion.ddq)))

    def motor_motion(self, joint_motion: FloatArray) -> FloatArray:
        """Return positions, velocities or accelerations (..., n) of the motors by those (..., n) of the joints."""
        return np.asarray(joint_motion @ self.matrix.T)

    def motor_force(self, joint_force: FloatArray) -> FloatArray:
        """Return the motors' forces (..., n) that a force (..., n) of the joints asks of them."""
        return np.asarray(joint_force @ self.joints)

    def joint_force(self, motor_force: FloatArray) -> FloatArray:
        """Return the joints' forces (..., n) of forces (..., n) of the motors."""
        return np.asarray(motor_force @ self.matrix)
