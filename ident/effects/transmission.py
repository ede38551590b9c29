"""Transmission family: what gears and belts add between motor and joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.friction import VelocityEffect

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True)
class CrossJointFriction(VelocityEffect):
    """Friction of a motor whose speed mixes two joints, as in coupled wrists (Gautier and Poignet 2001, Staubli RX).

    Attributes:
        source: the other joint, from 0.
    """

    source: int = 0

    name = "cross-joint-friction"
    family = "transmission"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return how much of the other joint's motion enters."""
        return (Shape("ratio", "1", -2.0, 2.0, (1.0, -1.0), log=False),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return dry friction and damping against the mixed speed."""
        return (Coefficient("force", "{current}"), Coefficient("damping", "{current} s/{angle}"))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the smoothed sign of dq_joint + ratio dq_source, and the part of it that is dq_source."""
        other = context.motion.dq[:, self.source]
        mixed = self.velocity(context) + shape[0] * other
        # The joint's own damping is the viscous effect's.
        return np.stack([np.tanh(mixed / self.smoothing), other], axis=1)

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the ratio."""
        other = context.motion.dq[:, self.source]
        sign = np.tanh((self.velocity(context) + shape[0] * other) / self.smoothing)
        return np.stack([(1 - sign**2) * other / self.smoothing, np.zeros(len(other))], axis=1)[None]


@dataclass(frozen=True)
class GearRipple(Effect):
    """Force that repeats with the joint's angle: tooth meshing, run-out, the wave generator of a strain-wave gear.

    Attributes:
        most: most repeats a turn that the search considers.
    """

    most: int = 40

    name = "gear-ripple"
    family = "transmission"

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the repeats a turn of the joint."""
        starts = tuple(np.arange(1.0, self.most).tolist())
        return (Shape("per_turn", "1", 0.5, float(self.most), starts, log=False),)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the amplitudes in and out of phase with the joint's zero."""
        return (Coefficient("force_sin", "{current}"), Coefficient("force_cos", "{current}"))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sine and cosine of per_turn times the angle."""
        phase = shape[0] * context.motion.q[:, self.at]
        return np.stack([np.sin(phase), np.cos(phase)], axis=1)

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Differentiate the columns by the repeats a turn."""
        angle = context.motion.q[:, self.at]
        phase = shape[0] * angle
        return np.stack([angle * np.cos(phase), -angle * np.sin(phase)], axis=1)[None]
