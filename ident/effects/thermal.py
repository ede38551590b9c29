"""Friction family, slow part: friction that changes as the joint warms up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.direction import DirectedEffect
from ident.effects.elapsed import elapsed
from ident.effects.survey import Survey

if TYPE_CHECKING:
    from ident.robot import Robot

Heat = TypeVar("Heat", float, FloatArray)

COVERED = 0.9
"""Share of the time that logs must cover for no joint to have cooled down between two."""


@dataclass(frozen=True)
class ThermalFriction(DirectedEffect):
    """Friction that changes while the grease warms up (Bittencourt and Gunnarsson 2012).

    The joint's heat follows the power that its dry and viscous friction dissipate, with one time constant, or a steady
    one, or some of both: drives warm up whatever the joint does. The first log starts cold, or each; before any later
    segment the joint is taken to have moved as usual for its share of the time since, or to have cooled down.
    Dry and viscous friction change with the heat, ever less as it grows: viscosity falls exponentially.

    Attributes:
        pace: mean speed [rad/s or m/s] of the joint, which brings the heat to one.
        friction: friction at that speed in force units, against which the share is reported.
        viscous: share of it that is viscous.
        since: time stamp [s] at which the joint was cold.
        begins: time stamp [s] at which each log begins, where it was so in each instead.
        logged: share of the time since then that logs cover; nought where each segment starts cold.
        steady: whether the power is, moved or not.
        mixed: whether a share of it is, which is searched for.
        warm: whether the friction that it changes is that of a warm joint, with a heat of one, as a model may have it
            that is held against logs which start cold.
    """

    pace: float = 1.0
    friction: float = 1.0
    viscous: float = 0.0
    since: float = 0.0
    begins: tuple[float, ...] = ()
    logged: float = 0.0
    steady: bool = False
    mixed: bool = False
    warm: bool = False

    name = "thermal-friction"
    family = "friction"
    rivals = ("sensor-drift",)
    excitation = "several minutes of steady motion in both directions from a cold start"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it with the joint's own pace and friction, and with a power that is steady."""
        if joint is None:
            return []
        figures = (float(figure[joint]) for figure in (survey.pace, survey.friction, survey.viscous))
        own = replace(cls.seen(survey, joint, *figures, survey.since), logged=survey.logged)
        forms = [own, replace(own, logged=1.0, steady=True)]
        forms += [replace(form, warm=True) for form in forms if survey.held]
        if survey.begins:
            return [*forms, *(replace(form, begins=survey.begins) for form in forms)]
        return [*forms, *(replace(form, logged=0.0) for form in forms if survey.logged < COVERED)]

    @property
    def remembers(self) -> bool:
        """Heat, too."""
        return True

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return that with a power of which a share is steady."""
        return [] if self.steady else [replace(self, mixed=True)]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the time constant, how fast the change wanes with heat and, of a mixed power, the steady share."""
        seconds = Shape("seconds", "s", 12.0, 5000.0, (120.0, 25.0, 50.0, 400.0, 1500.0), ends=(True, False))
        waning = Shape("waning", "1", 0.05, 6.0, (0.5, 2.5), ends=(False, False))
        standing = Shape("standing", "1", 0.0, 1.0, (0.5,), log=False, ends=(False, False))
        return (seconds, waning, standing) if self.mixed else (seconds, waning)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return what dry and viscous friction gain at a heat of one."""
        return (Coefficient("force", "{current}"), Coefficient("damping", "{current} s/{angle}"))

    def start(self) -> FloatArray:
        """Return the heat and the time of the last sample, not known before the first, and what its direction asks."""
        return np.concatenate([[0.0, np.nan], super().start()])

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return (1 - exp(-waning heat)) / waning, or what that has to the warm joint's, times sign(dq) and dq."""
        velocity = self.velocity(context)
        speed = np.abs(velocity) / max(self.pace, 1e-9)
        standing = float(shape[2]) if self.mixed else float(self.steady)
        power = standing + (1.0 - standing) * speed * (1.0 - self.viscous + self.viscous * speed)
        t = elapsed(np.ascontiguousarray(context.motion.t), self.since, self.begins)
        heat = _heat(t, np.nan_to_num(power), float(shape[0]), self.logged, memory)
        both = np.stack([self.direction(context, memory[2:]), velocity], axis=1)
        waning = float(shape[1])
        return (_change(heat, waning) - (_change(1.0, waning) if self.warm else 0.0))[:, None] * both

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the share of dry and viscous friction at the mean speed that is lost when warm, and the time constant.

        That is when all but 1/e of the change is there: sooner than of the heat, whose first part does most.
        """
        seconds, waning = shape[:2].tolist()
        change = float((coefficients[0] + coefficients[1] * self.pace) * _change(1.0, waning))
        heat = -np.log1p(-(1.0 - np.exp(-1.0)) * -np.expm1(-waning)) / waning
        told = {"share": -change / max(abs(self.friction), 1e-12), "seconds": float(-seconds * np.log1p(-heat))}
        return {**told, "standing": float(shape[2])} if self.mixed else {**told}


def _change(heat: Heat, waning: float) -> Heat:
    """Change of friction over that per heat near nought."""
    changed: Heat = -np.expm1(-waning * heat) / waning
    return changed


@compiled
def _heat(t: FloatArray, power: FloatArray, seconds: float, logged: float, memory: FloatArray) -> FloatArray:
    out = np.empty(len(t))
    heat, last = memory[0], memory[1]
    for k in range(len(t)):
        if np.isnan(last):
            heat = -logged * np.expm1(-max(t[k], 0.0) / seconds)
        else:
            heat += (1.0 - np.exp(-(t[k] - last) / seconds)) * (power[k] - heat)
        last = t[k]
        out[k] = heat
    memory[0], memory[1] = heat, last
    return out
