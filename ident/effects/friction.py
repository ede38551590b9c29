"""Friction family: dry and viscous, by load and by position, with no memory but that of the last turn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.direction import DirectedEffect, VelocityEffect
from ident.effects.survey import Survey

if TYPE_CHECKING:
    from ident.robot import Robot

MOST_SWINGS = 24.0
"""Swings of friction a turn (a metre) at most; more are teeth."""

MOST_WAVES = 12
"""Half waves over a joint's range by which its friction is told, where that does not swing: spots of a tenth of it."""


@dataclass(frozen=True)
class Coulomb(DirectedEffect):
    """Dry friction of constant size against the motion."""

    name = "coulomb"
    family = "friction"
    rivals = ("sigmoid", "maxwell-slip", "stribeck")
    excitation = "motion in both directions"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the friction force."""
        return (Coefficient("force", "{current}"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the direction of motion."""
        return self.direction(context, memory)[:, None]


@dataclass(frozen=True)
class Viscous(VelocityEffect):
    """Friction proportional to velocity."""

    name = "viscous"
    family = "friction"
    rivals = ("viscous-nonlinear", "filter-lag")
    excitation = "plateaus of several constant speeds"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the damping."""
        return (Coefficient("damping", "{current} s/{angle}"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the velocity."""
        return self.velocity(context)[:, None]


@dataclass(frozen=True)
class CoulombAsymmetry(DirectedEffect):
    """Dry friction that differs between the two directions: the part that does not change sign with velocity."""

    name = "coulomb-asymmetry"
    family = "friction"
    rivals = ("current-offset",)
    contains = ("current-offset",)
    excitation = "motion and rest: slow torque ramps from standstill"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return half the difference of friction between motion in + and in - direction."""
        return (Coefficient("force", "{current}"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return one while the joint moves, nought at rest."""
        return np.abs(self.direction(context, memory))[:, None]


@dataclass(frozen=True)
class LoadFriction(DirectedEffect):
    """Dry friction that grows with the torque that the gear transmits (Hamon et al. 2010; Wahrburg et al. 2018).

    Gears lose another share of it where the load drives the motor (Dohring et al. 1993).

    Attributes:
        per_newton_metre: force units per N m, of one whose load is that of the URDF's bodies; nought where it is that
            of the model's links.
        driven: whether that share is its own.
    """

    per_newton_metre: float = 0.0
    driven: bool = False

    name = "load-friction"
    family = "friction"
    rivals = ("torque-saturation", "position-friction")
    excitation = "the same pose and torque crossed at +dq and at -dq, under different loads"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it with links as fitted, and as the URDF has them: without it in the model, it has bent those fitted."""
        if joint is None:
            return []
        return [cls.seen(survey, joint, load) for load in (0.0, float(survey.load_ratio[joint]))]

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return that which loses a share of its own where the load drives the motor."""
        return [] if self.driven else [replace(self, driven=True)]

    @property
    def needs(self) -> tuple[str, ...]:
        """The load, unless it is that of the URDF's bodies."""
        return () if self.per_newton_metre else ("load",)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the friction per unit of load, a pure number, never negative; and where the load drives."""
        return tuple(Coefficient(name, "1", lower=0.0) for name in ("force", "driven")[: 1 + self.driven])

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sign(dq) |load|, or two: that where the motor drives, and where the load does."""
        per = self.per_newton_metre
        load = (per * context.bodies_load if per else context.needed("load", self.name))[:, self.at]
        direction, size = self.direction(context, memory), np.abs(load)
        if not self.driven:
            return (direction * size)[:, None]
        return 0.5 * direction[:, None] * np.stack([size + direction * load, size - direction * load], axis=1)


