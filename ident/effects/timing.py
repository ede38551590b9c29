"""Timing family: a current that is reported late, or through a filter."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.survey import Survey

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True, eq=False)
class Steps:
    """Dry friction that turns with the velocity.

    Attributes:
        dry: its force (k,).
        turns: speeds (k,) over which it turns [rad/s or m/s].
        velocity: velocities (N, k) seen.
    """

    dry: FloatArray
    turns: FloatArray
    velocity: FloatArray

    def at(self, velocity: FloatArray) -> FloatArray:
        """Return its force (M, k).

        Args:
            velocity: (M, k) [rad/s or m/s].
        """
        return np.where(self.dry > 0.0, self.dry * np.tanh(velocity / self.turns), 0.0)


@dataclass(frozen=True)
class Timing(Effect):
    """An effect on the whole of the reported current, of one joint or of all.

    Between samples the total runs straight, but for dry friction that turns as its joint does, whose steps would else
    be smeared over a sample and with them what is quicker than that.

    Attributes:
        dry: dry friction (k,) of the joints that come late, in the model's force unit; none turns where not given.
        turns: speeds (k,) over which it does [rad/s or m/s].
    """

    dry: tuple[float, ...] = ()
    turns: tuple[float, ...] = ()

    softens = True

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on single joints and on the whole robot, by samples alone and with friction that turns in steps."""
        straight = cls.straight(survey, joint)
        rows = slice(None) if joint is None else slice(joint, joint + 1)
        # What builds up over a displacement has no steps.
        dry = np.where(survey.presliding > 0.0, 0.0, survey.holds)[rows]
        turns = survey.smoothing[rows]
        steps = replace(straight, dry=tuple(dry.tolist()), turns=tuple(turns.tolist()))
        return [straight, steps] if dry.any() else [straight]

    @classmethod
    def straight(cls, survey: Survey, joint: int | None) -> Self:
        """Return it where nothing turns between samples.

        Args:
            survey: facts about the logs.
            joint: its joint, or None for all.
        """
        return cls(joint)

    def steps(self, context: Context) -> Steps:
        """Return the dry friction that turns, none of it where it is not given, and the velocity by which it does.

        Args:
            context: what it sees of the motion.
        """
        velocity = context.motors.dq if self.joint is None else context.motors.dq[:, self.joint, None]
        joints = velocity.shape[1]
        dry, turns = (self.dry, self.turns) if self.dry else (np.zeros(joints), np.ones(joints))
        return Steps(np.array(dry), np.array(turns), np.ascontiguousarray(velocity))

    def signal(self, context: Context) -> FloatArray:
        """Return the total force (N, 1), or (N, n), that comes late."""
        total = context.needed("total", self.name)
        return np.ascontiguousarray(total if self.joint is None else total[:, self.joint, None])

    @abstractmethod
    def lateness(self, shape: FloatArray, coefficients: FloatArray) -> float:
        """Return the seconds by which the current comes late in slow motion."""


MOST_JOINTS = 32
"""Joints for which the memory has room."""

SAMPLES = 512
"""Samples of the past that a delay remembers."""

PARTS = 10
"""Parts of a sample in which a filter follows friction that turns."""

TURNS_MORE = 1e-3
"""Change of the sign of velocity from one sample to the next from which on it does so."""


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
        return (Shape("span", "s", 2e-4, 0.1, (2e-3, 7e-4, 6e-3, 18e-3, 54e-3), ends=(False, True)),)

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
        """Return the last times, values and velocities, none known before the first sample."""
        return np.full(SAMPLES * (1 + 2 * MOST_JOINTS), np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return minus the mean rate of the total over the span."""
        # Within a sample all spans say the same to the last digit: a search would follow round-off.
        span = float(shape[0]) if self.dry else max(float(shape[0]), self.sample)
        rate = _mean_rate(context.motion.t, self.signal(context), self.steps(context), span, memory)
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
        """Return the last time, values, input and velocities, not known before the first sample."""
        return np.full(1 + 3 * MOST_JOINTS, np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the low pass of the total less the total."""
        signal = self.signal(context)
        t, steps = np.ascontiguousarray(context.motion.t), self.steps(context)
        lag = _low_pass(t, signal, steps.velocity, steps.dry, steps.turns, float(shape[0]), memory) - signal
        return lag if self.joint is not None else lag[:, :, None]


def _mean_rate(t: FloatArray, x: FloatArray, steps: Steps, span: float, memory: FloatArray) -> FloatArray:
    """Mean rate of change (N, k) of x (N, k) over the span before each sample; before the first, x stands still."""
    joints = x.shape[1]
    known = memory.reshape(SAMPLES, 1 + 2 * MOST_JOINTS)[:, : 1 + 2 * joints]
    past = np.vstack([known[~np.isnan(known[:, 0])], np.column_stack([t, x, steps.velocity])])
    kept = min(len(past), SAMPLES)
    known[SAMPLES - kept :] = past[-kept:]
    times, values, speeds = past[:, 0], past[:, 1 : 1 + joints], past[:, 1 + joints :]

    def then(of: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(t - span, times, of[:, j]) for j in range(joints)])

    earlier = then(values - steps.at(speeds)) + steps.at(then(speeds))
    rate: FloatArray = (x - earlier) / span
    return rate


@compiled
def _low_pass(
    t: FloatArray, x: FloatArray, velocity: FloatArray, dry: FloatArray, turns: FloatArray,
    hertz: float, memory: FloatArray,
) -> FloatArray:  # fmt: skip
    """First-order low pass of what runs straight between samples, but for friction that turns; settled at the first.

    It is exact but for that friction, which is followed in parts of the sample in which it turns. Samples of which an
    input is not known are passed over.
    """
    joints, rate = x.shape[1], 2.0 * np.pi * hertz
    values, inputs, speeds = memory[1:], memory[1 + MOST_JOINTS :], memory[1 + 2 * MOST_JOINTS :]
    out = np.empty_like(x)
    for k in range(len(t)):
        if np.isnan(x[k]).any() or np.isnan(velocity[k]).any():
            out[k] = np.nan
            continue
        begun = not np.isnan(memory[0])
        step = t[k] - memory[0] if begun else 0.0
        for j in range(joints):
            if not begun:
                values[j], inputs[j], speeds[j] = x[k, j], x[k, j], velocity[k, j]
            before, after = np.tanh(speeds[j] / turns[j]), np.tanh(velocity[k, j] / turns[j])
            parts = PARTS if dry[j] > 0.0 and abs(after - before) > TURNS_MORE else 1
            kept, held = 0.0, 0.0
            if step > 0.0:
                past = rate * step / parts
                kept = np.exp(-past)
                held = (1.0 - kept) / past
            late, last = values[j], inputs[j]
            for part in range(1, parts + 1):
                share = part / parts
                now = inputs[j] + share * (x[k, j] - inputs[j])
                if part < parts:
                    turned = np.tanh((speeds[j] + share * (velocity[k, j] - speeds[j])) / turns[j])
                    now += dry[j] * (turned - before - share * (after - before))
                late = kept * late + (1.0 - held) * now + (held - kept) * last
                last = now
            out[k, j] = late
            values[j], inputs[j], speeds[j] = late, x[k, j], velocity[k, j]
        memory[0] = t[k]
    return out
