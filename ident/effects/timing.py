"""Timing family: a current that is reported late, or through a filter."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape, Survey

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True)
class Timing(Effect):
    """An effect on the whole of the reported current, of one joint or of all."""

    softens = True

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on single joints and on the whole robot."""
        return [cls(joint)]

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


@dataclass(frozen=True)
class Delay(Timing):
    """A current that is stamped late, or a position that is stamped early.

    Minus the total's mean rate of change over a span of time before each sample: over a span as long as the delay this
    is the delay itself, over any span it is the delay to first order, which also a lead is (negative seconds).

    Between samples the total runs straight, but for dry friction that turns as its joint does, whose steps would else
    be smeared over a sample and with them the delays that are shorter.

    Attributes:
        sample: sampling period [s] of the logs, within which one span is as good as another where nothing turns.
        dry: dry friction (k,) of the joints that come late, in the model's force unit; none turns where not given.
        turns: speeds (k,) over which it does [rad/s or m/s].
    """

    sample: float = 0.0
    dry: tuple[float, ...] = ()
    turns: tuple[float, ...] = ()

    name = "delay"
    family = "timing"
    needs = ("total",)
    rivals = ("filter-lag", "rotor-inertia")
    excitation = "several frequencies: gravity and the edges of friction come late too, not inertia alone"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the span; where nothing turns it is the first order at its shortest, one sample or less."""
        return (Shape("span", "s", 1e-3, 0.1, (2e-3, 6e-3, 18e-3, 54e-3), ends=(False, True)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the delay."""
        return (Coefficient("seconds", "s"),)

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on single joints and on the whole robot, with dry friction that turns between samples and without."""
        rows = slice(None) if joint is None else slice(joint, joint + 1)
        # What builds up over a displacement has no steps.
        dry = np.where(survey.presliding > 0.0, 0.0, survey.holds)[rows]
        plain, steps = cls(joint, 1.0 / survey.rate), (tuple(dry.tolist()), tuple(survey.smoothing[rows].tolist()))
        return [plain, replace(plain, dry=steps[0], turns=steps[1])] if dry.any() else [plain]

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
        velocity = context.motors.dq if self.joint is None else context.motors.dq[:, self.joint, None]
        steps = _Steps(np.array(self.dry), np.array(self.turns)) if self.dry else None
        rate = _mean_rate(context.motion.t, self.signal(context), velocity, steps, span, memory)
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
        return (Shape("hertz", "Hz", 0.2, 100.0, (8.0, 1.0, 3.0, 20.0, 50.0)),)

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
        """Return the last time, values and input, not known before the first sample."""
        return np.full(1 + 2 * MOST_JOINTS, np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the low pass of the total less the total."""
        signal = self.signal(context)
        lag = _low_pass(np.ascontiguousarray(context.motion.t), signal, float(shape[0]), memory) - signal
        return lag if self.joint is not None else lag[:, :, None]


@dataclass(frozen=True, eq=False)
class _Steps:
    """Dry friction (k,) that turns over speeds (k,)."""

    dry: FloatArray
    turns: FloatArray

    def at(self, velocity: FloatArray) -> FloatArray:
        """Return its force (N, k) at velocities (N, k)."""
        force: FloatArray = self.dry * np.tanh(velocity / self.turns)
        return force


def _mean_rate(
    t: FloatArray, x: FloatArray, velocity: FloatArray, steps: _Steps | None, span: float, memory: FloatArray
) -> FloatArray:
    """Mean rate of change (N, k) of x (N, k) over the span before each sample; before the first, x stands still."""
    joints = x.shape[1]
    known = memory.reshape(SAMPLES, 1 + 2 * MOST_JOINTS)[:, : 1 + 2 * joints]
    past = np.vstack([known[~np.isnan(known[:, 0])], np.column_stack([t, x, velocity])])
    kept = min(len(past), SAMPLES)
    known[SAMPLES - kept :] = past[-kept:]
    times, values, speeds = past[:, 0], past[:, 1 : 1 + joints], past[:, 1 + joints :]

    def then(of: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(t - span, times, of[:, j]) for j in range(joints)])

    earlier = then(values) if steps is None else then(values - steps.at(speeds)) + steps.at(then(speeds))
    rate: FloatArray = (x - earlier) / span
    return rate


@compiled
def _low_pass(t: FloatArray, x: FloatArray, hertz: float, memory: FloatArray) -> FloatArray:
    """First-order low pass, exact for an input that runs straight between samples; settled at the first.

    Samples of which an input is not known are passed over.
    """
    joints, rate = x.shape[1], 2.0 * np.pi * hertz
    out = np.empty_like(x)
    for k in range(len(t)):
        if np.isnan(x[k]).any():
            out[k] = np.nan
            continue
        kept, held = 0.0, 0.0
        if not np.isnan(memory[0]) and t[k] > memory[0]:
            past = rate * (t[k] - memory[0])
            kept = np.exp(-past)
            held = (1.0 - kept) / past
        for j in range(joints):
            last = x[k, j] if np.isnan(memory[0]) else memory[1 + MOST_JOINTS + j]
            late = x[k, j] if np.isnan(memory[0]) else memory[1 + j]
            late = kept * late + (1.0 - held) * x[k, j] + (held - kept) * last
            out[k, j] = late
            memory[1 + j], memory[1 + MOST_JOINTS + j] = late, x[k, j]
        memory[0] = t[k]
    return out
