"""Friction family: how friction falls, rises and bends as the joint's speed does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.direction import DirectedEffect, VelocityEffect
from ident.effects.survey import Survey

if TYPE_CHECKING:
    from ident.robot import Robot

SLOWEST_SIGMOID = 0.015
"""Speed [rad/s or m/s] below which a rise of friction is but the smoothing of a sign."""

FALLEN, RISEN, GEARED = 0.5, 0.2, 50.0
"""Speeds [rad/s or m/s] by which friction has fallen, or risen, at most, of a joint with that gear ratio or more."""


POWERS = 1.0, 2.0
"""Powers of the speed in the exponent of Stribeck friction of Tustin (1947) and of Armstrong-Helouvry (1990)."""


@dataclass(frozen=True)
class Stribeck(DirectedEffect):
    """Extra friction at low speed that vanishes as a lubricant film builds up (Armstrong-Helouvry et al. 1994).

    A film takes its time (frictional memory, Hess and Soom 1990): it then follows the speed with a time constant.

    Attributes:
        power: of the speed in the exponent, from 1/2 to 2 by author; None has it searched.
        fastest: greatest Stribeck speed [rad/s or m/s].
        lags: whether the film takes its time, or is there at once.
    """

    power: float | None = 2.0
    fastest: float = FALLEN
    lags: bool = False

    name = "stribeck"
    family = "friction"
    rivals = ("sigmoid", "maxwell-slip", "viscous-nonlinear")
    excitation = "constant speeds of 1 to 50 mrad/s, both ways"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it with any power."""
        return [] if joint is None else [cls.seen(survey, joint, None, FALLEN * _quicker(survey, joint))]

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return that with a film that takes its time."""
        return [] if self.lags else [replace(self, lags=True)]

    def plainer(self) -> list[Effect]:
        """Return those with a given power: slow motion does not tell speed and power apart."""
        return [] if self.power is not None else [replace(self, power=power) for power in POWERS]

    @property
    def remembers(self) -> bool:
        """Whether a film does."""
        return self.lags

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the Stribeck speed, its power if that is searched, and the time constant of a film that lags."""
        speed = Shape("speed", "{angle}/s", 4e-3, self.fastest, _speeds((0.04, 0.01, 0.1), self.fastest))
        power = Shape("power", "1", 0.4, 2.5, POWERS, log=False, ends=(False, False))
        lag = Shape("lag", "s", 5e-3, 0.5, (0.05,), ends=(False, False))
        return (speed, *(() if self.power is not None else (power,)), *((lag,) if self.lags else ()))

    def start(self) -> FloatArray:
        """Return a lagging film's speed and the last time stamp, not known yet, and what its direction asks."""
        return np.concatenate([[0.0, np.nan] if self.lags else [], super().start()])

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return static minus Coulomb friction, never negative."""
        return (Coefficient("force", "{current}", lower=0.0),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sign(dq) exp(-|dq/speed|^power)."""
        ratio = self._ratio(context, shape, memory)
        fading = np.exp(-(ratio ** self.exponent(shape)))
        return (self.direction(context, memory[2:] if self.lags else memory) * fading)[:, None]

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the Stribeck speed and its power, of a film that lags as any law's."""
        if self.lags:
            return super().gradient(context, shape)
        ratio, power = self._ratio(context, shape, self.start()), self.exponent(shape)
        change = self.direction(context, self.start()) * np.exp(-(ratio**power)) * ratio**power
        by_shape = np.stack([change * power / float(shape[0]), -change * np.log(ratio)])
        return by_shape[: len(shape), :, None]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the excess, the speed at which 1/e of it is left, and the power of the speed."""
        told: dict[str, float | list[float]] = {
            "force": float(coefficients[0]),
            "speed": float(shape[0]),
            "power": self.exponent(shape),
        }
        return {**told, "lag": float(shape[-1])} if self.lags else told

    def exponent(self, shape: FloatArray) -> float:
        """Return the power of the speed, given or searched.

        Args:
            shape: values of the shape parameters.
        """
        return float(shape[1]) if self.power is None else self.power

    def _ratio(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        speed = np.abs(self.velocity(context))
        if self.lags:
            speed = _followed(np.ascontiguousarray(context.motion.t), speed, float(shape[-1]), memory)
        # Away from nought, where the logarithm of the gradient ends.
        return speed / float(shape[0]) + 1e-12


@compiled
def _followed(t: FloatArray, speed: FloatArray, lag: float, memory: FloatArray) -> FloatArray:
    """A speed (N,) as what follows it with a time constant has it; samples without one are passed over."""
    out = np.empty(len(t))
    film, last = memory[0], memory[1]
    for k in range(len(t)):
        out[k] = np.nan
        if not np.isnan(speed[k]):
            film = speed[k] if np.isnan(last) else film + (1.0 - np.exp(-(t[k] - last) / lag)) * (speed[k] - film)
            last = t[k]
            out[k] = film
    memory[0], memory[1] = film, last
    return out


@dataclass(frozen=True)
class Sigmoid(VelocityEffect):
    """Friction as a shifted logistic function of velocity, nought at rest (Gaz et al. 2018, eq. 14).

    Attributes:
        slowest: least speed [rad/s or m/s] over which the sigmoid may rise.
        fastest: greatest.
        symmetric: whether it rises alike both ways, without the shift, which few turns tell.
    """

    slowest: float = 1e-3
    fastest: float = RISEN
    symmetric: bool = False

    name = "sigmoid"
    family = "friction"
    replaces = ("coulomb",)
    contains = ("coulomb", "viscous")
    rivals = ("stribeck", "maxwell-slip", "viscous-nonlinear")
    excitation = "constant speeds from a few mrad/s to the usual ones, both ways"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it wider than the smoothing of a sign could be, without a shift."""
        if joint is None:
            return []
        return [replace(cls.seen(survey, joint, SLOWEST_SIGMOID, RISEN * _quicker(survey, joint)), symmetric=True)]

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return that with a shift."""
        return [replace(self, symmetric=False)] if self.symmetric else []

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the speed over which the sigmoid rises (1/phi2) and, unless it is symmetric, its shift (phi3)."""
        starts = (0.03, max(0.006, 1.2 * self.slowest), 0.1)
        speed = Shape("speed", "{angle}/s", self.slowest, self.fastest, _speeds(starts, self.fastest))
        shift = Shape("shift", "{angle}/s", -0.1, 0.1, (0.0,), log=False)
        return (speed,) if self.symmetric else (speed, shift)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the friction between full motion in - and in + direction, phi1, never negative."""
        return (Coefficient("force", "{current}", lower=0.0),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return 1/(1+exp(-(dq+shift)/speed)) - 1/(1+exp(-shift/speed))."""
        speed, shift = self._speed_and_shift(shape)
        return (_logistic((self.velocity(context) + shift) / speed) - _logistic(shift / speed))[:, None]

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by speed and shift."""
        speed, shift = self._speed_and_shift(shape)
        moved, rest = (self.velocity(context) + shift) / speed, shift / speed
        slope, slope_rest = _logistic(moved) * _logistic(-moved), _logistic(rest) * _logistic(-rest)
        by_speed = -(slope * moved - slope_rest * rest) / speed
        by_shift = (slope - slope_rest) / speed
        return np.stack([by_speed, by_shift])[: len(shape), :, None]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return force and speed of the same law written force tanh((dq + shift) / speed): force is that of one way."""
        _, shift = self._speed_and_shift(shape)
        return {"force": float(0.5 * coefficients[0]), "speed": self.turns_over(shape), "shift": float(shift)}

    def turns_over(self, shape: FloatArray) -> float:
        """Return the speed of the same law written as a hyperbolic tangent."""
        return float(2.0 * shape[0])

    def _speed_and_shift(self, shape: FloatArray) -> FloatArray:
        return np.append(shape, 0.0) if self.symmetric else shape


