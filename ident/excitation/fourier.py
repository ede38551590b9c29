"""Finite Fourier series that start and end at rest: the family of motions among which excitation is designed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, null_space

from ident.arrays import FloatArray
from ident.signals import Motion


@dataclass(frozen=True)
class FourierFamily:
    """Periodic motions ``q_j = mean + sum_l a_l sin(l w t) + b_l cos(l w t)`` with velocity and acceleration zero at 0.

    Swevers et al. (1997), with the coefficients of each joint confined to those that rest where the period begins and
    ends: ``sum l a_l = 0`` and ``sum l^2 b_l = 0``. What remains are the mean and ``2 harmonics - 2`` free numbers.

    Attributes:
        joints: number of joints.
        period: length of the motion [s].
        harmonics: number of harmonics; at least 2, so that a joint can move at all.
    """

    joints: int
    period: float
    harmonics: int

    @property
    def size(self) -> int:
        """Free coefficients a joint; the first is the mean position."""
        return 2 * self.harmonics - 1

    @property
    def frequencies(self) -> FloatArray:
        """Angular frequencies of the harmonics [rad/s], (harmonics,)."""
        return 2.0 * np.pi / self.period * np.arange(1.0, self.harmonics + 1)

    @cached_property
    def free(self) -> FloatArray:
        """Orthonormal columns that map free coefficients to (mean, a_1.., b_1..), (1 + 2 harmonics, size)."""
        order = np.arange(1.0, self.harmonics + 1)
        return block_diag(1.0, null_space(order[None]), null_space(order[None] ** 2))  # type: ignore[no-any-return]

    def basis(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values, first and second time derivatives of the free functions at times t (N,), each (N, size)."""
        w = self.frequencies
        angle = np.outer(t, w)
        sine, cosine = np.sin(angle), np.cos(angle)
        one, none = np.ones((len(t), 1)), np.zeros((len(t), 1))
        return (
            np.hstack([one, sine, cosine]) @ self.free,
            np.hstack([none, w * cosine, -w * sine]) @ self.free,
            np.hstack([none, -(w**2) * sine, -(w**2) * cosine]) @ self.free,
        )

    def times(self, count: int) -> FloatArray:
        """``count`` instants spread evenly over the period, its end left out."""
        return np.arange(float(count)) * (self.period / count)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One motion of a family: ``coefficients`` (n, size), radians or metres."""

    family: FourierFamily
    coefficients: FloatArray

    def at(self, t: FloatArray) -> Motion:
        """Positions, velocities and accelerations at times t (N,), each (N, n)."""
        q, dq, ddq = (basis @ self.coefficients.T for basis in self.family.basis(t))
        return Motion(np.asarray(t, dtype=float), q, dq, ddq)

    def sample(self, rate: float) -> Motion:
        """Samples at ``rate`` [Hz] from rest to rest; the last one is at the end of the period exactly."""
        steps = max(1, round(self.family.period * rate))
        return self.at(np.linspace(0.0, self.family.period, steps + 1))

    def bound(self, derivative: int) -> FloatArray:
        """Greatest size that a time derivative of q (at least the first) can have at any time, (n,)."""
        terms = self.coefficients @ self.family.free.T
        sine, cosine = terms[:, 1 : 1 + self.family.harmonics], terms[:, 1 + self.family.harmonics :]
        return np.hypot(sine, cosine) @ self.family.frequencies**derivative

    def scaled(self, share: float, about: FloatArray) -> Trajectory:
        """Return the motion drawn together towards a pose ``about`` (n,): all of it at 1, rest at that pose at 0."""
        coefficients = share * self.coefficients
        coefficients[:, 0] += (1.0 - share) * about
        return Trajectory(self.family, coefficients)
