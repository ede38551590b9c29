"""Hysteresis family: friction that remembers how the joint came to where it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.survey import Survey
from ident.effects.two_masses import LINK_FRICTION, link_behind, motor_inertia, searched_motor

if TYPE_CHECKING:
    from ident.robot import Robot


FINE_SPREAD = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Saturation displacements of the elements that gap tries, as multiples of the shape parameter."""

SPREAD = (0.25, 1.0, 4.0)
"""The same of those of a coarser curve."""

LEAST_SLIP = 1e-3
"""Displacement [rad or m] before slip below which a joint sticks: dry friction yields by that much in its gears."""


EMPTY = 0.02
"""Share of all elements' force below which one has none."""


@dataclass(frozen=True)
class MaxwellSlip(Effect):
    """Springs in parallel, each slipping at its own displacement (the paper's Eq. 1 and 2; Lampaert et al. 2002).

    At rest the elements keep the force they stopped with. Before a segment's first motion their state is unknown and
    taken as relaxed.

    Attributes:
        spread: saturation displacements of the elements as multiples of the shape parameter ``slip``.
    """

    spread: tuple[float, ...] = SPREAD

    name = "maxwell-slip"
    family = "hysteresis"
    contains = ("coulomb",)
    rivals = ("sigmoid", "stribeck", "backlash", "cross-joint-hysteresis")
    excitation = "small reversals and rests: a loop in position that is none in velocity"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it with elements enough to follow any curve of force over displacement."""
        return [] if joint is None else [cls(joint, FINE_SPREAD)]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the saturation displacement of the middle element."""
        return (Shape("slip", "{angle}", 1e-4, 0.1, (1e-3, 2.5e-4, 4e-3, 2e-2)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the saturation force of each element, never negative."""
        return _forces(self.spread)

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the force of all elements, and their mean saturation displacement weighted by force.

        Elements before a gap that slip where dry friction yields stand for that, and are told apart (``dry``).
        """
        lead = self._dry(float(shape[0]), coefficients)
        told = _together(float(shape[0]), self.spread[lead:], coefficients[lead:])
        return {**told, "dry": float(coefficients[:lead].sum())} if lead else told

    def mean_slip(self, shape: FloatArray, coefficients: FloatArray) -> float:
        """Return the mean saturation displacement [rad or m] of all elements, weighted by force."""
        return float(np.sum(_together(float(shape[0]), self.spread, coefficients)["slip"]))

    def _dry(self, slip: float, coefficients: FloatArray) -> int:
        """How many elements, the first ones, are dry friction."""
        empty = np.flatnonzero(coefficients < EMPTY * coefficients.sum())
        lead = int(empty[0]) if len(empty) else 0
        more = coefficients[lead:].sum() >= EMPTY * coefficients.sum()
        return lead if lead and more and slip * self.spread[lead - 1] < LEAST_SLIP else 0

    def start(self) -> FloatArray:
        """Return the elements' positions: not known before the first sample."""
        return np.full(len(self.spread), np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return each element's force over its saturation force."""
        slip = shape[0] * np.array(self.spread)
        position = np.ascontiguousarray(context.motors.q[:, self.at])
        forces: FloatArray = _slip_forces(position, slip, memory)
        return forces


@dataclass(frozen=True)
class CrossJointHysteresis(Effect):
    """A hysteretic force that another joint's motion drives: cables, seals and coupled gears that both joints move.

    One Maxwell element on the displacement of the other joint (the paper's Eq. 1 and 2 with that joint's position) or,
    where the joint's own motion drives it, too, several on the two joints' together, which brake that.

    Attributes:
        source: the other joint, from 0.
        side: whether both drive it as they turn the same way or against one another, 1 or -1; 0 where the other alone
            does.
    """

    source: int = 0
    side: int = 0

    name = "cross-joint-hysteresis"
    family = "hysteresis"
    rivals = ("cross-joint-friction", "maxwell-slip")
    excitation = "the other joint moving to and fro while this one stands or moves on"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try every other joint as the source."""
        return [] if joint is None else [cls(joint, k) for k in range(survey.robot.n) if k != joint]

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return those that both joints drive."""
        return [] if self.side else [replace(self, side=side) for side in (1, -1)]

    @property
    def measured_on(self) -> int:
        """The other joint."""
        return self.source

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the saturation displacement of the other joint and, where both drive it, the share of the own.

        Of both the displacement is at least twice that by which a joint sticks.
        """
        if self.side:
            return (Shape("slip", "{angle}", 2.0 * LEAST_SLIP, 0.5, (2e-2,)), Shape("own", "1", 0.05, 20.0, (1.0,)))
        return (Shape("slip", "{angle}", LEAST_SLIP, 0.5, (2e-3, 5e-3, 2e-2, 0.1)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the saturation force, or those of several elements."""
        return _forces(SPREAD) if self.side else (Coefficient("force", "{current}"),)

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return force and saturation displacement, and the share of the own motion."""
        if not self.side:
            return super().summary(robot, shape, coefficients)
        found = _together(float(shape[0]), SPREAD, coefficients)
        return {**found, "own": self.side * float(shape[1])}

    def start(self) -> FloatArray:
        """Return the elements' positions: not known before the first sample."""
        return np.full(len(SPREAD) if self.side else 1, np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the elements' forces over their saturation forces."""
        position, slip = context.motion.q[:, self.source], shape[:1]
        if self.side:
            position, slip = self.side * position + shape[1] * context.motion.q[:, self.at], shape[0] * np.array(SPREAD)
        forces: FloatArray = _slip_forces(np.ascontiguousarray(position), slip, memory)
        return forces


@dataclass(frozen=True)
class Backlash(Effect):
    """Play between motor and link: while the motor crosses the gap it goes without the link's load.

    Either friction holds the link, and the motor's place in the gap is a play operator on the joint's position (Nordin
    and Gutman 2002). Or the link flies from one flank to the other once its load changes sides, and knocks: two masses
    with a dead zone between them (their section 2.1), which all rows feel. Part of the joint's dry friction may brake
    the link and not the motor: the later that changes sides, the later the link flies.

    Attributes:
        falls: whether a link that is held is pressed against one flank by its load at rest.
        flies: whether the link flies through the gap, or friction holds it.
        everywhere: whether a knock is felt in all rows or in its own alone, as where other joints' drives yield to it.
        dry: the joint's dry friction, of which a share may brake a link that flies; nought where none does.
        motor: inertia of the joint that its links do not have by the URDF, nought where that is next to none. It is
            the motor's, which no gap carries: when the load of a link that flies changes sides depends on it.
    """

    falls: bool = True
    flies: bool = False
    everywhere: bool = False
    dry: float = 0.0
    motor: float = 0.0

    name = "backlash"
    family = "hysteresis"
    needs = ("load", "links")
    rivals = ("maxwell-slip", "elasticity")
    contains = ("elasticity",)
    excitation = "reversals under load, and changes of the load's sign"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try a link that is held or flies and, as a cause of the whole robot that one joint has, one that flies."""
        dry, motor = survey.holds.tolist(), survey.motor.tolist()
        if joint is None:
            every = range(survey.robot.n)
            return [cls(k, flies=True, everywhere=True, dry=dry[k], motor=motor[k]) for k in every]
        held: list[Effect] = [cls(joint, falls) for falls in (True, False)]
        return [*held, cls(joint, flies=True, dry=dry[joint], motor=motor[joint])]

    @property
    def softens(self) -> bool:
        """Whether flanks carry the load as springs do."""
        return self.flies

    @property
    def acts_on(self) -> int | None:
        """All rows, or the joint's own."""
        return None if self.everywhere else self.joint

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the gap and, of a link that flies, its ringing on a flank and what of the joint is its, or is not."""
        if not self.flies:
            return (Shape("gap", "{angle}", 2e-5, 2e-2, (1e-3, 2e-4, 4e-3)),)
        gap = Shape("gap", "{angle}", 2e-5, 5e-2, tuple(np.geomspace(6e-5, 3e-2, 16).tolist()))
        hertz = Shape("hertz", "Hz", 5.0, 100.0, (18.0,), ends=(True, False))
        damping = Shape("damping", "1", 0.02, 2.0, (0.3,), ends=(False, False))
        braked = (LINK_FRICTION,) if self.dry > 0.0 else ()
        return (gap, hertz, damping, *braked, *motor_inertia(self.motor))

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the share of the load that is missing inside the gap.

        A link that flies carries none, but knocks that are foretold too early and too late are so much smaller.
        """
        least = 0.5 if self.everywhere else LEAST_KNOCK
        return (Coefficient("share", "1", lower=least if self.flies else 0.0),)

    def start(self) -> FloatArray:
        """Return place in the gap and last position, or what two masses remember."""
        return np.array([0.0, 0.0, 0.0, 0.0, np.nan]) if self.flies else np.array([0.0, np.nan])

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return minus the load inside the gap or, of a link that flies, minus what its acceleration is short of."""
        if self.flies:
            return self._flown(context, shape, memory)
        load, motion, joint = context.needed("load", self.name), context.motors, self.at
        own, q, dq = (np.ascontiguousarray(x[:, joint]) for x in (load, motion.q, motion.dq))
        return (-own * _inside(q, dq, own, 0.5 * float(shape[0]), self.falls, memory))[:, None]

    def in_row(self, joint: int) -> Effect:
        """Return, at its own joint, one without what a knock does to all others."""
        return replace(self, everywhere=False) if self.everywhere and joint == self.joint else self

    def _flown(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return what forces lack as the link flies."""
        gap, hertz, damping = shape[:3].tolist()
        dry = float(shape[3]) * self.dry if self.dry > 0.0 else 0.0
        motor = searched_motor(self.motor, shape)
        inertia = context.inertia[:, :, self.at]
        own = np.maximum(inertia[:, self.at] - motor, 0.0)
        stiffness = (2.0 * np.pi * hertz) ** 2 * own
        _, ahead, rubbed = link_behind(context, self.at, stiffness, damping, dry, memory, gap, mean=True, motor=motor)
        felt = rubbed - own * ahead
        if not self.everywhere:
            return felt[:, None]
        short: FloatArray = -inertia * ahead[:, None]
        short[:, self.at] = felt
        return short[:, :, None]


def _forces(spread: tuple[float, ...]) -> tuple[Coefficient, ...]:
    """Saturation force of each element, never negative."""
    if len(spread) == 1:
        return (Coefficient("force", "{current}", lower=0.0),)
    return tuple(Coefficient(f"force_{k + 1}", "{current}", lower=0.0) for k in range(len(spread)))


def _together(slip: float, spread: tuple[float, ...], forces: FloatArray) -> dict[str, float | list[float]]:
    """Force of all elements, and their mean saturation displacement weighted by force."""
    force = float(forces.sum())
    return {"force": force, "slip": slip * float(np.array(spread) @ forces / force) if force > 0 else slip}


LEAST_KNOCK = 0.1
"""Share of a knock that must be there: a load off by a hundredth changes sides some milliseconds too early or late."""

ENGAGES = 8
"""Power of the place in the gap with which flanks engage: positions are noisy, and no tooth is all or nothing."""

RESTING = 1e-3
"""Speed [rad/s or m/s] below which a joint rests on one flank of its gap."""


@compiled
def _inside(
    q: FloatArray, dq: FloatArray, load: FloatArray, half: float, falls: bool, memory: FloatArray
) -> FloatArray:
    """Share of the load that is not carried: one in the middle of the gap, nought at its flanks.

    Samples without a position are passed over.
    """
    out = np.zeros(len(q))
    place, last = memory[0], memory[1]
    for k in range(len(q)):
        if np.isnan(q[k]):
            out[k] = np.nan
            continue
        if falls and (np.isnan(last) or abs(dq[k]) < RESTING):
            place = half if load[k] >= 0.0 else -half
        elif not np.isnan(last):
            place = min(max(place + q[k] - last, -half), half)
        last = q[k]
        out[k] = 1.0 - (place / half) ** ENGAGES
    memory[0], memory[1] = place, last
    return out


@compiled
def _slip_forces(z: FloatArray, slip: FloatArray, position: FloatArray) -> FloatArray:
    out = np.empty((len(z), len(slip)))
    for k in range(len(slip)):
        zeta = position[k]
        for t in range(len(z)):
            if np.isnan(zeta):
                zeta = z[t]
            stretch = z[t] - zeta
            if stretch >= slip[k]:
                zeta, stretch = z[t] - slip[k], slip[k]
            elif stretch <= -slip[k]:
                zeta, stretch = z[t] + slip[k], -slip[k]
            out[t, k] = stretch / slip[k]
        position[k] = zeta
    return out
