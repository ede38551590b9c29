"""Rigid-body family, what was changed around the arm: a payload, the base's tilt, a gravity balancer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect, Shape
from ident.effects.survey import Survey

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True)
class Weighing(Effect):
    """A change of the whole arm that loads the joints in N m.

    Attributes:
        per_newton_metre: force units per N m of each joint, (n,); ones in a model whose drive gains are known.
    """

    per_newton_metre: tuple[float, ...] = ()

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on the whole robot."""
        return [cls(None, tuple(survey.per_newton_metre.tolist()))] if joint is None else []

    @property
    def rough(self) -> bool:
        """Whether the gains are unknown: force units per N m are then as wrong as the URDF's links."""
        return any(one != 1.0 for one in self.per_newton_metre)

    def in_force_units(self, columns: FloatArray) -> FloatArray:
        """Return columns (N, n, k) in N m in the model's force units."""
        return columns * np.array(self.per_newton_metre)[:, None] if self.per_newton_metre else columns


@dataclass(frozen=True)
class Payload(Weighing):
    """A body held by the last link that the model does not know (Khalil, Gautier and Lemoine 2007).

    Linear in its mass and moments. Most loads show by their weight alone: their inertia comes in where it shows, too.

    Attributes:
        inertia: whether its inertia about the last link's frame is part of it.
    """

    inertia: bool = False

    name = "payload"
    family = "rigid-body"
    rivals = ("drive-gain", "base-tilt")
    excitation = "static poses in which the wrist axes point several ways, against a model of the unloaded arm"

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return mass, first moments and, where it is part of it, inertia in the last link's frame."""
        moments = (Coefficient(name, "kg m") for name in ("mx", "my", "mz"))
        inertia = (Coefficient(name, "kg m^2") for name in ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz") if self.inertia)
        return (Coefficient("mass", "kg"), *moments, *inertia)

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return the load with its inertia."""
        return [] if self.inertia else [replace(self, inertia=True)]

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the link regressor's columns of the last link."""
        last = 10 * int(context.robot.multibody.tree.order[-1])
        return self.in_force_units(context.link_regressor[:, :, last : last + (10 if self.inertia else 4)])

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return mass and centre of mass."""
        mass = float(coefficients[0])
        return {"mass": mass, "com": (coefficients[1:4] / (mass if mass else np.nan)).tolist()}


@dataclass(frozen=True)
class BaseTilt(Weighing):
    """A base that does not stand as the model says: gravity comes from another side (roll about x, then pitch about y).

    Linear for the few degrees that a base is ever off; it loads an upright first joint, which no payload does. Links
    are needed one by one: those fitted are sums of parameters that act alike under upright gravity only.

    Attributes:
        links: inertial parameters (10 n,) of the links [SI]; those of the URDF where not given.
    """

    links: tuple[float, ...] = ()

    name = "base-tilt"
    family = "rigid-body"
    rivals = ("payload", "current-offset")
    excitation = "static poses all around the first axis"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on the whole robot, with its likeliest links."""
        links = tuple(survey.links.tolist())
        return [cls(None, tuple(survey.per_newton_metre.tolist()), links)] if joint is None else []

    @property
    def rough(self) -> bool:
        """It is: single links are known by the URDF more than by logs."""
        return True

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the two angles."""
        return (Coefficient("roll", "rad"), Coefficient("pitch", "rad"))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the weight of the links under gravity's change with roll and with pitch."""
        arm, rest = context.robot.multibody, np.zeros_like(context.motion.q)
        turned = [np.cross(np.asarray(arm.gravity, dtype=float), axis) for axis in np.eye(3)[:2]]
        body = context.robot.rigid_body
        links = np.array(self.links) if self.links else arm.parameters
        weights = [body.inverse_dynamics(context.motion.q, rest, rest, links, g) for g in turned]
        return self.in_force_units(np.stack(weights, axis=2))


NEUTRAL = tuple((0.25 * np.arange(-13, 14)).tolist())
"""Neutral angles [rad] from which a balancer's is searched: closer to one another than its side maxima."""


LIGHT = 0.1
"""Share of a joint's friction below which its links' weight is none that anybody balances."""

IDLE = 5
"""Parameters that a balancer of such a joint pays for: a few hundredths, by which no law is exact, must not name it."""


@dataclass(frozen=True)
class GravityBalancer(Effect):
    """A spring between two pins that relieves a joint of gravity (Chung et al. 2016).

    The pins, at radii a and b from the axis, are ``sqrt(a^2 + b^2 - 2 a b cos x)`` apart at the angle x from neutral.
    A spring of stiffness k and free length l pulls with the torque ``k a b sin x (1 - l / distance)``.

    Attributes:
        ideal: a spring without free length, which balances a weight wherever it is (Herder 2001): the pins' distance
            does not show.
        idle: whether the joint has no weight to be relieved of, as one about the vertical.
    """

    ideal: bool = False
    idle: bool = False

    name = "gravity-balancer"
    family = "rigid-body"
    kind = "spring"
    rivals = ("cable-spring", "payload")
    excitation = "the joint's whole range, slowly, with the joints beyond it in several poses"

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Try it on turning joints."""
        if joint is None or survey.robot.multibody.prismatic[joint]:
            return []
        return [cls(joint, idle=bool(survey.weight[joint] < LIGHT * survey.friction[joint]))]

    @property
    def charged(self) -> int:
        """Those of `IDLE` where nothing is to be balanced: hoses pull on such joints, too."""
        return IDLE if self.idle else 0

    def plainer(self) -> list[Effect]:
        """Return that without free length: over a part of the way the pins' distance hardly shows."""
        return [] if self.ideal else [replace(self, ideal=True)]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return 2 a b / (a^2 + b^2), if the pins' distance shows, and the neutral angle."""
        lever = Shape("lever", "1", 0.1, 0.995, (0.5, 0.75, 0.9), log=False, ends=(False, True))
        neutral = Shape("neutral", "{angle}", -3.6, 3.6, NEUTRAL, log=False)
        return (neutral,) if self.ideal else (lever, neutral)

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return the spring's torque on a long lever, and what its free length takes from it."""
        return (Coefficient("force", "{current}"), *(() if self.ideal else (Coefficient("preload", "{current}"),)))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return sin x and, with a free length, sin x over the pins' distance."""
        x = context.motion.q[:, self.at] - shape[-1]
        length = [] if self.ideal else [np.sin(x) / np.sqrt(1.0 - shape[0] * np.cos(x))]
        return np.stack([np.sin(x), *length], axis=1)
