"""Which way friction points, by the velocity or by the displacement since the joint turned round."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Context, Effect
from ident.effects.survey import Survey

SMOOTHING = 5e-3
"""Speed [rad/s or m/s] over which the sign of a velocity turns, where the data do not ask for more."""

BEFORE_FIRST = np.array([np.nan, np.nan, np.nan, 0.0])
"""What is remembered of friction that builds up before the first sample: stamp, position, velocity and direction."""


@dataclass(frozen=True)
class VelocityEffect(Effect):
    """A friction effect; ``smoothing`` is the speed [rad/s or m/s] over which its sign of velocity turns."""

    smoothing: float = SMOOTHING

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it with the direction that the logs ask for."""
        return [] if joint is None else [cls.seen(survey, joint)]

    @classmethod
    def seen(cls, survey: Survey, joint: int, *options: float | None) -> Self:
        """Return the effect of a joint with the direction that the logs ask for, and options of its own in order."""
        return cls(joint, float(survey.smoothing[joint]), *options)

    def turned_as(self, friction: VelocityEffect) -> Self:
        """Return the same effect with the direction of another of its joint."""
        return replace(self, smoothing=friction.smoothing)

    def turns_over(self, shape: FloatArray) -> float:
        """Return the speed [rad/s or m/s] over which friction of that shape turns."""
        return self.smoothing

    def velocity(self, context: Context) -> FloatArray:
        """Return the velocity (N,) of the joint's motor."""
        return context.motors.dq[:, self.at]

    def sign(self, context: Context) -> FloatArray:
        """Return the sign of velocity (N,), which turns over the smoothing, from -1 to 1."""
        return np.tanh(self.velocity(context) / self.smoothing)


@dataclass(frozen=True)
class BuildsUp(Effect):
    """A friction effect whose direction may be the state of a Dahl (1968) element.

    Bearings and teeth yield before they slip, so that friction builds up over a displacement as the joint turns round,
    and stays where the joint stops. As the position changes, the direction z does by
    (1 - z sign(dq))^exponent / displacement.

    Attributes:
        presliding: displacement [rad or m] over which it would build up from none as it begins to; nought for none.
        presliding_exponent: from nought, where friction yields like a spring until it slips, to one.
    """

    presliding: float = field(default=0.0, kw_only=True)
    presliding_exponent: float = field(default=1.0, kw_only=True)

    def yielding(self, survey: Survey) -> Self:
        """Return the same effect that builds up as the dry friction of its joint does in the logs."""
        displacement, exponent = float(survey.presliding[self.at]), float(survey.presliding_exponent[self.at])
        return replace(self, presliding=displacement, presliding_exponent=exponent)

    def start(self) -> FloatArray:
        """Return what ``follow`` remembers; nothing without presliding."""
        return BEFORE_FIRST.copy() if self.presliding > 0.0 else np.zeros(0)

    def along(self, t: FloatArray, position: FloatArray, velocity: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the directions (N,) that build up along a path, carrying the memory forward; see ``build_up``."""
        return build_up(t, position, velocity, self.presliding, self.presliding_exponent, memory)


@dataclass(frozen=True)
class DirectedEffect(VelocityEffect, BuildsUp):
    """A friction effect that points against the motion: its direction builds up, or is the sign of velocity."""

    @property
    def remembers(self) -> bool:
        """Whether it remembers more than its direction."""
        return False

    @classmethod
    def seen(cls, survey: Survey, joint: int, *options: float | None) -> Self:
        """Return the effect of a joint with the direction that the logs ask for, and options of its own in order."""
        return super().seen(survey, joint, *options).yielding(survey)

    def turned_as(self, friction: VelocityEffect) -> Self:
        """Return the same effect with the direction of another of its joint."""
        plain = super().turned_as(friction)
        if not isinstance(friction, DirectedEffect):
            return plain
        return replace(plain, presliding=friction.presliding, presliding_exponent=friction.presliding_exponent)

    def direction(self, context: Context, memory: FloatArray) -> FloatArray:
        """Return the direction (N,) of the joint's motion, from -1 to 1, carrying the memory forward."""
        if context.direction is not None:
            return context.direction
        if self.presliding > 0.0:
            motors = context.motors
            return self.along(motors.t, motors.q[:, self.at], motors.dq[:, self.at], memory)
        return self.sign(context)


def build_up(
    t: FloatArray, position: FloatArray, velocity: FloatArray, displacement: float, exponent: float, memory: FloatArray
) -> FloatArray:
    """Directions (N,) along a path, each as ``follow`` gives it.

    Args:
        t: stamps (N,) [s].
        position: (N,) [rad or m].
        velocity: (N,) [rad/s or m/s].
        displacement: over which a direction builds up.
        exponent: Dahl's, from nought to one.
        memory: as ``follow`` has it, brought up to date.
    """
    built: FloatArray = _build_up(np.stack([t, position, velocity]), displacement, exponent, memory)
    return built


@compiled
def _build_up(path: FloatArray, displacement: float, exponent: float, memory: FloatArray) -> FloatArray:
    out = np.empty(path.shape[1])
    for k in range(path.shape[1]):
        out[k] = follow(path[0, k], path[1, k], path[2, k], displacement, exponent, memory)
    return out


@compiled
def follow(
    t: float, position: float, velocity: float, displacement: float, exponent: float, memory: FloatArray
) -> float:
    """Direction at a sample, by way of where the joint turned round since the last; the same where that is not known.

    Between samples the velocity runs straight: wrists turn, and their friction with them, within one.

    Args:
        t: stamp [s].
        position: [rad or m].
        velocity: [rad/s or m/s].
        displacement: over which a direction builds up.
        exponent: Dahl's, from nought to one.
        memory: stamp, position, velocity and direction of the last sample, brought up to date; see ``BEFORE_FIRST``.
    """
    step = position - memory[1]
    state = turned_round(memory[3], step, memory[2], velocity, t - memory[0], displacement, exponent)
    memory[0], memory[1], memory[2], memory[3] = t, position, velocity, state
    return state


@compiled
def turned_round(
    state: float, step: float, first: float, last: float, time: float, displacement: float, exponent: float
) -> float:
    """Direction after a step whose velocity runs straight, by way of where it changes sign if it does.

    Args:
        state: the direction before, from -1 to 1.
        step: change of position.
        first: velocity at its start.
        last: velocity at its end.
        time: that it takes [s].
        displacement: over which a direction builds up.
        exponent: Dahl's, from nought to one.
    """
    if first * last < 0.0:
        beyond = 0.5 * first * abs(first) / (abs(first) + abs(last)) * time
        state = built_up(state, beyond, displacement, exponent)
        step -= beyond
    return built_up(state, step, displacement, exponent)


@compiled
def built_up(state: float, step: float, displacement: float, exponent: float) -> float:
    """Direction after a step [rad or m] from another, exactly; the same where the step is not known.

    Args:
        state: the direction before, from -1 to 1.
        step: change of position.
        displacement: over which it builds up.
        exponent: Dahl's, from nought to one.
    """
    if not abs(step) > 0.0:
        return state
    sign = 1.0 if step > 0.0 else -1.0
    lacking, moved = 1.0 - sign * state, abs(step) / displacement
    if exponent > 0.999:
        lacking *= np.exp(-moved)
    else:
        left = lacking ** (1.0 - exponent) - (1.0 - exponent) * moved
        lacking = left ** (1.0 / (1.0 - exponent)) if left > 0.0 else 0.0
    return sign * (1.0 - lacking)