@dataclass(frozen=True)
class ViscousNonlinear(VelocityEffect):
    """Friction that grows with a power of speed other than one: shear-thinning grease below, churning above.

    A fluid knows no displacement: it turns with the velocity where dry friction builds up, as in the LuGre model.

    Attributes:
        least: smallest exponent.
        most: largest exponent.
    """

    least: float = 0.1
    most: float = 4.0

    name = "viscous-nonlinear"
    family = "friction"
    replaces = ("viscous",)
    contains = ("viscous", "coulomb")
    rivals = ("stribeck", "sigmoid", "viscous")
    excitation = "plateaus of several constant speeds up to the limit, both ways"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on either side of an exponent of one, next to which it is a difference of large viscous forces."""
        if joint is None:
            return []
        return [cls.seen(survey, joint, cls.least, 0.9), cls.seen(survey, joint, 1.1, cls.most)]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the exponent."""
        starts = tuple(x for x in (0.5, 0.2, 2.0, 3.0) if self.least < x < self.most)
        middle = (float(np.sqrt(self.least * self.most)),)
        # Near nought it is dry friction; near one every power bends alike, and the bound says nothing.
        return (Shape("exponent", "1", self.least, self.most, starts or middle, ends=(self.least < 1.0, False)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the friction at 1 rad/s (1 m/s), never negative if the exponent keeps to one side of one."""
        one_sided = self.least > 1.0 or self.most < 1.0
        return (Coefficient("force", "{current}", lower=0.0 if one_sided else -np.inf),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sign(dq) |dq|^exponent."""
        return (self.sign(context) * self._speed(context) ** float(shape[0]))[:, None]

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the exponent."""
        speed = self._speed(context)
        return (self.sign(context) * speed ** float(shape[0]) * np.log(speed))[None, :, None]

    def _speed(self, context: Context) -> FloatArray:
        # Away from nought, where the logarithm of the gradient ends.
        return np.abs(self.velocity(context)) + 1e-9


def _quicker(survey: Survey, joint: int) -> float:
    """Times by which a joint is quicker at its motor's speed, which counts, than others; where its ratio is known."""
    ratio = survey.robot.gear_ratio
    if ratio is None or survey.robot.multibody.prismatic[joint]:
        return 1.0
    return max(1.0, GEARED / float(ratio[joint]))


def _speeds(starts: tuple[float, ...], fastest: float) -> tuple[float, ...]:
    """Starts, and one beyond them where there is room."""
    return (*starts, 0.5 * fastest) if fastest > 2.0 * max(starts) else starts


def _logistic(x: FloatArray) -> FloatArray:
    return 0.5 * (1.0 + np.tanh(0.5 * x))
