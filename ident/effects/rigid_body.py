"""Rigid-body family: the links and the rotors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.survey import Survey

if TYPE_CHECKING:
    from ident.base_parameters import BaseParameters
    from ident.robot import Robot

NEUTRAL = (0.0, -0.5, 0.5, -1.0, 1.0, -1.75, 1.75, -2.5, 2.5)
"""Angles [rad or m] from which that is searched at which cables hang free."""

OFF_MIDDLE = (-0.6, -0.3, 0.0, 0.3, 0.6)
"""How far off the middle of the positions seen slack cables may hang free, in halves of their range, and the starts."""

ONE_SIDE = 0.5
"""The same of those that pull on one side, by this: what is met farther from the middle may be a stop."""

MOMENT_UNITS = {"m": "kg", "mx": "kg m", "my": "kg m", "mz": "kg m"}


@dataclass(frozen=True)
class Links(Effect):
    """Inertia, Coriolis and gravity of the links, linear in their base parameters (Gautier 1991).

    For the whole robot (``joint`` None) all rows share one set of base parameters, in SI units when the drive gains
    are known. For one joint the row has base parameters of its own, in SI units per unit of the unknown gain.
    """

    name = "links"
    family = "rigid-body"

    def base(self, robot: Robot) -> BaseParameters:
        """Base parameters of the whole robot, or of the joint's row."""
        return robot.rigid_body.base_parameters(self.joint)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return one coefficient a base parameter."""
        per_gain = "" if self.joint is None else " {current}/(N m)"
        return tuple(
            Coefficient(name, MOMENT_UNITS.get(name.rstrip("0123456789"), "kg m^2") + per_gain)
            for name in self.base(robot).names
        )

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the link regressor's base columns, in N m per unit of the base parameters."""
        if self.joint is not None:
            return self.row(context, shape, memory, self.joint)
        return context.link_regressor[:, :, self.base(context.robot).columns]

    def row(self, context: Context, shape: FloatArray, memory: FloatArray, joint: int) -> FloatArray:
        """Return one joint's row of the link regressor's base columns."""
        return context.link_regressor[:, joint, self.base(context.robot).columns]


@dataclass(frozen=True)
class RotorInertia(Effect):
    """Inertia of the motor's rotor and gear, seen at the joint: current proportional to the joint's acceleration."""

    name = "rotor-inertia"
    family = "rigid-body"
    rivals = ("delay", "filter-lag", "elasticity")
    excitation = "accelerations at several frequencies, the other joints in several poses"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the reflected inertia."""
        return (Coefficient("inertia", "{current} s^2/{angle}"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the acceleration of the joint's motor."""
        return context.motors.ddq[:, self.at, None]


@dataclass(frozen=True)
class CableSpring(Effect):
    """Cables and hoses that pull a joint to where they hang free, stiffening away from there or once they are taut.

    Attributes:
        slack: whether they pull more once they are taut, on both sides of where they hang free; before, hardly or less.
        middle: middle of the positions seen [rad or m], of one that does so or on one side.
        half: half of their range.
        side: 1 or -1 of a hose that is drawn taut towards that side alone, over much of the way: a stop is at its end.
    """

    slack: bool = False
    middle: float = 0.0
    half: float = 1.0
    side: int = 0

    name = "cable-spring"
    family = "rigid-body"
    kind = "spring"
    leads = True  # what grows with the cube alone is met, as a stop is
    rivals = ("gravity-balancer", "gear-ripple")
    excitation = "the joint's whole range, with the other joints in several poses"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it stiffening, slack within the positions seen, and drawn taut towards either side."""
        if joint is None:
            return []
        middle, half = float(survey.middle[joint]), 0.5 * float(survey.reach[joint])
        within = [cls(joint, not side, middle, half, side) for side in (0, 1, -1)] if half > 0.0 else []
        return [cls(joint), *within]

    @property
    def stiffens(self) -> bool:
        """Whether it stiffens away from where it hangs free, and is slack nowhere."""
        return not self.slack and self.side == 0

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the angle at which the cables hang free, which a stiffness alone does not tell from an offset.

        Of slack ones also where they are taut, as a share of the way from there to the nearer end of the positions, and
        over which share of half the range they get so; of those taut on one side where that begins, and over which.
        """
        if self.stiffens:
            return (Shape("neutral", "{angle}", -4.0, 4.0, NEUTRAL, log=False, ends=(False, False)),)
        off = OFF_MIDDLE if self.slack else tuple(ONE_SIDE * share for share in OFF_MIDDLE)
        near, *starts, far = (self.middle + share * self.half for share in off)
        neutral = Shape("neutral", "{angle}", near, far, tuple(starts), log=False)
        if self.side:
            return (neutral, Shape("softness", "1", 0.02, 1.5, (0.1, 0.4), ends=(False, False)))
        taut = Shape("taut", "1", 0.05, 0.9, (0.3, 0.6), log=False, ends=(False, True))
        return (neutral, taut, Shape("softness", "1", 0.01, 0.4, (0.1,), ends=(False, False)))

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the stiffness and its growth with the angle's square, or what it is while slack; none is a push."""
        stiffness = Coefficient("stiffness", "{current}/{angle}", lower=0.0)
        growth = Coefficient("stiffening", "{current}/{angle}^3", lower=0.0)
        if self.slack:
            more = Coefficient("tautening", "{current}/{angle}", lower=0.0)
            return (more, Coefficient("slack_stiffness", "{current}/{angle}", lower=0.0))
        return (stiffness, growth) if self.stiffens else (stiffness,)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the angle from neutral and its cube, or beyond the slack and itself, or, little by little, taut."""
        angle = context.motion.q[:, self.at] - shape[0]
        if self.side:
            return self.side * _beyond(self.side * angle, shape[1] * self.half)[:, None]
        if self.slack:
            slack, over = self._slack(shape), shape[2] * self.half
            return np.stack([_beyond(angle - slack, over) - _beyond(-angle - slack, over), angle], axis=1)
        return np.stack([angle, angle**3], axis=1)

    def _slack(self, shape: FloatArray) -> float:
        """How far from neutral the cables are taut."""
        return float(shape[1] * (self.half - abs(shape[0] - self.middle)))

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the neutral angle."""
        if not self.stiffens:
            return super().gradient(context, shape)
        angle = context.motion.q[:, self.at] - shape[0]
        return np.stack([-np.ones_like(angle), -3.0 * angle**2], axis=1)[None]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return neutral angle, stiffness, and growth, or slack and stiffness there, or the angle it is taut over."""
        if self.stiffens:
            return super().summary(robot, shape, coefficients)
        told: dict[str, float | list[float]] = {"neutral": float(shape[0]), "stiffness": float(coefficients.sum())}
        if self.side:
            return told | {"over": float(shape[1] * self.half)}
        return told | {"slack": self._slack(shape), "slack_stiffness": float(coefficients[1])}


def _beyond(angle: FloatArray, over: float) -> FloatArray:
    """How far angles (N,) are beyond nought, little by little over another."""
    reached = angle / over
    # Not logaddexp, which warns of positions that are not known.
    beyond: FloatArray = over * (np.maximum(reached, 0.0) + np.log1p(np.exp(-np.abs(reached))))
    return beyond
