"""Forces that repeat with a joint's angle many times a turn: ripples of gears; those of motors are among them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.survey import Survey

if TYPE_CHECKING:
    from ident.robot import Robot

ComplexArray = npt.NDArray[np.complex128]

FEWEST_REPEATS = 4.0
"""Fewer repeats a turn of the joint look like a cable, a balancer or the links' weight."""

WAVES = 2.0
"""Waves over the angles seen, fewer of which look like them, too."""

USUAL_RATIO = 100.0
"""Gear ratio of a robot joint whose card names none."""

GEAR_HARMONICS = 2.5
"""A gear repeats at most this many times a turn of its motor (a wave generator twice); motor poles more often."""

HARMONIC_REPEATS = 125.0
"""Repeats a turn up to which a ripple's second harmonic is looked for; a quicker one's passes too fast to be seen."""

POLE_HARMONICS = 16.0
"""Repeats a turn of the motor up to which its poles are looked for."""

APART = 3.0
"""Phase [rad] by which ripples must come apart over the angles seen, to be looked for one by one."""

HARMONICS = ("second_harmonic", "third_harmonic")
"""Looked for where a ripple is found; later ones of a gear or of poles are small."""

ROLLING = Shape("speed", "{angle}/s", 5e-4, 0.2, (0.01,), ends=(False, True))
"""Over which a ripple comes up that is there only as the joint turns."""

FADING = Shape("hertz", "Hz", 1.0, 200.0, (10.0,), ends=(False, True))
"""Up to which a position loop takes up a ripple; of quicker ones the inertia does."""


