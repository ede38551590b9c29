"""Effects whose size is told where they are largest."""

from __future__ import annotations

from dataclasses import dataclass

from ident.effects.base import Effect
from ident.effects.survey import Survey


@dataclass(frozen=True)
class ToldAtLargest(Effect):
    """An effect of one joint whose size is told at the largest force, where it is largest.

    Attributes:
        largest: largest force that the model gives on the logs, in its force unit.
    """

    largest: float = 1.0

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it against the largest force seen."""
        return [] if joint is None else [cls(joint, float(survey.largest[joint]))]
