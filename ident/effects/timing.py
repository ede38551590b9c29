"""Timing family: a current that is reported late, or through a filter."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.second_order import followed
from ident.effects.survey import Survey
from ident.effects.turning import MOST_JOINTS, Turning, turned
from ident.errors import InputError

if TYPE_CHECKING:
    from ident.robot import Robot


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

    @property
    def counts_as(self) -> int:
        """How many parameters the law stands for: one, and one more for each order beyond the first."""
        return 1

    @abstractmethod
    def lateness(self, shape: FloatArray, coefficients: FloatArray) -> float:
        """Return the seconds by which the current comes late in slow motion."""


SAMPLES = 512
"""Samples of the past that a delay remembers."""

TURNS_MORE = 1e-3
"""Change of its direction from one sample to the next from which on it is."""

PARTS = 10
"""Parts of a sample in which a filter follows friction that turns."""

DAMPING = 0.5**0.5
"""Damping ratio of Butterworth's filter of second order."""


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
    """A current that passes a low pass before it is logged: of first order, or of second (Butterworth 1930).

    Attributes:
        order: of the filter, 1 or 2.
    """

    order: int = 1

    name = "filter-lag"
    family = "timing"
    needs = ("total",)
    rivals = ("delay", "viscous")
    excitation = "quick changes of current next to plateaus of constant speed"

    @property
    def counts_as(self) -> int:
        """Its order."""
        return self.order

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the corner frequency."""
        return (Shape("hertz", "Hz", 0.2, 400.0, (8.0, 1.0, 3.0, 20.0, 50.0, 140.0)),)

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it with either order on the whole robot; one joint seldom tells it from a delay."""
        first = super().candidates(survey, joint)
        if joint is not None:
            return first
        return [*first, *(replace(one, order=2) for one in first if isinstance(one, cls))]

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the share of the current that passes the filter; one for a plain low pass."""
        return (Coefficient("share", "1", lower=0.0),)

    def plain(self, shape: FloatArray) -> FloatArray | None:
        """Return one: all of the current passes the filter."""
        return np.ones(1)

    def lateness(self, shape: FloatArray, coefficients: FloatArray) -> float:
        """Return the share that passes of the filter's lag."""
        return float(coefficients[0] * (1.0 if self.order == 1 else 2.0 * DAMPING) / (2.0 * np.pi * shape[0]))

    def start(self) -> FloatArray:
        """Return the last time, not known before the first sample, values, input, velocities, directions and rates."""
        return np.append(np.nan, np.zeros(5 * MOST_JOINTS))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the low pass of the total less the total."""
        signal, turning = self.signal(context), self.turning(context)
        t, known = np.ascontiguousarray(context.motion.t), _known(signal, turning)
        last = np.append(memory[:1], memory[1 + 2 * MOST_JOINTS : 1 + 4 * MOST_JOINTS])
        directions = turning.directions(t, known, last)
        laws = turning.dry, turning.turns, turning.presliding, turning.exponent, float(shape[0]), self.order
        lag = _low_pass(t, signal, turning.velocity, directions, known, *laws, memory) - signal
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
def _low_pass(
    t: FloatArray, x: FloatArray, velocity: FloatArray, directions: FloatArray, known: BoolArray, dry: FloatArray,
    turns: FloatArray, presliding: FloatArray, exponent: FloatArray, hertz: float, order: int, memory: FloatArray,
) -> FloatArray:  # fmt: skip
    """Low pass of what runs straight between samples, but for friction that turns; settled at the first.

    It is exact but for that friction, which is followed in parts of the sample in which it turns. Samples of which an
    input is not known are passed over.
    """
    joints, rate = x.shape[1], 2.0 * np.pi * hertz
    values, inputs, speeds = memory[1:], memory[1 + MOST_JOINTS :], memory[1 + 2 * MOST_JOINTS :]
    states, rises = memory[1 + 3 * MOST_JOINTS :], memory[1 + 4 * MOST_JOINTS :]
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
                rises[j] = 0.0
            before, after = states[j], directions[k, j]
            parts = PARTS if dry[j] > 0.0 and abs(after - before) > TURNS_MORE else 1
            kept, held, past = 0.0, 0.0, rate * step / parts
            if order == 1 and step > 0.0:
                kept = np.exp(-past)
                held = (1.0 - kept) / past
            late, rise, last, state = values[j], rises[j], inputs[j], before
            for part in range(1, parts + 1):
                share = part / parts
                now = inputs[j] + share * (x[k, j] - inputs[j])
                if part < parts:
                    state = turned(
                        state, share - 1.0 / parts, share, speeds[j], velocity[k, j], step,
                        turns[j], presliding[j], exponent[j],
                    )  # fmt: skip
                    now += dry[j] * (state - before - share * (after - before))
                if order == 1:
                    late = kept * late + (1.0 - held) * now + (held - kept) * last
                elif step > 0.0:
                    late, rise = followed(late, rise, last, now, past, DAMPING)
                last = now
            out[k, j] = late
            values[j], inputs[j], speeds[j], states[j], rises[j] = late, x[k, j], velocity[k, j], after, rise
        memory[0] = t[k]
    return out