@dataclass(frozen=True)
class GearRipple(Effect):
    """Force that repeats with the joint's angle: tooth meshing, run-out, the wave generator of a strain-wave gear.

    A gear's kinematic error may grow with the load that it carries: so does the ripple's amplitude then, linearly. What
    teeth bring about as they roll is not there at rest, where friction holds the joint. Of what passes too quickly for
    the position loop the inertia takes up most, by less motion than the encoder or the derivatives' filter shows: the
    current holds what a first-order low-pass leaves of it (the loop's complementary sensitivity).

    Attributes:
        most, fewest: repeats a turn between which the search looks.
        harmonics: of the ripple, up to three.
        step: repeats a turn from one start of the search to the next.
        largest: largest force that the model gives on the logs, at which a ripple that grows with the load is told; one
            of one size has none.
        rolls: whether it is there only as the joint turns.
        fades: whether the current holds less of it the more quickly it passes.
    """

    most: float = 40.0
    fewest: float = 0.5
    harmonics: int = 1
    step: float = 1.0
    largest: float = 0.0
    rolls: bool = False
    fades: bool = False

    name = "gear-ripple"
    family = "transmission"
    rivals: ClassVar[tuple[str, ...]] = ("cogging", "cable-spring", "position-friction")
    excitation = "slow constant speeds, so that the ripple stays below half the sampling rate"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on turning joints with a gear, up to the repeats of a motor turn, also for its second harmonic."""
        if joint is None or survey.robot.multibody.prismatic[joint]:
            return []
        fewest, most = fewest_repeats(survey, joint), most_of_gears(survey, joint)
        tried = ((most, 1), (min(most, HARMONIC_REPEATS), 2))
        step = ripples_apart(survey, joint)
        return [cls(joint, limit, fewest, harmonics, step) for limit, harmonics in tried if limit > fewest + 1.0]

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return it with more harmonics, as it grows with the load, only in motion, and as a position loop shows it."""
        if not self.simple:
            return []
        rich = replace(self, harmonics=1 + len(HARMONICS))
        largest = float(survey.largest[self.at])
        grown = [replace(self, largest=largest)] if largest > 0.0 else []
        return [rich, *grown, replace(self, rolls=True), replace(rich, rolls=True), replace(self, fades=True)]

    @property
    def simple(self) -> bool:
        """Whether it is a sine of one size."""
        return self.harmonics == 1 and self.largest == 0.0 and not (self.rolls or self.fades)

    @property
    def needs(self) -> tuple[str, ...]:
        """The load, where the ripple grows with it."""
        return ("load",) if self.largest > 0.0 else ()

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the repeats a turn of the joint, and over which speed it comes up or at which frequency it fades."""
        starts = tuple(np.arange(np.floor(self.fewest) + 1.0, self.most, self.step).tolist())
        per_turn = Shape("per_turn", "1", self.fewest, self.most, starts, log=False)
        return (per_turn, *((ROLLING,) if self.rolls else ()), *((FADING,) if self.fades else ()))

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return amplitudes in and out of phase with the joint's zero, of each harmonic; then by how much they grow."""
        orders = ["", *map(str, range(2, self.harmonics + 1))]
        names = [f"force_{wave}{order}" for order in orders for wave in ("sin", "cos")]
        grown = [f"{name}_grown" for name in names] if self.largest > 0.0 else []
        return tuple(Coefficient(name, "{current}") for name in names + grown)

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the amplitude, its repeats a turn, its phase at the joint's zero, and the other harmonics'.

        One that grows with the load is told at the largest force, and without load (``unloaded``).
        """
        without = coefficients[: 2 * self.harmonics]
        at_most = without + coefficients[len(without) :] if self.largest > 0.0 else without
        told = {"force": float(np.hypot(*at_most[:2])), "per_turn": float(shape[0])}
        told["phase"] = float(np.arctan2(at_most[1], at_most[0]))
        for order, name in zip(range(1, self.harmonics), HARMONICS, strict=False):
            told[name] = float(np.hypot(*at_most[2 * order : 2 * order + 2]))
        if self.largest > 0.0:
            told["unloaded"] = float(np.hypot(*without[:2]))
        return {**told, **{more.name: float(value) for more, value in zip(self.shapes[1:], shape[1:], strict=True)}}

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sine and cosine of multiples of per_turn times the angle; the same times the load's size."""
        return self._full(context, _parts(self._phasors(context, shape)), shape)

    def sweep(self, context: Context, shapes: FloatArray) -> Iterator[FloatArray]:
        """Yield sine and cosine at each of several repeats a turn; evenly spaced ones by turning one phasor on."""
        per_turn, angle = shapes[:, 0], context.motors.q[:, self.at]
        if shapes.shape[1] > 1 or len(per_turn) < 3 or np.ptp(np.diff(per_turn)) > 1e-9:
            yield from super().sweep(context, shapes)
            return
        wave, onward = (np.exp(1j * turns * angle) for turns in (per_turn[0], per_turn[1] - per_turn[0]))
        for shape in shapes:
            yield self._full(context, _parts(self._powers(wave)), shape)
            wave = wave * onward

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the repeats a turn, and by what else the shape holds."""
        phasors = self._phasors(context, shape)
        by_turns = 1j * np.arange(1, self.harmonics + 1)[:, None] * context.motors.q[:, self.at] * phasors
        more = []
        if self.rolls:
            # d tanh(u) / du, u = |v| / speed, over tanh(u), which is no wave's.
            over = np.abs(context.motors.dq[:, self.at]) / shape[1]
            here = np.tanh(over)
            per_wave = np.divide(-over * (1.0 - here**2), here * shape[1], out=np.zeros_like(over), where=here > 0.0)
            more.append(self._full(context, _parts(phasors), shape) * per_wave[:, None])
        if self.fades:
            quick = self._quick(context, shape)
            lost = 1j * quick * _low_pass(quick) * phasors
            by_turns -= lost / shape[0]
            more.append(self._full(context, _parts(lost / shape[-1]), shape))
        return np.stack([self._full(context, _parts(by_turns), shape), *more])

    def _phasors(self, context: Context, shape: FloatArray) -> ComplexArray:
        """Each harmonic (k, N), its sine the imaginary part, as a loop with that corner shows it."""
        waves = np.array(list(self._powers(np.exp(1j * shape[0] * context.motors.q[:, self.at]))))
        return waves * _low_pass(self._quick(context, shape)) if self.fades else waves

    def _powers(self, wave: ComplexArray) -> Iterator[ComplexArray]:
        """Each harmonic (N,), as a power of the first (N,)."""
        return itertools.accumulate([wave] * self.harmonics, np.multiply)

    def _quick(self, context: Context, shape: FloatArray) -> FloatArray:
        """How often each harmonic (k, N) passes, by the side it passes to, over the corner of a ripple that fades."""
        turns = np.arange(1, self.harmonics + 1) * shape[0] / (2.0 * np.pi * shape[-1])
        return np.outer(turns, context.motors.dq[:, self.at])

    def _full(self, context: Context, waves: FloatArray, shape: FloatArray) -> FloatArray:
        """Waves (N, k) as far as the joint turns and, where they grow with the load, times its size, too (N, 2 k)."""
        if self.rolls:
            waves = waves * np.tanh(np.abs(context.motors.dq[:, self.at]) / shape[1])[:, None]
        if self.largest == 0.0:
            return waves
        size = np.abs(context.needed("load", self.name)[:, self.at]) / self.largest
        return np.hstack([waves, waves * size[:, None]])


def _low_pass(quick: FloatArray) -> ComplexArray:
    """What a first-order low-pass leaves of phasors that turn at so many times (k, N) its corner."""
    # 1 / (1 + i u), multiplied out: a complex quotient would complain of rows that are not known.
    return np.asarray((1.0 - 1j * quick) * (1.0 / (1.0 + quick**2)))


def _parts(phasors: Iterable[ComplexArray]) -> FloatArray:
    """Sine and cosine (N, 2 k) of each of k phasors (N,)."""
    # Column by column in memory: hundreds are tried, each a whole.
    return np.array([part for wave in phasors for part in (wave.imag, wave.real)]).T


def fewest_repeats(survey: Survey, joint: int) -> float:
    """Return the repeats a turn of a joint from which on a force of its angle is seen to repeat.

    Args:
        survey: what is known of robot and logs.
        joint: from 0.
    """
    return max(FEWEST_REPEATS, WAVES * 2.0 * np.pi / max(float(survey.reach[joint]), 1e-6))


def ripples_apart(survey: Survey, joint: int) -> float:
    """Return the repeats a turn of a joint by which ripples must differ to look different.

    Args:
        survey: what is known of robot and logs.
        joint: from 0.
    """
    return float(max(1.0, np.floor(APART / max(float(survey.reach[joint]), 1e-6))))


def most_of_gears(survey: Survey, joint: int) -> float:
    """Return the repeats a turn of a joint up to which its gear is looked for.

    Args:
        survey: what is known of robot and logs.
        joint: from 0.
    """
    ratio = survey.robot.gear_ratio
    return GEAR_HARMONICS * (USUAL_RATIO if ratio is None else max(abs(float(ratio[joint])), 2.0))
