"""Timing family: a current that is reported late, or through a filter."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.direction import built_up
from ident.effects.survey import Survey
from ident.errors import InputError

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True, eq=False)
class Turning:
    """Dry friction that turns, or builds up, between samples: the velocity runs straight from one to the next.

    Attributes:
        velocity: velocities (N, k) seen.
        dry: its force (k,).
        turns: speeds (k,) over which it turns [rad/s or m/s].
        presliding, exponent: displacements (k,) over which it builds up instead [rad or m], or nought, and exponents.
    """

    velocity: FloatArray
    dry: FloatArray
    turns: FloatArray
    presliding: FloatArray
    exponent: FloatArray

    def directions(self, t: FloatArray, known: BoolArray, memory: FloatArray) -> FloatArray:
        """Return its directions (N, k) at the samples, from -1 to 1.

        Args:
            t: stamps (N,) [s].
            known: samples (N,) that count; others are passed over.
            memory: last stamp, velocities and directions, brought up to date; the stamp is not known before the first.
        """
        if not self.dry.any():
            return np.zeros_like(self.velocity)
        return _directions(t, self.velocity, known, self.turns, self.presliding, self.exponent, memory)

    def force_at(self, then: FloatArray, t: FloatArray, directions: FloatArray) -> FloatArray:
        """Return its force (M, k) at any instants.

        Args:
            then: the instants (M,) [s].
            t: stamps (N,) of the samples [s].
            directions: its directions (N, k) there.
        """
        if not self.dry.any():
            return np.zeros((len(then), len(self.dry)))
        laws = self.turns, self.presliding, self.exponent
        return np.where(self.dry > 0.0, self.dry * _directions_at(then, t, self.velocity, directions, *laws), 0.0)


@dataclass(frozen=True)
class Timing(Effect):
    """An effect on the whole of the reported current, of one joint or of all.

    Between samples the total runs straight, but for dry friction that turns as its joint does, whose steps would else
    be smeared over a sample and with them what is quicker than that.

    Attributes:
        dry: dry friction (k,) of the joints that come late, in the model's force unit; none turns where not given.
        turns: speeds (k,) over which it does [rad/s or m/s].
        presliding, presliding_exponent: displacements (k,) over which it builds up instead [rad or m], nought for none,
            and exponents with which it does, as of `DirectedEffect`.
    """

    dry: tuple[float, ...] = ()
    turns: tuple[float, ...] = ()
    presliding: tuple[float, ...] = ()
    presliding_exponent: tuple[float, ...] = ()

    softens = True

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on single joints and on the whole robot, by samples alone and with friction that turns in steps."""
        straight = cls.straight(survey, joint)
        rows = slice(None) if joint is None else slice(joint, joint + 1)
        dry, turns, presliding, exponent = (
            tuple(of[rows].tolist())
            for of in (survey.steps, survey.smoothing, survey.presliding, survey.presliding_exponent)
        )
        steps = replace(straight, dry=dry, turns=turns, presliding=presliding, presliding_exponent=exponent)
        return [straight, steps] if any(steps.dry) else [straight]

    @classmethod
    def straight(cls, survey: Survey, joint: int | None) -> Self:
        """Return it where nothing turns between samples.

        Args:
            survey: facts about the logs.
            joint: its joint, or None for all.
        """
        return cls(joint)

    def signal(self, context: Context) -> FloatArray:
        """Return the total force (N, 1), or (N, n), that comes late."""
        total = context.needed("total", self.name)
        return np.ascontiguousarray(total if self.joint is None else total[:, self.joint, None])

    def turning(self, context: Context) -> Turning:
        """Return the dry friction that turns between samples, none of it where it is not given.

        Args:
            context: what it sees of the motion.

        Raises:
            InputError: more joints come late than an effect remembers.
        """
        velocity = context.motors.dq if self.joint is None else context.motors.dq[:, self.joint, None]
        joints = velocity.shape[1]
        if joints > MOST_JOINTS:
            what = f"{joints} joints, and it remembers {MOST_JOINTS} at most"
            raise InputError(what, f"effect {self.name}", "give a card with fewer joints")
        laws = self.dry, self.turns, self.presliding, self.presliding_exponent
        return Turning(np.ascontiguousarray(velocity), *(np.array(law) if law else np.zeros(joints) for law in laws))

    @abstractmethod
    def lateness(self, shape: FloatArray, coefficients: FloatArray) -> float:
        """Return the seconds by which the current comes late in slow motion."""


MOST_JOINTS = 32
"""Joints for which the memory has room."""

SAMPLES = 512
"""Samples of the past that a delay remembers."""

PARTS = 10
"""Parts of a sample in which friction that turns is followed."""

TURNS_MORE = 1e-3
"""Change of its direction from one sample to the next from which on it is."""

SLIPS = 1.0 - 1e-6
"""Direction from which on friction has built up."""


