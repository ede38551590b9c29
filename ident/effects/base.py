"""What an effect is: one physical cause of motor current."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.errors import InputError

if TYPE_CHECKING:
    from ident.effects.survey import Survey
    from ident.robot import Robot
    from ident.signals import Motion

SLOPE = 1e-4
"""Angle [rad or m] over which the slope of the links' force is taken."""

STEP = 1e-6
"""Relative step of the central differences that stand in for a gradient an effect does not give."""


@dataclass(frozen=True)
class Shape:
    """A parameter on which an effect's columns depend non-linearly.

    Attributes:
        name, unit: as for a coefficient; ``{angle}`` stands for rad, or m on a prismatic joint.
        lower, upper: physical bounds.
        starts: values from which the search may start; the best of them is taken.
        log: whether it is searched on a logarithmic scale.
        ends: whether a value at the lower and at the upper bound says that the law is not this one; not where the bound
            is but the logs' reach.
    """

    name: str
    unit: str
    lower: float
    upper: float
    starts: tuple[float, ...]
    log: bool = True
    ends: tuple[bool, bool] = (True, True)

    def place(self, value: float) -> float:
        """Where a value is on the scale on which it is searched."""
        return math.log(value) if self.log else value

    def value(self, place: float) -> float:
        """The value at a place of that scale."""
        return math.exp(place) if self.log else place


@dataclass(frozen=True)
class Coefficient:
    """A parameter in which the current is linear; ``{current}`` in its unit stands for the model's force unit.

    Attributes:
        name: of the parameter within its effect.
        unit: with the placeholders ``{current}`` and ``{angle}``.
        lower: physical bound, minus infinity where there is none.
    """

    name: str
    unit: str
    lower: float = -np.inf


@dataclass(frozen=True)
class Context:
    """What effects see of a log.

    Attributes:
        robot: the robot.
        motion: its motion, N samples.
        load: force (N, n) that its links need; given to effects with ``load`` among their ``needs``.
        links: link parameters (n, 10 n) that row j of the links' equations uses, in force units (``links``).
        total: force (N, n) of all effects that do not themselves need the total (``total``).
        direction: direction (N,) of friction of the joint that is asked for, where it is known already.
    """

    robot: Robot
    motion: Motion
    load: FloatArray | None = None
    links: FloatArray | None = None
    total: FloatArray | None = None
    direction: FloatArray | None = None

    @cached_property
    def motors(self) -> Motion:
        """Motion of the motors, that of the joints where no gears couple them."""
        return self.robot.motors(self.motion)

    def rows(self, which: slice | BoolArray) -> Context:
        """Return what effects see of some rows alone: a slice, or those of N that are marked, if nothing remembers."""

        def of(values: FloatArray | None) -> FloatArray | None:
            return None if values is None else values[which]

        motion, load, total = self.motion[which], of(self.load), of(self.total)
        return Context(self.robot, motion, load, self.links, total, of(self.direction))

    def needed(self, what: str, by: str) -> FloatArray:
        """Return ``load``, ``links`` or ``total``.

        Raises:
            InputError: the context was made without it.
        """
        value: FloatArray | None = getattr(self, what)
        if value is None:
            raise InputError(f"it needs the {what} of a fitted model", f"effect {by}", f"give a Context with {what}")
        return value

    @cached_property
    def link_regressor(self) -> FloatArray:
        """Joint torque regressor (N, n, 10 n) of the links, computed once for all effects that need it."""
        return self.robot.rigid_body.regressor(self.motion.q, self.motion.dq, self.motion.ddq)

    @cached_property
    def bodies_load(self) -> FloatArray:
        """Force (N, n) [N m or N] that the links need as the URDF has them; computed once."""
        motion, bodies = self.motion, self.robot.multibody.parameters
        return self.robot.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, bodies)

    @cached_property
    def inertia(self) -> FloatArray:
        """Inertia matrix (N, n, n) of the links as motors feel it, row j by those that row j uses; computed once."""
        # Each element's samples side by side: effects look at one joint's.
        return np.asfortranarray(self.robot.rigid_body.mass_matrix(self.motion.q, self.needed("links", "inertia")))

    def slope(self, joint: int) -> FloatArray:
        """Return by how much the links' force (N, n) grows with a motor's angle; computed once a joint."""
        if joint not in self._slopes:
            links, motion = self.needed("links", "slope"), self.motion
            sides = []
            for side in (0.5 * SLOPE, -0.5 * SLOPE):
                moved = motion.q + side * self.moved_by(joint)
                sides.append(self.robot.rigid_body.inverse_dynamics(moved, motion.dq, motion.ddq, links))
            self._slopes[joint] = np.asfortranarray(sides[0] - sides[1]) / SLOPE
        return self._slopes[joint]

    def moved_by(self, joint: int) -> FloatArray:
        """Return how far all joints (n,) move as the motor of one turns by one."""
        coupling = self.robot.coupling
        return (np.eye(self.robot.n) if coupling is None else coupling.joints)[:, joint]

    @cached_property
    def _slopes(self) -> dict[int, FloatArray]:
        return {}


