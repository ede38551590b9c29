"""Electrical family: what the drive adds to the current it reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True)
class CurrentOffset(Effect):
    """A constant added to the current: sensor bias, or a constant force at the joint."""

    name = "current-offset"
    family = "electrical"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the offset."""
        return (Coefficient("offset", "{current}"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return ones."""
        return np.ones((len(context.motion.t), 1))