@dataclass(frozen=True)
class Delay(Timing):
    """A current that is stamped late, or a position that is stamped early.

    Minus the total's mean rate of change over a span of time before each sample: over a span as long as the delay this
    is the delay itself, over any span it is the delay to first order, which also a lead is (negative seconds).

    Attributes:
        sample: sampling period [s] of the logs, within which one span is as good as another where nothing turns.
    """

    sample: float = 0.0

    name = "delay"
    family = "timing"
    needs = ("total",)
    rivals = ("filter-lag", "rotor-inertia")
    excitation = "several frequencies: gravity and the edges of friction come late too, not inertia alone"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the span; where nothing turns it is the first order at its shortest, one sample or less."""
        longest = min(0.1, (SAMPLES - 2) * self.sample) if self.sample > 0.0 else 0.1
        starts = tuple(start for start in (2e-3, 7e-4, 6e-3, 18e-3, 54e-3) if start < longest)
        return (Shape("span", "s", 2e-4, longest, starts, ends=(False, True)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the delay."""
        return (Coefficient("seconds", "s"),)

    @classmethod
    def straight(cls, survey: Survey, joint: int | None) -> Self:
        """Return it with the logs' sampling period."""
        return cls(joint, sample=1.0 / survey.rate)

    def plain(self, shape: FloatArray) -> FloatArray | None:
        """Return the span, so that all of the current comes late; any delay where spans within a sample are alike."""
        return None if float(shape[0]) <= self.sample and not self.dry else shape[:1]

    def lateness(self, shape: FloatArray, coefficients: FloatArray) -> float:
        """Return the span where it is the delay, else the delay to first order."""
        meant = self.plain(shape)
        return float((coefficients if meant is None else meant)[0])

    def start(self) -> FloatArray:
        """Return the last times, values, velocities and directions, none known before the first sample."""
        return np.full(SAMPLES * (1 + 3 * MOST_JOINTS), np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return minus the mean rate of the total over the span."""
        # Within a sample all spans say the same to the last digit: a search would follow round-off.
        span = float(shape[0]) if self.dry else max(float(shape[0]), self.sample)
        rate = _mean_rate(context.motion.t, self.signal(context), self.turning(context), span, memory)
        return -rate if self.joint is not None else -rate[:, :, None]


@dataclass(frozen=True)
class FilterLag(Timing):
    """A current that passes a first-order low pass before it is logged."""

    name = "filter-lag"
    family = "timing"
    needs = ("total",)
    rivals = ("delay", "viscous")
    excitation = "quick changes of current next to plateaus of constant speed"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the corner frequency."""
        return (Shape("hertz", "Hz", 0.2, 400.0, (8.0, 1.0, 3.0, 20.0, 50.0, 140.0)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the share of the current that passes the filter; one for a plain low pass."""
        return (Coefficient("share", "1", lower=0.0),)

    def plain(self, shape: FloatArray) -> FloatArray | None:
        """Return one: all of the current passes the filter."""
        return np.ones(1)

    def lateness(self, shape: FloatArray, coefficients: FloatArray) -> float:
        """Return the share that passes the filter of its time constant."""
        return float(coefficients[0] / (2.0 * np.pi * shape[0]))

    def start(self) -> FloatArray:
        """Return the last time, not known before the first sample, values, input, velocities and directions."""
        return np.append(np.nan, np.zeros(4 * MOST_JOINTS))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the low pass of the total less the total."""
        signal, turning = self.signal(context), self.turning(context)
        t, known = np.ascontiguousarray(context.motion.t), _known(signal, turning)
        last = np.append(memory[:1], memory[1 + 2 * MOST_JOINTS :])
        directions = turning.directions(t, known, last)
        laws = turning.dry, turning.turns, turning.presliding, turning.exponent
        lag = _low_pass(t, signal, turning.velocity, directions, known, *laws, float(shape[0]), memory) - signal
        return lag if self.joint is not None else lag[:, :, None]


def _known(x: FloatArray, turning: Turning) -> BoolArray:
    """Samples (N,) whose total and velocities are known."""
    return np.asarray(~(np.isnan(x).any(axis=1) | np.isnan(turning.velocity).any(axis=1)))


def _mean_rate(t: FloatArray, x: FloatArray, turning: Turning, span: float, memory: FloatArray) -> FloatArray:
    """Mean rate of change (N, k) of x (N, k) over the span before each sample; before the first, x stands still."""
    joints = x.shape[1]
    remembered = memory.reshape(SAMPLES, 1 + 3 * MOST_JOINTS)[:, : 1 + 3 * joints]
    before = remembered[~np.isnan(remembered[:, 0])]
    times, values = np.append(before[:, 0], t), np.vstack([before[:, 1 : 1 + joints], x])
    past = replace(turning, velocity=np.vstack([before[:, 1 + joints : 1 + 2 * joints], turning.velocity]))
    last = np.append(np.nan, np.zeros(2 * MOST_JOINTS))
    if len(before) > 0:
        last[1 + MOST_JOINTS :][:joints] = before[0, 1 + 2 * joints :]
    directions = past.directions(times, _known(values, past), last)
    kept = min(len(times), SAMPLES)
    remembered[SAMPLES - kept :] = np.column_stack([times, values, past.velocity, directions])[-kept:]
    then, straight = t - span, values - np.where(past.dry > 0.0, past.dry * directions, 0.0)
    earlier = np.column_stack([np.interp(then, times, straight[:, j]) for j in range(joints)])
    rate: FloatArray = (x - earlier - past.force_at(then, times, directions)) / span
    return rate


@compiled
def _turned(
    before: float, start: float, end: float, first: float, last: float, step: float,
    turns: float, presliding: float, exponent: float,
) -> float:  # fmt: skip
    """Direction at a share of the way from one sample to the next, from that at another; velocities at both samples."""
    if presliding <= 0.0:
        return float(np.tanh((first + end * (last - first)) / turns))
    speed = first + 0.5 * (start + end) * (last - first)
    return built_up(before, speed * (end - start) * step, presliding, exponent)


@compiled
def _directions(
    t: FloatArray, velocity: FloatArray, known: BoolArray, turns: FloatArray, presliding: FloatArray,
    exponent: FloatArray, memory: FloatArray,
) -> FloatArray:  # fmt: skip
    """See `Turning.directions`."""
    rows, joints = velocity.shape
    out = np.zeros((rows, joints))
    speeds, states = memory[1:], memory[1 + MOST_JOINTS :]
    for k in range(rows):
        if known[k]:
            step = 0.0 if np.isnan(memory[0]) else t[k] - memory[0]
            for j in range(joints):
                first, now = speeds[j] if step > 0.0 else velocity[k, j], velocity[k, j]
                slips = min(first * states[j], now * states[j]) > 0.0 and abs(states[j]) > SLIPS
                parts = 1 if slips or presliding[j] <= 0.0 else PARTS
                for part in range(parts):
                    states[j] = _turned(
                        states[j], part / parts, (part + 1) / parts, first, now, step,
                        turns[j], presliding[j], exponent[j],
                    )  # fmt: skip
                speeds[j] = now
            memory[0] = t[k]
        out[k] = states[:joints]
    return out


@compiled
def _directions_at(
    then: FloatArray, t: FloatArray, velocity: FloatArray, directions: FloatArray,
    turns: FloatArray, presliding: FloatArray, exponent: FloatArray,
) -> FloatArray:  # fmt: skip
    """See `Turning.force_at`; at the ends directions stay as they are."""
    joints = velocity.shape[1]
    out = np.empty((len(then), joints))
    for m, after in enumerate(np.searchsorted(t, then)):
        if after == 0 or after == len(t):
            out[m] = directions[min(after, len(t) - 1)]
            continue
        step = t[after] - t[after - 1]
        way = (then[m] - t[after - 1]) / step
        for j in range(joints):
            first, last, state = velocity[after - 1, j], velocity[after, j], directions[after - 1, j]
            start = 0.0
            while start < way:
                end = min(start + 1.0 / PARTS, way)
                if presliding[j] <= 0.0:
                    end = way
                state = _turned(state, start, end, first, last, step, turns[j], presliding[j], exponent[j])
                start = end
            out[m, j] = state
    return out


@compiled
def _low_pass(
    t: FloatArray, x: FloatArray, velocity: FloatArray, directions: FloatArray, known: BoolArray, dry: FloatArray,
    turns: FloatArray, presliding: FloatArray, exponent: FloatArray, hertz: float, memory: FloatArray,
) -> FloatArray:  # fmt: skip
    """First-order low pass of what runs straight between samples, but for friction that turns; settled at the first.

    It is exact but for that friction, which is followed in parts of the sample in which it turns. Samples of which an
    input is not known are passed over.
    """
    joints, rate = x.shape[1], 2.0 * np.pi * hertz
    values, inputs, speeds = memory[1:], memory[1 + MOST_JOINTS :], memory[1 + 2 * MOST_JOINTS :]
    states = memory[1 + 3 * MOST_JOINTS :]
    out = np.empty_like(x)
    for k in range(len(t)):
        if not known[k]:
            out[k] = np.nan
            continue
        begun = not np.isnan(memory[0])
        step = t[k] - memory[0] if begun else 0.0
        for j in range(joints):
            if not begun:
                values[j], inputs[j], speeds[j], states[j] = x[k, j], x[k, j], velocity[k, j], directions[k, j]
            before, after = states[j], directions[k, j]
            parts = PARTS if dry[j] > 0.0 and abs(after - before) > TURNS_MORE else 1
            kept, held = 0.0, 0.0
            if step > 0.0:
                past = rate * step / parts
                kept = np.exp(-past)
                held = (1.0 - kept) / past
            late, last, state = values[j], inputs[j], before
            for part in range(1, parts + 1):
                share = part / parts
                now = inputs[j] + share * (x[k, j] - inputs[j])
                if part < parts:
                    state = _turned(
                        state, share - 1.0 / parts, share, speeds[j], velocity[k, j], step,
                        turns[j], presliding[j], exponent[j],
                    )  # fmt: skip
                    now += dry[j] * (state - before - share * (after - before))
                late = kept * late + (1.0 - held) * now + (held - kept) * last
                last = now
            out[k, j] = late
            values[j], inputs[j], speeds[j], states[j] = late, x[k, j], velocity[k, j], after
        memory[0] = t[k]
    return out