@dataclass(frozen=True)
class Effect(ABC):
    """One physical cause of current, acting on one joint or, with ``joint`` None, on the whole robot.

    The current it causes is ``columns(...) @ coefficients``. Columns depend on the motion, on shape parameters and, for
    effects that remember, on a ``memory`` array that ``columns`` carries forward in place: a log walked in blocks or
    sample by sample gives the same columns as the whole log.

    A subclass with a ``name`` is entered in the catalogue; that is all it takes to add an effect.

    Attributes:
        joint: joint it belongs to, from 0; None is the whole robot, with one set of coefficients.
        replaces: names of effects that it contains as a limit, and that leave a joint's model when it comes in.
        contains: names of effects that it has as a limit; where they are missing, they are named before it.
        besides: how many of its columns, the last ones, come with its law and alone are not it.
        leads: whether it is its law only where the first of its columns has a share.
        rivals: names of effects that it is easily taken for.
        kind: what it shares with effects that, together, could be any law; a joint is given one of a kind.
        excitation: what the motion must contain for the effect to show.
    """

    joint: int | None

    name: ClassVar[str] = ""
    family: ClassVar[str] = ""
    replaces: ClassVar[tuple[str, ...]] = ()
    contains: ClassVar[tuple[str, ...]] = ()
    besides: ClassVar[int] = 0
    leads: ClassVar[bool] = False
    rivals: ClassVar[tuple[str, ...]] = ()
    kind: ClassVar[str] = ""
    excitation: ClassVar[str] = "motion of the joint"
    catalogue: ClassVar[dict[str, type[Effect]]] = {}

    def __init_subclass__(cls) -> None:
        # A name that is but inherited is that of the class above.
        if cls.__dict__.get("name"):
            Effect.catalogue[cls.name] = cls

    @property
    def needs(self) -> tuple[str, ...]:
        """What of a fitted model its columns depend on: ``load``, ``links``, ``total``; a class may set it."""
        return ()

    @property
    def softens(self) -> bool:
        """Whether it takes from fast changes of the model's force, and so from noise in it; a class may set it."""
        return False

    @property
    def charged(self) -> int:
        """How many parameters more than it has it pays for, where it is an unlikely cause; a class may set it."""
        return 0

    @property
    def measured_on(self) -> int | None:
        """The joint whose position ``{angle}`` stands for in units: its own, unless another's motion drives it."""
        return self.joint

    @property
    def at(self) -> int:
        """The joint of an effect that belongs to one joint.

        Raises:
            InputError: it belongs to the whole robot.
        """
        if self.joint is None:
            raise InputError("it needs a joint", f"effect {self.name}", "give joint=0 for the first joint")
        return self.joint

    @property
    def acts_on(self) -> int | None:
        """The joint on whose row it acts: its own; None on all rows, as the whole robot's and what all feel of one."""
        return self.joint

    def rivals_with(self, other: Effect) -> bool:
        """Return whether either is easily taken for the other."""
        return other.name in self.rivals or self.name in other.rivals

    def fuller(self, survey: Survey) -> list[Effect]:
        """Return forms of the law with more in it, tried from its best shape where it is among the likeliest.

        Args:
            survey: facts about the logs.
        """
        return []

    def plainer(self) -> list[Effect]:
        """Return forms of the law with less in it, tried where a shape parameter ends at its bound."""
        return []

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Shape parameters, none by default."""
        return ()

    @abstractmethod
    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Linear parameters, one for each column."""

    @abstractmethod
    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Columns (N, k) at the joint that it acts on, or (N, n, k) if on all, per unit of each coefficient."""

    def sweep(self, context: Context, shapes: FloatArray) -> Iterator[FloatArray]:
        """Yield the columns at each of several shapes (m, s), from the start of a segment.

        One after the other unless a subclass knows a cheaper way.
        """
        for shape in shapes:
            yield self.columns(context, shape, self.start())

    def row(self, context: Context, shape: FloatArray, memory: FloatArray, joint: int) -> FloatArray:
        """Columns (N, k) at one of the joints that the effect acts on."""
        alone = self.in_row(joint)
        columns = alone.columns(context, shape, memory)
        return columns[:, joint] if alone.acts_on is None else columns

    def in_row(self, joint: int) -> Effect:
        """Return the form of the effect that says the same of that joint's row, and no other: itself by default."""
        return self

    def start(self) -> FloatArray:
        """Memory as it stands at the start of a segment; empty for effects without memory."""
        return np.zeros(0)

    @classmethod
    def candidates(cls, survey: Survey, joint: int | None) -> list[Effect]:
        """Forms in which the gap workflow tries the effect on one joint, or (None) on the whole robot.

        By default one form on every joint and none on the whole robot.
        """
        return [] if joint is None else [cls(joint)]

    def summary(self, robot: Robot, shape: FloatArray, coefficients: FloatArray) -> dict[str, float | list[float]]:
        """Return what a finding reports of the fitted effect, by the contract's keys.

        By default every shape parameter and coefficient under its own name.
        """
        names = [s.name for s in self.shapes] + [c.name for c in self.coefficients(robot)]
        return dict(zip(names, [*shape.tolist(), *coefficients.tolist()], strict=True))

    @property
    def rough(self) -> bool:
        """Whether what it adds is known but for a factor near one on each joint."""
        return False

    def plain(self, shape: FloatArray) -> FloatArray | None:
        """Return the only coefficients that its law means at a shape; None, the default, where it means any."""
        return None

    def current(self, context: Context, shape: FloatArray, coefficients: FloatArray, memory: FloatArray) -> FloatArray:
        """Current (N,) at the joint that it acts on, or (N, n), that the effect causes."""
        return self.columns(context, shape, memory) @ coefficients

    def gradient(self, context: Context, shape: FloatArray) -> FloatArray:
        """Derivative (shapes, N, k) of the columns by each shape parameter, from the start of a segment.

        Central differences unless a subclass knows better.
        """
        derivatives = []
        for s, parameter in enumerate(self.shapes):
            step = STEP * max(abs(shape[s]), 1e-3 * (parameter.upper - parameter.lower))
            along = np.where(np.arange(len(shape)) == s, step, 0.0)
            above, below = (self.columns(context, shape + by, self.start()) for by in (along, -along))
            derivatives.append((above - below) / (2 * step))
        return np.array(derivatives)


@dataclass(frozen=True, eq=False)
class Term:
    """An effect with its fitted parameters.

    Attributes:
        effect: the cause.
        shape: values of its shape parameters (in the order of ``effect.shapes``).
        coefficients: values of its linear parameters.
        std: standard deviations of the coefficients; NaN where a parameter is not determined.
        shape_std: standard deviations of the shape parameters.
        errors: k independent errors (c, k) of one standard deviation, which all terms share; none if not known.
    """

    effect: Effect
    shape: FloatArray = field(default_factory=lambda: np.zeros(0))
    coefficients: FloatArray = field(default_factory=lambda: np.zeros(0))
    std: FloatArray = field(default_factory=lambda: np.zeros(0))
    shape_std: FloatArray = field(default_factory=lambda: np.zeros(0))
    errors: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


def initial_term(effect: Effect) -> Term:
    """Return the effect with its shape parameters at their first starts and no coefficients yet.

    Args:
        effect: of the catalogue, or one's own.
    """
    return Term(effect, np.array([s.starts[0] for s in effect.shapes], dtype=float))
