"""Hysteresis family: friction that remembers how the joint came to where it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True)
class MaxwellSlip(Effect):
    """Springs in parallel, each slipping at its own displacement (the paper's Eq. 1 and 2; Lampaert et al. 2002).

    At rest the elements keep the force they stopped with. Before a segment's first motion their state is unknown and
    taken as relaxed.

    Attributes:
        spread: saturation displacements of the elements as multiples of the shape parameter ``slip``.
    """

    spread: tuple[float, ...] = (0.25, 1.0, 4.0)

    name = "maxwell-slip"
    family = "hysteresis"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the saturation displacement of the middle element."""
        return (Shape("slip", "{angle}", 1e-4, 2e-2, (1e-3, 2.5e-4, 4e-3)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the saturation force of each element, never negative."""
        if len(self.spread) == 1:
            return (Coefficient("force", "{current}", lower=0.0),)
        return tuple(Coefficient(f"force_{k + 1}", "{current}", lower=0.0) for k in range(len(self.spread)))

    def start(self) -> FloatArray:
        """Return the elements' positions: not known before the first sample."""
        return np.full(len(self.spread), np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return each element's force over its saturation force."""
        slip = shape[0] * np.array(self.spread)
        position = np.ascontiguousarray(context.motion.q[:, self.at])
        forces: FloatArray = _slip_forces(position, slip, memory)
        return forces


@compiled
def _slip_forces(z: FloatArray, slip: FloatArray, position: FloatArray) -> FloatArray:
    out = np.empty((len(z), len(slip)))
    for k in range(len(slip)):
        zeta = position[k]
        for t in range(len(z)):
            if np.isnan(zeta):
                zeta = z[t]
            stretch = z[t] - zeta
            if stretch >= slip[k]:
                zeta, stretch = z[t] - slip[k], slip[k]
            elif stretch <= -slip[k]:
                zeta, stretch = z[t] + slip[k], -slip[k]
            out[t, k] = stretch / slip[k]
        position[k] = zeta
    return out
