"""The deadzone that keeps a compliant arm still while nobody pushes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError

VS060_CURRENT = (6.0, 6.0, 6.0, 9.0, 11.0, 11.0)
"""Boundaries of the VS060's joints [%Use], Table III of the paper."""

VS060_TORQUE = (4.26, 4.86, 2.42, 1.01, 1.58, 0.84)
"""The torques they stand for [N m], measured there with external devices."""

BAND = 0.5
"""Width of the transition as a share of the boundary, unless told otherwise."""


@dataclass(frozen=True, eq=False)
class Deadzone:
    """Gives nought inside its boundary and the signal itself outside, with a straight line between.

    Attributes:
        boundary: of each signal, in its unit, (n,).
        band: width of the straight line, centred on the boundary, (n,), at most twice the boundary.

    Raises:
        InputError: a boundary or a band is negative, or a band is wider than twice its boundary.
    """

    boundary: FloatArray
    band: FloatArray

    def __post_init__(self) -> None:
        for name in ("boundary", "band"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
        fits = self.boundary.shape == self.band.shape
        if not fits or np.any(self.boundary < 0.0) or np.any(self.band < 0.0) or np.any(self.band > 2 * self.boundary):
            what = f"boundary {self.boundary} with band {self.band}"
            raise InputError(what, "deadzone", "give one boundary a joint and bands from 0 to twice the boundary")

    @staticmethod
    def of(boundary: FloatArray | tuple[float, ...], share: float = BAND) -> Deadzone:
        """Return a deadzone whose band is a share of its boundary."""
        at = np.asarray(boundary, dtype=np.float64)
        return Deadzone(at, share * at)

    @staticmethod
    def vs060() -> Deadzone:
        """Return the paper's deadzone for residual currents of the VS060 [%Use]."""
        return Deadzone.of(VS060_CURRENT)

    def apply(self, signal: FloatArray) -> FloatArray:
        """Return the signal (..., n) with what is within the deadzone taken away."""
        size, start, end = np.abs(signal), self.boundary - 0.5 * self.band, self.boundary + 0.5 * self.band
        width = np.where(self.band > 0.0, self.band, 1.0)
        ramp = np.where(self.band > 0.0, end * (size - start) / width, 0.0)
        passed: FloatArray = np.sign(signal) * np.where(size > end, size, np.where(size > start, ramp, 0.0))
        return passed
