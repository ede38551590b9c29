"""Transmission family: what gears and belts add between motor and joint."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape, Survey, ToldAtLargest

if TYPE_CHECKING:
    from ident.robot import Robot


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

LEAST_MIX = 0.2
"""Angle [rad] between a mix of two joints' motion and the joint's own below which it is the joint's own friction."""

POLE_HARMONICS = 16.0
"""Repeats a turn of the motor up to which its poles are looked for."""

APART = 3.0
"""Phase [rad] by which ripples must come apart over the angles seen, to be looked for one by one."""

REMEMBERED = 5
"""Samples before a row from which a load's derivatives are extrapolated."""


@dataclass(frozen=True)
class CrossJointFriction(Effect):
    """Friction of a motor whose speed mixes two joints, as in coupled wrists (Gautier and Poignet 2001, Staubli RX).

    Attributes:
        source: the other joint, from 0.
        side: sign of the other joint's share; 0 leaves it open, and lets the share vanish.
    """

    source: int = 0
    side: int = 0

    name = "cross-joint-friction"
    family = "transmission"
    contains = ("coulomb",)
    besides = 1
    rivals = ("coulomb", "viscous", "cross-joint-hysteresis")
    excitation = "the two joints moving alone, together and against one another"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try every other joint as the source, with the joint and against it."""
        if joint is None:
            return []
        return [cls(joint, k, side) for k in range(survey.robot.n) if k != joint for side in (1, -1)]

    @property
    def measured_on(self) -> int:
        """The other joint."""
        return self.source

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the angle that mixes the two joints' motion, and over which speed the mixed one's friction turns."""
        quarter = 0.25 * np.pi
        # At the bounds friction is that of the other joint's motion alone.
        lower = LEAST_MIX if self.side > 0 else -2 * quarter
        upper = -LEAST_MIX if self.side < 0 else 2 * quarter
        starts = tuple(x for x in (quarter, -quarter, 1.4, -1.4) if lower < x < upper)
        mix = Shape("mix", "rad", lower, upper, starts, log=False, ends=(self.side > 0, self.side < 0))
        # What turns over so wide a range of speeds as the upper bound is damping.
        return (mix, Shape("speed", "{angle}/s", 5e-4, 0.2, (0.02,), ends=(False, True)))

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return dry friction and damping against the mixed speed."""
        return (Coefficient("force", "{current}", lower=0.0), Coefficient("damping", "{current} s/{angle}"))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the sign of cos(mix) dq_joint + sin(mix) dq_source, turning over a speed, and the part dq_source."""
        own, other = self._speeds(context)
        mixed = np.cos(shape[0]) * own + np.sin(shape[0]) * other
        # The joint's own damping is the viscous effect's.
        return np.stack([np.tanh(mixed / shape[1]), other], axis=1)

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the mix and the speed."""
        own, other = self._speeds(context)
        mix, speed = float(shape[0]), float(shape[1])
        mixed, turned = np.cos(mix) * own + np.sin(mix) * other, np.cos(mix) * other - np.sin(mix) * own
        slope = (1.0 - np.tanh(mixed / speed) ** 2) / speed
        nought = np.zeros(len(other))
        return np.stack([np.stack([slope * d, nought], axis=1) for d in (turned, -mixed / speed)])

    def _speeds(self, context: Context) -> tuple[FloatArray, FloatArray]:
        return context.motion.dq[:, self.at], context.motion.dq[:, self.source]


@dataclass(frozen=True)
class GearRipple(Effect):
    """Force that repeats with the joint's angle: tooth meshing, run-out, the wave generator of a strain-wave gear.

    A gear's kinematic error may grow with the load that it carries: so does the ripple's amplitude then, linearly.

    Attributes:
        most, fewest: repeats a turn between which the search looks.
        harmonics: of the ripple, one or two.
        step: repeats a turn from one start of the search to the next.
        largest: largest force that the model gives on the logs, at which a ripple that grows with the load is told; one
            of one size has none.
    """

    most: float = 40.0
    fewest: float = 0.5
    harmonics: int = 1
    step: float = 1.0
    largest: float = 0.0

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
        """Return the ripple that grows with the load."""
        largest = float(survey.largest[self.at])
        return [] if self.largest > 0.0 or largest == 0.0 else [replace(self, largest=largest)]

    @property
    def needs(self) -> tuple[str, ...]:
        """The load, where the ripple grows with it."""
        return ("load",) if self.largest > 0.0 else ()

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the repeats a turn of the joint."""
        starts = tuple(np.arange(np.floor(self.fewest) + 1.0, self.most, self.step).tolist())
        return (Shape("per_turn", "1", self.fewest, self.most, starts, log=False),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return amplitudes in and out of phase with the joint's zero, of each harmonic; then by how much they grow."""
        names = ("force_sin", "force_cos", "force_sin2", "force_cos2")[: 2 * self.harmonics]
        grown = tuple(f"{name}_grown" for name in names) if self.largest > 0.0 else ()
        return tuple(Coefficient(name, "{current}") for name in names + grown)

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the amplitude, its repeats a turn, its phase at the joint's zero, and the second harmonic's.

        One that grows with the load is told at the largest force, and without load (``unloaded``).
        """
        without = coefficients[: 2 * self.harmonics]
        at_most = without + coefficients[len(without) :] if self.largest > 0.0 else without
        force, phase = float(np.hypot(*at_most[:2])), float(np.arctan2(at_most[1], at_most[0]))
        second = {"second_harmonic": float(np.hypot(*at_most[2:]))} if self.harmonics > 1 else {}
        unloaded = {"unloaded": float(np.hypot(*without[:2]))} if self.largest > 0.0 else {}
        return {"force": force, "per_turn": float(shape[0]), "phase": phase, **second, **unloaded}

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sine and cosine of once (and twice) per_turn times the angle; the same times the load's size."""
        phases = [k * shape[0] * context.motion.q[:, self.at] for k in range(1, self.harmonics + 1)]
        return self._grown(context, np.stack([wave(phase) for phase in phases for wave in (np.sin, np.cos)], axis=1))

    def sweep(self, context: Context, shapes: FloatArray) -> Iterator[FloatArray]:
        """Yield sine and cosine at each of several repeats a turn; evenly spaced ones by turning one phasor on."""
        per_turn, angle = shapes[:, 0], context.motion.q[:, self.at]
        if len(per_turn) < 3 or np.ptp(np.diff(per_turn)) > 1e-9:
            yield from super().sweep(context, shapes)
            return
        wave, onward = (np.exp(1j * turns * angle) for turns in (per_turn[0], per_turn[1] - per_turn[0]))
        for _ in per_turn:
            powers = itertools.accumulate([wave] * self.harmonics, np.multiply)
            yield self._grown(
                context, np.stack([part for power in powers for part in (power.imag, power.real)], axis=1)
            )
            wave = wave * onward

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the repeats a turn."""
        angle = context.motion.q[:, self.at]
        turned = [(k * angle, k * shape[0] * angle) for k in range(1, self.harmonics + 1)]
        slopes = [slope for by, phase in turned for slope in (by * np.cos(phase), -by * np.sin(phase))]
        return self._grown(context, np.stack(slopes, axis=1))[None]

    def _grown(self, context: Context, waves: FloatArray) -> FloatArray:
        """Waves (N, k) and, where they grow with the load, the same times its size, (N, 2 k)."""
        if self.largest == 0.0:
            return waves
        size = np.abs(context.needed("load", self.name)[:, self.at]) / self.largest
        return np.hstack([waves, waves * size[:, None]])


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


WOUND = 1e-2
"""Wind-up [rad or m] at the largest force for which an elasticity is taken that acts on all rows."""


@dataclass(frozen=True)
class Elasticity(ToldAtLargest):
    """A spring between motor and link (Spong 1987): the link lags behind the motor by the load over the stiffness.

    The motor carries what the links need where the link is, ``ID(q - wind, dq - wind', ddq - wind'')`` instead of
    ``ID(q, dq, ddq)``, and so does every other joint: the difference shows in all rows, and in most robots most in its
    own. It is taken for a wind-up of ``wound`` at the largest force and counts per unit of it: of as much it is exact,
    of any other it is the spring to first order in its compliance.

    A soft spring rings as the link swings on it: its wind-up e is no longer the load over the stiffness, and follows
    ``M e'' + D e' + (K + S) e = load`` (M the joint's own inertia, S by how much its load grows with its angle); what
    all rows lack is the force of ``e''`` and ``e``, to first order.

    Attributes:
        everywhere: whether it acts on all rows or on its own alone; without ringing, that has a fixed ``wound``.
        slow: whether the link only stands elsewhere, its speed and acceleration taken for the motor's: the load's
            derivatives are the positions' third and fourth, which in slow motion are noise.
        rings: whether the link swings on the spring, or follows the load at once.
    """

    everywhere: bool = False
    slow: bool = False
    rings: bool = False

    name = "elasticity"
    family = "transmission"
    needs = ("load", "links")
    rivals = ("rotor-inertia", "delay", "backlash")
    softens = True
    excitation = "fast motion: accelerations at a third of the resonance and above"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on a joint's own row, and on all rows as a cause of the whole robot that one joint has."""
        if joint is None:
            forms = ((False, False), (True, False), (False, True))
            return [cls(k, float(x), True, *form) for k, x in enumerate(survey.largest) for form in forms]
        return [cls(joint, float(survey.largest[joint]), rings=rings) for rings in (False, True)]

    @property
    def acts_on(self) -> int | None:
        """All rows, or the joint's own."""
        return None if self.everywhere else self.joint

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the wind-up at the largest force, of a spring that rings as if at rest, and its damping ratio."""
        if self.rings:
            wound = Shape("wound", "{angle}", 1e-4, 1.0, tuple(np.geomspace(3e-4, 0.3, 10).tolist()), ends=(True, True))
            return (wound, Shape("damping", "1", 0.005, 0.7, (0.05, 0.3), ends=(False, False)))
        if self.everywhere:
            return ()
        return (Shape("wound", "{angle}", 1e-4, 1.0, (1e-3, 1e-2, 0.1), ends=(False, True)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the wind-up at the largest force or, of a spring that rings, the link's share of the inertia."""
        return (Coefficient("share", "1", lower=0.3) if self.rings else Coefficient("wind_up", "{angle}", lower=0.0),)

    def start(self) -> FloatArray:
        """Return times and loads of the last samples, newest first, or wind-up, its speed, last pull and time."""
        if self.rings:
            return np.array([0.0, 0.0, 0.0, np.nan])
        return np.zeros(0) if self.slow else np.full(2 * REMEMBERED, np.nan)

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the change of the load by the wind-up, per unit of it; of a spring that rings, the change."""
        if self.rings:
            return self._swung(context, shape, memory)
        wound = WOUND if self.everywhere else float(shape[0])
        links, joint, motion = context.needed("links", self.name), self.at, context.motion
        load = context.needed("load", self.name)
        softness = wound / max(self.largest, 1e-12)
        link = np.stack([motion.q, motion.dq, motion.ddq])
        if self.slow:
            link[0, :, joint] -= softness * load[:, joint]
        else:
            past = memory.reshape(2, REMEMBERED)
            link[:, :, joint] -= softness * _with_derivatives(
                np.ascontiguousarray(motion.t), np.ascontiguousarray(load[:, joint]), past[0], past[1]
            )
        carried = context.robot.rigid_body.inverse_dynamics(link[0], link[1], link[2], links)
        change: FloatArray = (carried - load) / wound
        return change[:, :, None] if self.everywhere else change[:, joint, None]

    def _swung(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the change of the load as the link swings on its spring."""
        joint, load = self.at, context.needed("load", self.name)[:, self.at]
        inertia, slope = context.inertia[:, :, joint], context.slope(joint)
        own = inertia[:, joint]  # of fitted links, which may be none that exist
        real = own > 0.0
        stiff = np.maximum(self.largest / float(shape[0]) + slope[:, joint], 0.0)
        pull, square = (np.where(real, x / np.where(real, own, 1.0), 0.0) for x in (load, stiff))
        wound, onward = _swings(np.ascontiguousarray(context.motion.t), pull, square, float(shape[1]), memory)
        change: FloatArray = -(inertia * onward[:, None] + slope * wound[:, None])
        return change[:, :, None] if self.everywhere else change[:, joint, None]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the stiffness and, of a spring that rings, its damping ratio."""
        if self.rings:
            return {"stiffness": float(self.largest / shape[0] * coefficients[0]), "damping": float(shape[1])}
        return {"stiffness": float(self.largest / coefficients[0]) if coefficients[0] else float("inf")}


FASTEST = 2.0
"""Radians a sample by which a spring may ring; a stiffer one is as good as at rest."""


@compiled
def _swings(
    t: FloatArray, pull: FloatArray, square: FloatArray, damping: float, memory: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Wind-up (N,) of an oscillator, its angular frequency squared ``square`` (N,), and the acceleration of that.

    Exact for a pull that is linear between samples; those without one are passed over.
    """
    out, onward = np.zeros(len(t)), np.zeros(len(t))
    wound, speed, before, last = memory[0], memory[1], memory[2], memory[3]
    for k in range(len(t)):
        if np.isnan(pull[k]) or np.isnan(square[k]):
            out[k] = onward[k] = np.nan
            continue
        if square[k] <= 0.0:
            wound, speed = 0.0, 0.0
        elif np.isnan(last):
            wound, speed = pull[k] / square[k], 0.0
        else:
            step = t[k] - last
            turn = min(np.sqrt(square[k]), FASTEST / step)
            slope, rest = (pull[k] - before) / step / turn**2, before / turn**2
            late = 2.0 * damping / turn * slope
            off, speed = wound - rest + late, speed - slope
            swing, fade = turn * np.sqrt(1.0 - damping**2), np.exp(-damping * turn * step)
            sine, cosine = np.sin(swing * step), np.cos(swing * step)
            wound = rest + slope * step - late + fade * (off * cosine + (speed + damping * turn * off) / swing * sine)
            speed = slope + fade * (speed * cosine - (damping * turn * speed + turn**2 * off) / swing * sine)
            onward[k] = pull[k] - 2.0 * damping * turn * speed - turn**2 * wound
        out[k] = wound
        before, last = pull[k], t[k]
    memory[0], memory[1], memory[2], memory[3] = wound, speed, before, last
    return out, onward


@compiled
def _with_derivatives(t: FloatArray, x: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    """A signal with its first and second derivatives (3, N), from Newton's polynomial through the last samples.

    Both are nought until there are enough. ``times`` and ``values`` remember those before the first, newest first.
    """
    out, points = np.zeros((3, len(t))), len(times) + 1
    differences = np.empty(points)
    for k in range(len(t)):
        out[0, k], differences[0], differences[1:] = x[k], x[k], values
        if not np.isnan(times[-1]):
            for order in range(1, points):
                for i in range(points - 1, order - 1, -1):
                    span = times[i - 1] - (t[k] if i == order else times[i - order - 1])
                    differences[i] = (differences[i] - differences[i - 1]) / span
            # The product of (t - t_i) over the samples before the newest, and its derivative.
            product, slope = 1.0, 0.0
            for order in range(1, points):
                out[1, k] += differences[order] * product
                out[2, k] += 2.0 * differences[order] * slope
                step = t[k] - times[order - 1]
                product, slope = product * step, slope * step + product
        for i in range(len(times) - 1, 0, -1):
            times[i], values[i] = times[i - 1], values[i - 1]
        times[0], values[0] = t[k], x[k]
    return out
