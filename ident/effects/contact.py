"""Contact family: touch, which no motion predicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect
from ident.effects.survey import Survey

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True)
class Contact(Effect):
    """Someone or something touches the arm (Haddadin, De Luca and Albu-Schaeffer 2017).

    No function of the motion: episodes of it are found in the residual and taken out of the rows, and it adds nothing
    to a model.
    """

    name = "contact"
    family = "contact"
    rivals = ()
    excitation = "none: episodes that stand out from the residual of the same motion without a touch"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Not tried as a term of a model."""
        return []

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return none."""
        return ()

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return no column."""
        return np.zeros((len(context.motion.t), 0))
