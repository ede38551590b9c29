"""Electrical family: what the drive adds to the current it reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.elapsed import elapsed
from ident.effects.ripple import (
    GEAR_HARMONICS,
    POLE_HARMONICS,
    GearRipple,
    fewest_repeats,
    most_of_gears,
    ripples_apart,
)
from ident.effects.survey import Survey
from ident.effects.told_at_largest import ToldAtLargest

if TYPE_CHECKING:
    from ident.robot import Robot

DIRECT_DRIVE = 100.0
"""Repeats a turn up to which poles are looked for at least: motors that drive a joint directly have many."""


@dataclass(frozen=True)
class CurrentOffset(Effect):
    """A constant added to the current: sensor bias, or a constant force at the joint."""

    name = "current-offset"
    family = "electrical"
    rivals = ("coulomb-asymmetry", "sensor-drift")
    excitation = "motion in both directions and rest"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the offset."""
        return (Coefficient("offset", "{current}"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return ones."""
        return np.ones((len(context.motion.t), 1))


@dataclass(frozen=True)
class DriveGain(Effect):
    """A torque constant other than the model's: the joint needs its current times a factor, friction included."""

    name = "drive-gain"
    family = "electrical"
    needs = ("total",)
    rivals = ("payload", "torque-saturation")
    excitation = "several loads and speeds, against a model or links that other joints' rows share"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the share by which the joint draws more than the model says."""
        return (Coefficient("excess", "1"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return what the model says."""
        return context.needed("total", self.name)[:, self.at, None]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the true gain over the modelled one."""
        return {"scale": float(1.0 / (1.0 + coefficients[0]))}


@dataclass(frozen=True)
class TorqueSaturation(ToldAtLargest):
    """Iron that saturates: at high current the torque falls short of proportional (Hanselman 2006, ch. 4).

    The joint draws more than the model says by a share that grows with a power of the current.

    Attributes:
        levels: whether the share comes to an end above a knee, where all iron that carries the flux is saturated.
    """

    levels: bool = False

    name = "torque-saturation"
    family = "electrical"
    needs = ("total",)
    rivals = ("load-friction", "drive-gain")
    excitation = "the highest torques of both signs, at +dq and at -dq"

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return one whose share comes to an end."""
        return [] if self.levels else [replace(self, levels=True)]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the power by which the missing share grows and, if it comes to an end, the knee."""
        power = Shape("power", "1", 0.4, 8.0, (1.0, 2.0, 4.0), ends=(True, False))
        knee = Shape("knee", "1", 0.02, 2.0, (0.3,), ends=(True, False))
        return (power, knee) if self.levels else (power,)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the excess at the largest force."""
        return (Coefficient("excess", "1", lower=0.0),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return total g, g being (|total| / largest)^power; with a knee g (1 + k) / (g + k), k being knee^power."""
        total = context.needed("total", self.name)[:, self.at]
        grown = (np.abs(total) / max(self.largest, 1e-12) + 1e-9) ** float(shape[0])
        if self.levels:
            knee = float(shape[1]) ** float(shape[0])
            grown *= (1.0 + knee) / (grown + knee)
        return (total * grown)[:, None]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the share of the torque that is lost at the largest current, and where half of what comes is."""
        excess = float(coefficients[0])
        told: dict[str, float | list[float]] = {"share": excess / (1.0 + excess), "power": float(shape[0])}
        return {**told, "knee": float(shape[1])} if self.levels else told


@dataclass(frozen=True)
class SensorDrift(Effect):
    """An offset of the current sensor that wanders steadily, or settles as the sensor warms up.

    Attributes:
        since: time stamp [s] at which the drift counts as nought.
        begins: time stamp [s] at which each log begins, where it does so in each instead.
        settles: whether it comes to an end, by an exponential.
        over: seconds over which the rate of one that settles is the mean; nought: the rate at the start.
    """

    since: float = 0.0
    begins: tuple[float, ...] = ()
    settles: bool = False
    over: float = 0.0

    name = "sensor-drift"
    family = "electrical"
    rivals = ("thermal-friction", "current-offset")
    excitation = "logs that last minutes, with motion both ways all through them"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it from the earliest time stamp and, where clocks begin anew, from the start of each log."""
        if joint is None:
            return []
        return [cls(joint, survey.since, begins) for begins in dict.fromkeys(((), survey.begins))]

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return one that settles, whose rate is the mean over the logs."""
        return [] if self.settles else [replace(self, settles=True, over=survey.lasts / max(len(self.begins), 1))]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the time after which all but 1/e of it is over, where it settles."""
        return (Shape("seconds", "s", 5.0, 3000.0, (60.0,)),) if self.settles else ()

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the drift in an hour."""
        return (Coefficient("per_hour", "{current}/h"),)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the hours since the start or, where it settles, what they come to at that rate."""
        seconds = elapsed(context.motion.t, self.since, self.begins)
        if self.settles:
            seconds = _settled(seconds, shape[0])
            if self.over > 0.0:
                seconds *= self.over / _settled(np.array(self.over), shape[0])
        return (seconds / 3600.0)[:, None]


def _settled(seconds: FloatArray, after: float) -> FloatArray:
    """What seconds come to, at the rate of the start, of a drift of which all but 1/e is over after some."""
    return -after * np.expm1(-seconds / after)


@dataclass(frozen=True)
class Cogging(GearRipple):
    """Torque that repeats with the motor's poles (Hanselman 2006, ch. 5); seen at the joint many times a turn."""

    name = "cogging"
    family = "electrical"
    rivals = ("gear-ripple",)
    excitation = "slow constant speeds at several loads, so that the ripple stays below half the sampling rate"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on turning joints, above the repeats that a gear can have."""
        if joint is None or survey.robot.multibody.prismatic[joint]:
            return []
        gears = most_of_gears(survey, joint)
        fewest = max(gears, fewest_repeats(survey, joint))
        most = max(gears * POLE_HARMONICS / GEAR_HARMONICS, DIRECT_DRIVE)
        step = ripples_apart(survey, joint)
        return [cls(joint, most=most, fewest=fewest, step=step)] if most > fewest + 1.0 else []

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return none that grows with the load: magnets pull at slots whatever it is."""
        return [form for form in super().fuller(survey) if isinstance(form, Cogging) and form.largest == 0.0]
