"""The parameters of a fit as a list: name, value, interval, and whether the data determine it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.effects.base import Coefficient, Effect, Shape
from ident.effects.rigid_body import Links
from ident.fit import Fit

HALF_WIDTH = 1.96
"""Half-width of a 95 % interval in standard deviations."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a model.

    Attributes:
        name: ``effect.joint.parameter``; links' parameters have the name of the base parameter.
        value, std: estimate and standard deviation; NaN for a std that the data do not give.
        unit: written out.
        joint: joint it belongs to, from 0; None for parameters that joints share.
        meaning: which physical parameters a base parameter combines; empty for others.
        determined: False where no row depends on it, or only together with others.
    """

    name: str
    value: float
    std: float
    unit: str
    joint: int | None
    meaning: str
    determined: bool

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval."""
        return self.value - HALF_WIDTH * self.std, self.value + HALF_WIDTH * self.std

    def as_dict(self) -> dict[str, Any]:
        """Fields as result.json holds them."""
        return {
            "name": self.name,
            "value": self.value,
            "std": self.std,
            "unit": self.unit,
            "joint": None if self.joint is None else self.joint + 1,
            "interval": list(self.interval),
            "determined": self.determined,
            **({"meaning": self.meaning} if self.meaning else {}),
        }


def list_parameters(fit: Fit) -> list[Parameter]:
    """List a fit's parameters: links first, then joint by joint; shapes after the coefficients they belong to.

    Args:
        fit: of a model, with its covariances.
    """
    listed = []
    for k, term in enumerate(fit.model.terms):
        effect = term.effect
        determined = fit.solution.determined[fit.design.columns_of_term(k)]
        meanings = effect.base(fit.model.robot).combinations if isinstance(effect, Links) else None
        for number, coefficient in enumerate(effect.coefficients(fit.model.robot)):
            listed.append(
                Parameter(
                    _name(effect, coefficient),
                    float(term.coefficients[number]),
                    float(term.std[number]),
                    fit.model.unit_of(effect, coefficient),
                    effect.joint,
                    meanings[number] if meanings is not None else "",
                    bool(determined[number]),
                )
            )
        for shape, value, std in zip(effect.shapes, term.shape.tolist(), term.shape_std.tolist(), strict=True):
            unit = fit.model.unit_of(effect, shape)
            known = bool(np.isfinite(std))
            listed.append(Parameter(_name(effect, shape), value, std, unit, effect.joint, "", known))
    return sorted(listed, key=lambda p: (p.joint is not None, p.joint or 0))


def _name(effect: Effect, parameter: Coefficient | Shape) -> str:
    if isinstance(effect, Links):
        return parameter.name if effect.joint is None else f"row{effect.joint + 1}.{parameter.name}"
    return f"{effect.name}.{'all' if effect.joint is None else effect.joint + 1}.{parameter.name}"
