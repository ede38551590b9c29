"""Rows of logs with what effects see of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.effects.base import Context, Effect
from ident.effects.direction import DirectedEffect
from ident.effects.hysteresis import LEAST_SLIP
from ident.gap.counts import encoder_counts
from ident.gap.cut_away import cut_away, filtered_again
from ident.gap.folds import log_numbers
from ident.gap.jolts import jolts
from ident.gap.standing import hardly_moved, of_motors
from ident.model import CurrentModel
from ident.robot import Robot
from ident.signals import Motion
from ident.walk import Block

Scalar = TypeVar("Scalar", bound=np.generic)


SEEN = 2.0
"""Counts of an encoder that a joint must move by for that to be seen."""

WHITE = 1.5
"""How many times the square of what white noise makes of a force noise may make, which is not quite white."""


@dataclass(frozen=True, eq=False)
class Panel:
    """Rows of logs with what effects see of them.

    Attributes:
        model: by whose gains and filter they were gathered.
        blocks: stretches of the logs; every one starts effects with memory anew.
        contexts: what effects see of each block, all its rows.
        rows: the rows of each block that are looked at.
        fold: number of the fold (N,) that each row looked at belongs to.
    """

    model: CurrentModel
    blocks: Sequence[Block]
    contexts: Sequence[Context]
    rows: Sequence[IntArray]
    fold: IntArray

    def __len__(self) -> int:
        return len(self.fold)

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.model.robot

    @cached_property
    def jolts(self) -> FloatArray:
        """Standard deviation (n,) of each joint's force by noise of the accelerations, in force units."""
        return jolts(self.model, self.blocks, self.rows)

    @cached_property
    def counts(self) -> FloatArray:
        """Counts (n,) of the motors' encoders [rad or m], the coarsest of all logs; nought where there are none."""
        coupling = self.robot.coupling
        positions = (b.log.q if coupling is None else coupling.motor_motion(b.log.q) for b in self.blocks)
        return np.asarray(np.max([encoder_counts(q) for q in positions], axis=0))

    @property
    def least_seen(self) -> FloatArray:
        """Displacements (n,) that coarse encoders hardly show [rad or m]; nought of finer ones, that show all slips."""
        least = SEEN * self.counts
        return np.where(least > LEAST_SLIP, least, 0.0)

    @cached_property
    def unseen(self) -> BoolArray:
        """Rows (N, n) in which joints have moved by less than their encoders show since they turned round."""
        return self.gather(lambda block: hardly_moved(of_motors(block, self.robot.coupling), self.least_seen))

    @property
    def jolted(self) -> FloatArray:
        """Squared residual (n,) a row that this noise may make."""
        return np.asarray(WHITE * self.jolts**2)

    @cached_property
    def cut_away(self) -> FloatArray:
        """Columns (N, n, 4) by which each joint's force may differ for what the filter cuts away of the motion."""
        return self.gather(lambda block: cut_away(self.model, block, self.filtered_again(block)))

    def filtered_again(self, block: Block) -> Motion:
        """A block's motion filtered once more."""
        if id(block) not in self._again:
            self._again[id(block)] = filtered_again(self.model, block, block.motion)
        return self._again[id(block)]

    def seen_by(self, model: CurrentModel) -> Panel:
        """The same rows with what effects see of them under another model."""
        return replace(self, contexts=[model.context(block.motion, total=True) for block in self.blocks])

    def columns(self, effect: Effect, shape: FloatArray, joint: int) -> FloatArray:
        """Columns (N, k) of an effect in a joint's rows."""
        effect = effect.in_row(joint)
        if effect.acts_on is None and len(effect.shapes) > 0:
            return self._of(effect, lambda context: effect.row(context, shape, effect.start(), joint))
        found = self.all_columns(effect, shape)
        return found[:, joint] if effect.acts_on is None else found

    def all_columns(self, effect: Effect, shape: FloatArray) -> FloatArray:
        """An effect's columns, (N, n, k) if it acts on all joints.

        Those without shape are kept, being asked often, and those where the search for one begins that must see the
        rows between: they are dear.
        """
        dear = self._seen_in_rows(effect) is None and _is_start(effect, shape)
        if (len(effect.shapes) > 0 and not dear) or not _hashable(effect):
            return self._columns(effect, shape)
        key = effect, *shape.tolist()
        if key not in self._kept:
            self._kept[key] = self._columns(effect, shape)
        return self._kept[key]

    def sweep(self, effect: Effect, shapes: Sequence[FloatArray], joint: int) -> Iterator[FloatArray]:
        """Yield the columns (N, k) of an effect in a joint's rows at each of several shapes."""
        context = self._seen_in_rows(effect)
        if len(shapes) > 1 and context is not None:
            for found in effect.sweep(context, np.array(shapes)):
                yield found[:, joint] if effect.acts_on is None else found
        else:
            yield from (self.columns(effect, shape, joint) for shape in shapes)

    def _columns(self, effect: Effect, shape: FloatArray) -> FloatArray:
        return self._of(effect, lambda context: effect.columns(context, shape, effect.start()))

    def _of(self, effect: Effect, what: Callable[[Context], FloatArray]) -> FloatArray:
        """Rows of what an effect says; one that remembers must see the rows between."""
        context = self._seen_in_rows(effect)
        return self._looked_up(what) if context is None else what(context)

    def _seen_in_rows(self, effect: Effect) -> Context | None:
        """What an effect sees of the rows looked at; None of one that must see those between at every shape."""
        if effect.start().size == 0:
            return self._looked_at
        if not isinstance(effect, DirectedEffect) or effect.remembers:
            return None
        key = effect.at, effect.presliding, effect.presliding_exponent
        if key not in self._directions:
            self._directions[key] = self._looked_up(lambda context: effect.direction(context, effect.start()))
        return replace(self._looked_at, direction=self._directions[key])

    def _looked_up(self, of: Callable[[Context], FloatArray]) -> FloatArray:
        return np.concatenate([of(context)[rows] for context, rows in zip(self.contexts, self.rows, strict=True)])

    @cached_property
    def _directions(self) -> dict[tuple[int, float, float], FloatArray]:
        return {}

    @cached_property
    def _again(self) -> dict[int, Motion]:
        return {}

    @cached_property
    def _kept(self) -> dict[tuple[Effect | float, ...], FloatArray]:
        return {}

    @cached_property
    def _looked_at(self) -> Context:
        """What effects without memory see of the rows looked at."""
        first = self.contexts[0]
        load, total = (None if getattr(first, what) is None else self.seen(what) for what in ("load", "total"))
        return Context(self.robot, self.motion, load, first.links, total)

    @cached_property
    def inertia(self) -> FloatArray:
        """Mean inertia (n,) of the links that each joint moves; nought of fitted ones that no body has."""
        own = np.diagonal(self._looked_at.inertia, axis1=1, axis2=2)
        return np.asarray(np.maximum(own.mean(axis=0), 0.0))

    @property
    def bodies_load(self) -> FloatArray:
        """Rows (N, n) [N m or N] of the force that the links need as the URDF has them."""
        return self._looked_at.bodies_load

    def seen(self, what: str) -> FloatArray:
        """Rows (N, n) of the ``load`` or ``total`` that effects see."""
        return np.concatenate([c.needed(what, "gap")[r] for c, r in zip(self.contexts, self.rows, strict=True)])

    def gather(self, of: Callable[[Block], npt.NDArray[Scalar]]) -> npt.NDArray[Scalar]:
        """Rows (N, ...) of whatever can be told of a block."""
        return np.concatenate([of(block)[rows] for block, rows in zip(self.blocks, self.rows, strict=True)])

    @cached_property
    def force(self) -> FloatArray:
        """Measured current in force units, (N, n)."""
        return self.gather(lambda block: block.log.current) * self.model.gain

    @cached_property
    def step(self) -> float:
        """Seconds between two rows that are looked at."""
        steps = [np.diff(block.motion.t[rows]) for block, rows in zip(self.blocks, self.rows, strict=True)]
        return float(np.median(np.concatenate(steps)))

    def around(self, rows: BoolArray, seconds: float) -> BoolArray:
        """Rows (N,) within seconds of others (N,) of the same block."""
        steps = max(1, round(seconds / self.step))
        blocks = np.split(rows, self.start[1:])
        return np.concatenate([binary_dilation(b, iterations=steps) if b.any() else b for b in blocks])

    def turns(self, sides: FloatArray, seconds: float) -> BoolArray:
        """Rows (N,) within seconds of which a sign (N,) changes."""
        changed = [np.diff(side, prepend=side[:1]) != 0 for side in np.split(sides, self.start[1:])]
        return self.around(np.concatenate(changed), seconds)

    @cached_property
    def motion(self) -> Motion:
        """Motion of the rows."""
        t = self.gather(lambda block: block.motion.t)
        q, dq = self.gather(lambda block: block.motion.q), self.gather(lambda block: block.motion.dq)
        return Motion(t, q, dq, self.gather(lambda block: block.motion.ddq))

    @property
    def velocity(self) -> FloatArray:
        """Velocities (N, n) of the motors, after which friction goes."""
        return self.motors.dq

    @property
    def motors(self) -> Motion:
        """Motion of the motors, that of the joints where no gears couple them."""
        return self._looked_at.motors

    @cached_property
    def log(self) -> IntArray:
        """Number of the log (N,) that each row is of."""
        return log_numbers(self.blocks, self.rows)

    @cached_property
    def start(self) -> IntArray:
        """Numbers of the rows looked at with which each block begins."""
        counts = [len(rows) for rows in self.rows]
        return np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)


def _is_start(effect: Effect, shape: FloatArray) -> bool:
    """Whether the search for an effect may begin at a shape."""
    return all(value in parameter.starts for parameter, value in zip(effect.shapes, shape.tolist(), strict=True))


def _hashable(effect: Effect) -> bool:
    try:
        hash(effect)
    except TypeError:
        return False
    return True