@dataclass(frozen=True)
class PositionFriction(DirectedEffect):
    """Dry friction that swings with the joint's angle: eccentric bearings, worn teeth, a seal that is out of round.

    A swing's second harmonic stands for what is no sine, such as a spot that rubs; several spots are told by half
    waves over the range instead. Friction that repeats with the turn of a gear stage has been measured on industrial
    robots (Simoni et al. 2019).

    Attributes:
        fewest: fewest swings a turn (a metre).
        harmonics: of the swing, one or two; of half waves, how many.
        turn: what counts as one: a turn [rad], or a metre.
        span: range [rad or m] of half waves; nought for a swing.
        middle: its middle [rad or m], beyond the ends of which friction is as at them.
    """

    fewest: float = 0.3
    harmonics: int = 2
    turn: float = 2.0 * np.pi
    span: float = 0.0
    middle: float = 0.0

    name = "position-friction"
    family = "friction"
    contains = ("coulomb",)
    rivals = ("load-friction", "gear-ripple")
    excitation = "the same angles crossed in both directions, over most of the range"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it with a quarter of a swing and more over the range seen: less is a difference of large forces."""
        if joint is None:
            return []
        turn = 1.0 if survey.robot.multibody.prismatic[joint] else cls.turn
        fewest = float(np.clip(0.25 * turn / max(float(survey.reach[joint]), 1e-3), cls.fewest, 0.25 * MOST_SWINGS))
        return [cls.seen(survey, joint, fewest, harmonics, turn) for harmonics in (1, 2)]

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return half waves over the range seen, for what is no swing."""
        reach, middle = float(survey.reach[self.at]), float(survey.middle[self.at])
        waves = min(MOST_WAVES, int(2.0 * MOST_SWINGS * reach / self.turn))
        if self.span > 0.0 or self.harmonics < 2 or waves <= 2 * self.harmonics:
            return []
        return [replace(self, harmonics=waves, span=reach, middle=middle)]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the swings a turn (a metre) of the joint; half waves have none."""
        if self.span > 0.0:
            return ()
        starts = [x for x in (1.0, 0.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 18.0, 21.0) if x > self.fewest]
        # Of less than a swing the logs show a slope, and of that any slow swing is as good.
        return (Shape("per_turn", "1", self.fewest, MOST_SWINGS, tuple(starts), log=False, ends=(False, True)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the swing in and out of phase with the joint's zero and that of its second harmonic, or half waves."""
        if self.span > 0.0:
            return tuple(Coefficient(f"force_{k}", "{current}") for k in range(1, self.harmonics + 1))
        names = ("force_cos", "force_sin", "force_cos2", "force_sin2")
        return tuple(Coefficient(name, "{current}") for name in names[: 2 * self.harmonics])

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sign(dq) times cosine and sine of once (and twice) per_turn times the angle, or of half waves."""
        if self.span > 0.0:
            return self.direction(context, memory)[:, None] * self._half_waves(context.motors.q[:, self.at])
        phase = 2.0 * np.pi / self.turn * shape[0] * context.motors.q[:, self.at]
        phases = [k * phase for k in range(1, self.harmonics + 1)]
        waves = np.stack([wave(phase) for phase in phases for wave in (np.cos, np.sin)], axis=1)
        swing: FloatArray = self.direction(context, memory)[:, None] * waves
        return swing

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the size of the swing, of its second harmonic, its phase and its repeats.

        Of half waves half of that between least and most friction, and where that is [rad or m].
        """
        if self.span > 0.0:
            angles = self.middle + self.span * np.linspace(-0.5, 0.5, 20 * self.harmonics)
            level = self._half_waves(angles) @ coefficients
            most, least = float(angles[np.argmax(level)]), float(angles[np.argmin(level)])
            return {"force": 0.5 * float(np.ptp(level)), "most_at": most, "least_at": least}
        force, phase = float(np.hypot(*coefficients[:2])), float(np.arctan2(coefficients[1], coefficients[0]))
        second = float(np.linalg.norm(coefficients[2:]))
        return {"force": force, "second_harmonic": second, "per_turn": float(shape[0]), "phase": phase}

    def _half_waves(self, angle: FloatArray) -> FloatArray:
        """Cosines (N, harmonics) of 1, 2, ... half turns over the range."""
        along = np.clip((angle - self.middle) / self.span + 0.5, 0.0, 1.0)
        return np.asarray(np.cos(np.pi * along[:, None] * np.arange(1, self.harmonics + 1)))
