"""Transmission family: what gears and belts add between motor and joint."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.direction import BuildsUp
from ident.effects.survey import Survey
from ident.effects.told_at_largest import ToldAtLargest
from ident.effects.two_masses import LINK_FRICTION, link_behind, motor_inertia, searched_motor

if TYPE_CHECKING:
    from ident.robot import Robot


LEAST_MIX = 0.2
"""Angle [rad] between a mix of two joints' motion and the joint's own below which it is the joint's own friction."""

ALONE = 1e-6
"""The same to the other joint's own below which the joint's own does not count."""

HARDLY = 0.1
"""That below which it counts so little that the force is told along the other joint's motion."""

REMEMBERED = 5
"""Samples before a row from which a load's derivatives are extrapolated."""


@dataclass(frozen=True)
class CrossJointFriction(BuildsUp):
    """Friction of a motor whose speed mixes two joints, as in coupled wrists (Gautier and Poignet 2001, Staubli RX).

    It turns over a speed or, with presliding, builds up over a displacement of the mixed motion.

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
        """Try every other joint as the source, with the joint and against it, yielding as the joint's friction does."""
        if joint is None:
            return []
        others = [k for k in range(survey.robot.n) if k != joint]
        return [cls(joint, k, side).yielding(survey) for k in others for side in (1, -1)]

    @property
    def measured_on(self) -> int:
        """The other joint."""
        return self.source

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the angle that mixes the two joints' motion, and the speed over which friction may turn."""
        quarter = 0.25 * np.pi
        # At the bounds friction is that of the other joint's motion alone. Where it builds up over a fraction of a
        # milliradian no search comes near enough to them.
        alone = 2 * quarter - ALONE
        lower = LEAST_MIX if self.side > 0 else -2 * quarter
        upper = -LEAST_MIX if self.side < 0 else 2 * quarter
        starts = tuple(x for x in (quarter, -quarter, 1.4, -1.4, alone, -alone) if lower < x < upper)
        mix = Shape("mix", "rad", lower, upper, starts, log=False, ends=(self.side > 0, self.side < 0))
        if self.presliding > 0.0:
            return (mix,)
        # What turns over so wide a range of speeds as the upper bound is damping.
        return (mix, Shape("speed", "{angle}/s", 5e-4, 0.2, (0.02,), ends=(False, True)))

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return dry friction against the mixed speed, below nought where the other joint drags this along; damping."""
        # Whose side is open must brake: it is chosen among frictions.
        least = -np.inf if self.side else 0.0
        return (Coefficient("force", "{current}", lower=least), Coefficient("damping", "{current} s/{angle}"))

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Name the parameters; where the joint's own speed hardly counts, force is that along the other's motion."""
        told = super().summary(robot, shape, coefficients)
        if shape[0] < HARDLY - 0.5 * np.pi:
            told.update(mix=float(shape[0] + np.pi), force=-float(coefficients[0]))
        return told

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the sign of cos(mix) dq_joint + sin(mix) dq_source, turning over a speed, and the part dq_source."""
        own, other = self._speeds(context)
        mixed = np.cos(shape[0]) * own + np.sin(shape[0]) * other
        if self.presliding > 0.0:
            motion = context.motion
            place = np.cos(shape[0]) * motion.q[:, self.at] + np.sin(shape[0]) * motion.q[:, self.source]
            return np.stack([self.along(motion.t, place, mixed, memory), other], axis=1)
        # The joint's own damping is the viscous effect's.
        return np.stack([np.tanh(mixed / shape[1]), other], axis=1)

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the mix and the speed."""
        if self.presliding > 0.0:
            return super().gradient(context, shape)
        own, other = self._speeds(context)
        mix, speed = float(shape[0]), float(shape[1])
        mixed, turned = np.cos(mix) * own + np.sin(mix) * other, np.cos(mix) * other - np.sin(mix) * own
        slope = (1.0 - np.tanh(mixed / speed) ** 2) / speed
        nought = np.zeros(len(other))
        return np.stack([np.stack([slope * d, nought], axis=1) for d in (turned, -mixed / speed)])

    def _speeds(self, context: Context) -> tuple[FloatArray, FloatArray]:
        return context.motion.dq[:, self.at], context.motion.dq[:, self.source]


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
    all rows lack is the force of ``e''`` and ``e``, to first order. Part of the joint's dry friction may brake the link
    and not the motor: each time the link turns round its spring winds the other way, and rings.

    Attributes:
        everywhere: whether it acts on all rows or on its own alone; without ringing, that has a fixed ``wound``.
        slow: whether the link only stands elsewhere, its speed and acceleration taken for the motor's: the load's
            derivatives are the positions' third and fourth, which in slow motion are noise.
        rings: whether the link swings on the spring, or follows the load at once.
        dry: the joint's dry friction, of which a share brakes a link that swings; nought where none does.
        least: wind-up of a braked spring by which its link rings at the filter's cut-off: how friction makes it ring
            beyond that is not seen, and what the filter smears of friction looks like it.
        motor: what a link that swings has not of the joint's inertia (see ``Backlash``), about; nought where all is
            taken for its own.
        even: the joint's mean inertia, of a spring whose link rings at one frequency in all poses; nought of one that
            has one stiffness.
    """

    everywhere: bool = False
    slow: bool = False
    rings: bool = False
    dry: float = 0.0
    least: float = 1e-4
    motor: float = 0.0
    even: float = 0.0

    name = "elasticity"
    family = "transmission"
    needs = ("load", "links")
    rivals = ("rotor-inertia", "delay", "backlash")
    softens = True
    excitation = "fast motion: accelerations at a third of the resonance and above"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on a joint's own row, and on all rows as a cause of the whole robot that one joint has."""
        everywhere = joint is None
        joints = range(survey.robot.n) if joint is None else (joint,)
        return [form for k in joints for form in cls._forms(survey, k, everywhere)]

    @classmethod
    def _forms(cls, survey: Survey, joint: int, everywhere: bool) -> list[Effect]:
        """Springs of a joint that give way at once or ring, braked or not."""
        largest, dry = float(survey.largest[joint]), float(survey.holds[joint])
        least = largest / max(float(survey.inertia[joint]) * (2.0 * np.pi * survey.cutoff) ** 2, 1e-12)
        plain = cls(joint, largest, everywhere)
        rings = replace(plain, rings=True)
        forms: list[Effect] = [plain, rings]
        if everywhere:
            forms += [replace(plain, slow=True), *rings.fuller(survey)]
        if dry > 0.0 and least < SOFTEST:
            forms.append(replace(plain, rings=True, dry=dry, least=least))
        return forms

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return a spring whose link lacks the motor's inertia and rings at one frequency, as of an axis by itself."""
        motor, even = float(survey.motor[self.at]), float(survey.inertia[self.at])
        plain = self.rings and self.dry == 0.0 and self.even == 0.0
        return [replace(self, motor=motor, even=even)] if plain and even > 0.0 else []

    @property
    def acts_on(self) -> int | None:
        """All rows, or the joint's own."""
        return None if self.everywhere else self.joint

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the wind-up at the largest force, of a spring that rings as if at rest, and what its link does."""
        if self.rings:
            low = max(self.least, 1e-4)
            starts = np.geomspace(max(3e-4, 1.3 * low), WIDEST, 10).tolist()
            wound = Shape("wound", "{angle}", low, 1.0, tuple(starts), ends=(True, True))
            damping = Shape("damping", "1", 0.005, 0.7, (0.1,) if self.dry > 0.0 else (0.05, 0.3), ends=(False, False))
            braked = (LINK_FRICTION,) if self.dry > 0.0 else ()
            return (wound, damping, *braked, *motor_inertia(self.motor))
        if self.everywhere:
            return ()
        return (Shape("wound", "{angle}", 1e-4, 1.0, (1e-3, 1e-2, 0.1), ends=(False, True)),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the wind-up at the largest force or, of a spring that rings, the link's share of the inertia."""
        return (Coefficient("share", "1", lower=0.3) if self.rings else Coefficient("wind_up", "{angle}", lower=0.0),)

    def start(self) -> FloatArray:
        """Return times and loads of the last samples, newest first, or what two masses remember."""
        if self.rings:
            return np.array([0.0, 0.0, 0.0, 0.0, np.nan])
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
            link[0] -= softness * np.outer(load[:, joint], context.moved_by(joint))
        else:
            past = memory.reshape(2, REMEMBERED)
            wind = _with_derivatives(
                np.ascontiguousarray(motion.t), np.ascontiguousarray(load[:, joint]), past[0], past[1]
            )
            link -= softness * wind[:, :, None] * context.moved_by(joint)
        body, own = context.robot.rigid_body, None if self.everywhere else joint
        carried = body.inverse_dynamics(link[0], link[1], link[2], links, joint=own)
        change: FloatArray = (carried - (load if own is None else load[:, own])) / wound
        return change[..., None]

    def in_row(self, joint: int) -> Effect:
        """Return, at its own joint, one that rings without what swinging does to all others."""
        return replace(self, everywhere=False) if self.everywhere and self.rings and joint == self.joint else self

    def _swung(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the change of the load as the link swings on its spring."""
        joint, inertia, slope = self.at, context.inertia[:, :, self.at], context.slope(self.at)
        dry = float(shape[2]) * self.dry if self.dry > 0.0 else 0.0
        motor = searched_motor(self.motor, shape)
        stiffness = np.full(len(inertia), self.largest / float(shape[0]))
        if self.even > 0.0:
            stiffness *= np.maximum(inertia[:, joint] - motor, 0.0) / self.even
        stiffness = np.maximum(stiffness + slope[:, joint], 0.0)
        wound, onward, rubbed = link_behind(context, joint, stiffness, float(shape[1]), dry, memory, motor=motor)
        rubbed += np.minimum(motor, inertia[:, joint]) * onward
        if not self.everywhere:
            return (rubbed - inertia[:, joint] * onward - slope[:, joint] * wound)[:, None]
        change: FloatArray = -(inertia * onward[:, None] + slope * wound[:, None])
        change[:, joint] += rubbed
        return change[:, :, None]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return the stiffness and, of a spring that rings, damping ratio and share of dry friction on its link."""
        if self.rings:
            stiffness = float(self.largest / shape[0] * coefficients[0])
            braked = {LINK_FRICTION.name: float(shape[2])} if self.dry > 0.0 else {}
            if self.even > 0.0:
                stiffness *= 1.0 - searched_motor(self.motor, shape) / self.even
            return {"stiffness": stiffness, "damping": float(shape[1]), **braked}
        return {"stiffness": float(self.largest / coefficients[0]) if coefficients[0] else float("inf")}


WIDEST = 0.3
"""Largest wind-up with which the search for a spring that rings begins."""

SOFTEST = 0.2
"""Largest wind-up by which a braked link may ring at the cut-off; of a softer one what it does is not seen."""


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
