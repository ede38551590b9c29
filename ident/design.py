"""The linear regression behind a list of effects: which column belongs to which joint, term and coefficient."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.effects.base import Coefficient, Context, Effect, Term
from ident.robot import Robot
from ident.signals import Motion
from ident.walk import Block

Known = Callable[[Motion], Context]
"""Gives what effects see of a motion, with the load, links or total of a model that is already known."""

Counts = Callable[[Block], BoolArray]
"""Gives which joints' rows (N, n) of a block count."""


@dataclass(frozen=True)
class Rows:
    """Regression rows of consecutive samples: a matrix (N, shared columns, own columns) a joint, and targets (N, n).

    ``counts`` (N, n) says which count, all where it is not given; the others are nought.
    """

    matrices: list[FloatArray]
    target: FloatArray
    counts: BoolArray | None = None

    @property
    def counted(self) -> FloatArray:
        """Number of rows (n,) that count for each joint."""
        full = np.full(self.target.shape[1], float(len(self.target)))
        return full if self.counts is None else self.counts.sum(axis=0).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Seen:
    """What effects see of a block: those that remember of all rows, the others of those alone that are learnt from.

    Attributes:
        every: of all rows.
        kept: of those to learn from.
        keep: which these are, (N,).
    """

    every: Context
    kept: Context
    keep: BoolArray

    @staticmethod
    def of(context: Context, keep: BoolArray) -> Seen:
        """What is seen of rows of which some (N,) are learnt from."""
        return Seen(context, context.rows(keep), keep)

    def by(self, effect: Effect) -> tuple[Context, BoolArray | slice]:
        """Return what an effect is asked with, and the rows of its answer that are learnt from."""
        return (self.every, self.keep) if effect.start().size > 0 else (self.kept, slice(None))


@dataclass(frozen=True)
class Design:
    """Columns of a model's linear parameters.

    Every joint's row has columns of its own and columns whose coefficients all joints share. Columns are numbered
    joint by joint, after the shared ones.

    Attributes:
        robot: the robot.
        terms: effects with shape values; coefficients are not used.
        scale: force unit per unit of current, (n,): the drive gains where they are known, else ones.
        known: what is known of the model already; needed by effects that depend on it.
        counts: which joints' rows (N, n) of a block count; all where not given.
    """

    robot: Robot
    terms: tuple[Term, ...]
    scale: FloatArray
    known: Known | None = None
    counts: Counts | None = None
    _columns: list[IntArray] = field(init=False, repr=False)
    _of_term: list[IntArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        columns: list[list[int]] = [[] for _ in range(self.robot.n)]
        of_term: list[list[int]] = [[] for _ in self.terms]
        count = 0
        for joint in [None, *range(self.robot.n)]:
            for k, term in enumerate(self.terms):
                if term.effect.acts_on != joint:
                    continue
                numbers = range(count, count + len(term.effect.coefficients(self.robot)))
                count = numbers.stop
                of_term[k].extend(numbers)
                for j in range(self.robot.n) if joint is None else [joint]:
                    columns[j].extend(numbers)
        object.__setattr__(self, "_columns", [np.array(c, dtype=np.int64) for c in columns])
        object.__setattr__(self, "_of_term", [np.array(c, dtype=np.int64) for c in of_term])

    @property
    def count(self) -> int:
        """Number of linear parameters."""
        return sum(len(c) for c in self._of_term)

    def columns_of_joint(self, joint: int) -> IntArray:
        """Parameter numbers of the columns in a joint's matrix."""
        return self._columns[joint]

    def columns_of_term(self, term: int) -> IntArray:
        """Parameter numbers of a term's coefficients."""
        return self._of_term[term]

    def coefficients(self) -> list[tuple[int, Coefficient]]:
        """Every parameter as (number of its term, coefficient), by parameter number."""
        found: list[tuple[int, Coefficient]] = [(0, Coefficient("", ""))] * self.count
        for k, term in enumerate(self.terms):
            for number, coefficient in zip(self._of_term[k], term.effect.coefficients(self.robot), strict=True):
                found[number] = (k, coefficient)
        return found

    def context(self, motion: Motion) -> Context:
        """Return what the effects see of a motion."""
        return Context(self.robot, motion) if self.known is None else self.known(motion)

    def seen(self, block: Block) -> Seen:
        """Return what the effects see of a block."""
        return Seen.of(self.context(block.motion), block.keep)

    def matrix(self, seen: Seen, memories: list[FloatArray], joint: int) -> FloatArray:
        """Regression matrix of one joint's row of the samples to learn from; carries its terms' memories forward."""
        acting = [
            (term, memory)
            for term, memory in zip(self.terms, memories, strict=True)
            if term.effect.acts_on in (None, joint)
        ]
        acting.sort(key=lambda pair: pair[0].effect.acts_on is not None)
        columns = [np.zeros((len(seen.kept.motion), 0))]
        for term, memory in acting:
            context, rows = seen.by(term.effect)
            columns.append(term.effect.row(context, term.shape, memory, joint)[rows])
        return np.hstack(columns)

    def matrices(self, seen: Seen, memories: list[FloatArray]) -> list[FloatArray]:
        """Regression matrices of all joints' rows."""
        last = self.robot.n - 1
        return [self.matrix(seen, self._for(memories, joint == last), joint) for joint in range(last + 1)]

    def _for(self, memories: list[FloatArray], last: bool) -> list[FloatArray]:
        """Memories for one joint's row: an effect of the whole robot is asked for every row and must move on once."""
        return [
            memory if last or term.effect.acts_on is not None else memory.copy()
            for term, memory in zip(self.terms, memories, strict=True)
        ]

    def start(self) -> list[FloatArray]:
        """Memories of the terms at the start of a segment."""
        return [term.effect.start() for term in self.terms]

    def counted(self, block: Block, joint: int) -> BoolArray:
        """Which of the rows to learn from of a block count for a joint."""
        return np.ones(int(block.keep.sum()), bool) if self.counts is None else self.counts(block)[block.keep, joint]

    def rows(self, blocks: Iterable[Block]) -> Iterator[Rows]:
        """Yield the regression rows of the rows that each block keeps."""
        memories = self.start()
        for block in blocks:
            if block.first:
                memories = self.start()
            matrices = self.matrices(self.seen(block), memories)
            target = block.log.current[block.keep] * self.scale
            counts = None if self.counts is None else self.counts(block)[block.keep]
            if counts is None or counts.all():
                yield Rows(matrices, target)
            else:
                yield Rows([m * counts[:, j, None] for j, m in enumerate(matrices)], target * counts, counts)
