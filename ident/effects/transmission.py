"""Transmission family: what gears and belts add between motor and joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape, Survey

if TYPE_CHECKING:
    from ident.robot import Robot


FEWEST_REPEATS = 4.0
"""Fewer repeats a turn of the joint look like a cable, a balancer or the links' weight."""

USUAL_RATIO = 100.0
"""Gear ratio of a robot joint whose card names none."""

GEAR_HARMONICS = 2.5
"""A gear repeats at most this many times a turn of its motor (a wave generator twice); motor poles more often."""

POLE_HARMONICS = 8.0
"""Repeats a turn of the motor up to which its poles are looked for."""


@dataclass(frozen=True)
class CrossJointFriction(Effect):
    """Friction of a motor whose speed mixes two joints, as in coupled wrists (Gautier and Poignet 2001, Staubli RX).

    Attributes:
        source: the other joint, from 0.
    """

    source: int = 0

    name = "cross-joint-friction"
    family = "transmission"
    contains = ("coulomb",)
    rivals = ("coulomb", "viscous", "cross-joint-hysteresis")
    excitation = "the two joints moving alone, together and against one another"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try every other joint as the source."""
        if joint is None:
            return []
        return [cls(joint, k) for k in range(survey.robot.n) if k != joint]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return how much of the other joint's motion enters, and over which speed the mixed one's friction turns."""
        turn = Shape("speed", "{angle}/s", 5e-4, 0.2, (0.02,), ends=(False, False))
        return (Shape("ratio", "1", -2.0, 2.0, (1.0, -1.0), log=False), turn)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return dry friction and damping against the mixed speed."""
        return (Coefficient("force", "{current}", lower=0.0), Coefficient("damping", "{current} s/{angle}"))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the sign of dq_joint + ratio dq_source, turning over a speed, and the part of it that is dq_source."""
        other = context.motion.dq[:, self.source]
        mixed = context.motion.dq[:, self.at] + shape[0] * other
        # The joint's own damping is the viscous effect's.
        return np.stack([np.tanh(mixed / shape[1]), other], axis=1)

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the ratio and the speed."""
        other, speed = context.motion.dq[:, self.source], float(shape[1])
        mixed = context.motion.dq[:, self.at] + shape[0] * other
        slope = (1.0 - np.tanh(mixed / speed) ** 2) / speed
        nought = np.zeros(len(other))
        return np.stack([np.stack([slope * d, nought], axis=1) for d in (other, -mixed / speed)])


@dataclass(frozen=True)
class GearRipple(Effect):
    """Force that repeats with the joint's angle: tooth meshing, run-out, the wave generator of a strain-wave gear.

    Attributes:
        most, fewest: repeats a turn between which the search looks.
    """

    most: float = 40.0
    fewest: float = 0.5

    name = "gear-ripple"
    family = "transmission"
    rivals: ClassVar[tuple[str, ...]] = ("cogging", "cable-spring", "position-friction")
    excitation = "slow constant speeds, so that the ripple stays below half the sampling rate"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on turning joints, up to the repeats that a motor turn can have."""
        if joint is None or survey.robot.multibody.prismatic[joint]:
            return []
        return [cls(joint, most=most_of_gears(survey, joint), fewest=FEWEST_REPEATS)]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the repeats a turn of the joint."""
        starts = tuple(np.arange(np.floor(self.fewest) + 1.0, self.most).tolist())
        return (Shape("per_turn", "1", self.fewest, self.most, starts, log=False),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the amplitudes in and out of phase with the joint's zero."""
        return (Coefficient("force_sin", "{current}"), Coefficient("force_cos", "{current}"))

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the amplitude, its repeats a turn of the joint, and its phase at the joint's zero."""
        force, phase = float(np.hypot(*coefficients)), float(np.arctan2(coefficients[1], coefficients[0]))
        return {"force": force, "per_turn": float(shape[0]), "phase": phase}

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sine and cosine of per_turn times the angle."""
        phase = shape[0] * context.motion.q[:, self.at]
        return np.stack([np.sin(phase), np.cos(phase)], axis=1)

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the repeats a turn."""
        angle = context.motion.q[:, self.at]
        phase = shape[0] * angle
        return np.stack([angle * np.cos(phase), -angle * np.sin(phase)], axis=1)[None]


def most_of_gears(survey: Survey, joint: int) -> float:
    """Return the repeats a turn of a joint up to which its gear is looked for.

    Args:
        survey: what is known of robot and logs.
        joint: from 0.
    """
    ratio = survey.robot.gear_ratio
    return GEAR_HARMONICS * (USUAL_RATIO if ratio is None else max(abs(float(ratio[joint])), 2.0))


@dataclass(frozen=True)
class Elasticity(Effect):
    """A spring between motor and link (Spong 1987): the link lags behind the motor by the load over the stiffness.

    To first order in the compliance the motor then carries less inertia and another weight:
    ``-(M_jj load'' + d(load)/dq load) / stiffness``.
    """

    name = "elasticity"
    family = "transmission"
    needs = ("load", "links")
    rivals = ("rotor-inertia", "delay", "backlash")
    excitation = "fast motion: accelerations at a third of the resonance and above"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the compliance."""
        return (Coefficient("compliance", "{angle}/{current}", lower=0.0),)

    def start(self) -> FloatArray:
        """Return times and loads of the last two samples, not known before."""
        return np.full(4, np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the first-order change of the load by a unit of compliance."""
        links, joint = context.needed("links", self.name), self.at
        load = np.ascontiguousarray(context.needed("load", self.name)[:, joint])
        body, q, rest = context.robot.rigid_body, context.motion.q, np.zeros_like(context.motion.q)
        inertia = context.mass_matrix[:, joint, joint]
        step = np.zeros(context.robot.n)
        step[joint] = 1e-4
        sides = [body.inverse_dynamics(q + sign * step, rest, rest, links)[:, joint] for sign in (1.0, -1.0)]
        slope = (sides[0] - sides[1]) / 2e-4
        bend = _second_difference(np.ascontiguousarray(context.motion.t), load, memory)
        return -(inertia * bend + slope * load)[:, None]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the stiffness."""
        return {"stiffness": float(1.0 / coefficients[0]) if coefficients[0] else float("inf")}


@compiled
def _second_difference(t: FloatArray, x: FloatArray, memory: FloatArray) -> FloatArray:
    """Second derivative at the middle of the last three samples; nought until there are three."""
    out = np.zeros(len(t))
    t2, t1, x2, x1 = memory
    for k in range(len(t)):
        if not np.isnan(t2):
            out[k] = 2.0 * ((x[k] - x1) / (t[k] - t1) - (x1 - x2) / (t1 - t2)) / (t[k] - t2)
        t2, t1, x2, x1 = t1, t[k], x1, x[k]
    memory[0], memory[1], memory[2], memory[3] = t2, t1, x2, x1
    return out
