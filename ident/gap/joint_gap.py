"""One joint's rows before anything is named, and names found for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.effects.base import Effect
from ident.gap.candidates import Trial, admissible, best_shape, coefficients, force_of, usable
from ident.gap.folds import even_folds, goes_beyond
from ident.gap.gate import Gate, speed_classes
from ident.gap.panel import Panel
from ident.gap.problem import LEAST, JointProblem, costs, sizes

PARTS = 3
"""Parts of each fold in each log, where one would move far beyond the others."""

SCARCE = 0.25
"""Share of an even one below which a fold has too few rows: one of a joint that stands while others are moved."""

HARDLY = 0.2
"""Share of what all folds tell of an effect below which those without one hardly tell of it."""


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that is taken for a cause.

    Attributes:
        trial: the effect with its shape and held-out errors.
        p_value: chance of so good a candidate where there is nothing, over all joints.
        explained: by how much it lowered the held-out squared residual when it came in.
        ranking: all candidates that were tried in its place, best first.
    """

    trial: Trial
    p_value: float
    explained: float
    ranking: tuple[Trial, ...] = ()

    @property
    def effect(self) -> Effect:
        """The effect."""
        return self.trial.effect


@dataclass(frozen=True, eq=False)
class JointGap:
    """One joint's rows before anything is named.

    Attributes:
        joint: the joint, from 0.
        matrix: columns (N, p) of the baseline that are refitted; none where the model is held fixed.
        target: what is to be explained (N,), in force units.
        keep: rows that count (N,).
        present: effects that the joint has already.
        nuisance: how many of the columns, the last ones, stand for nothing that the model will have.
        friction: forces (N, k) of the model's own friction where it is held fixed: small errors of it are no change.
        sticks: whether the rests of the joint are left out.
        edge: columns (N, k), of a joint that sticks, by which its sign of velocity may turn otherwise than modelled.
        parts: number of each row's fold (N,), where the panel's folds would leave one with hardly any row that counts.
        wholes: causes of the whole robot that it has besides, and by how much each lowered its squared residual.
        prior: what the square of each of the first coefficients (k,) costs, where the model is held fixed: they stand
            for errors of its parameters, each of one standard deviation.
    """

    joint: int
    matrix: FloatArray
    target: FloatArray
    keep: BoolArray
    present: tuple[Effect, ...]
    nuisance: int = 0
    friction: FloatArray | None = None
    sticks: bool = False
    edge: FloatArray | None = None
    parts: IntArray | None = None
    wholes: tuple[tuple[Effect, float], ...] = ()
    prior: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def refitted(self) -> bool:
        """Whether the model's own parameters are fitted anew, instead of held to what is known of them."""
        return bool(self.matrix.shape[1] > self.nuisance + len(self.prior))

    def bare(self) -> JointGap:
        """The same without nuisance."""
        return replace(self, matrix=self.matrix[:, : self.matrix.shape[1] - self.nuisance], nuisance=0, edge=None)

    def edged(self) -> JointGap:
        """The same with the columns of a sign that turns otherwise, of a joint that sticks, among the nuisance."""
        if self.edge is None:
            return self
        return replace(self.beside(self.edge), edge=None)

    def beside(self, columns: FloatArray) -> JointGap:
        """The same with columns (N, k) that stand for nothing that the model will have among the nuisance."""
        return replace(self, matrix=np.hstack([self.matrix, columns]), nuisance=self.nuisance + columns.shape[1])

    def without(self, rows: BoolArray) -> JointGap:
        """The same with some rows (N,) left out."""
        return replace(self, keep=self.keep & ~rows)

    def knowing(self, panel: Panel, effect: Effect, force: FloatArray) -> JointGap:
        """The same without the force (N,) of a cause of the whole robot; of one that is rough, as much as is there."""
        problem, there = self.problem(panel), 1.0
        if effect.rough:
            column = problem.beyond(problem.of(force[:, None]))
            there = float(column.coefficients[0]) if column.drop > 0.0 else 1.0
        known = replace(self, target=self.target - there * force, present=(*self.present, effect))
        explained = problem.errors().total - known.problem(panel).errors().total
        return replace(known, wholes=(*self.wholes, (effect, explained)))

    def moving(self, panel: Panel, rests: BoolArray) -> JointGap:
        """The same with rests (N,) left out: hardly a row is left in which the sign turns to tell how it does."""
        edge = self.matrix[:, self.matrix.shape[1] - self.nuisance :]
        left = replace(self.bare().without(rests), sticks=True, edge=edge)
        rows = np.bincount(panel.fold[left.keep], minlength=int(panel.fold.max()) + 1)
        if rows.min() >= SCARCE * rows.mean():
            return left
        return replace(left, parts=even_folds(panel.log, left.keep))

    def dealt(self, panel: Panel) -> JointGap:
        """The same in folds of many parts of every log, where the joint moves far beyond all others in one fold.

        Predicted from those, a law would be asked what it says of positions and speeds that they never saw.
        """
        rows, motion = self.keep, panel.motion
        fold, q, dq = self.fold(panel)[rows], motion.q[rows, self.joint], motion.dq[rows, self.joint]
        if len(fold) == 0 or not goes_beyond(fold, q, dq):
            return self
        return self.in_parts(panel)

    def in_parts(self, panel: Panel) -> JointGap:
        """The same in folds of many parts of every log."""
        return replace(self, parts=even_folds(panel.log, self.keep, PARTS))

    def fold(self, panel: Panel) -> IntArray:
        """Number of each row's fold (N,)."""
        return panel.fold if self.parts is None else self.parts

    def problem(self, panel: Panel, named: Sequence[Trial] = ()) -> JointProblem:
        """The regression with effects named so far among the baseline's columns."""
        return self._problem(panel, self._matrix(panel, named), self.keep)

    def coefficients_of(self, panel: Panel, one: Named, named: Sequence[Named]) -> FloatArray:
        """A name's linear parameters beside the other names of the joint."""
        problem = self.problem(panel, [other.trial for other in named if other is not one])
        return coefficients(panel, problem, one.trial, self.joint)

    def everywhere(self, panel: Panel, named: Sequence[Trial] = (), fitted: BoolArray | None = None) -> FloatArray:
        """What that leaves in all rows (N,), nuisance taken away in those that count only.

        Args:
            panel: the rows.
            named: effects named so far.
            fitted: rows (N,) that it is fitted to; by default those that count.
        """
        matrix = self._matrix(panel, named)
        found = self._problem(panel, matrix, self.keep if fitted is None else fitted).fit()
        own, every = self.matrix.shape[1], np.arange(matrix.shape[1])
        plain = (every < own - self.nuisance) | (every >= own)
        left: FloatArray = self.target - matrix[:, plain] @ found[plain]
        left[self.keep] -= matrix[self.keep][:, ~plain] @ found[~plain]
        return left

    def leverage(self, panel: Panel, named: Sequence[Trial], fitted: BoolArray) -> FloatArray:
        """Variance (N,) of what columns predict in all rows, fitted to some (N,), over that of those rows' noise."""
        matrix = self._matrix(panel, named)
        size = sizes(matrix)
        scaled, known = matrix[:, size > 0] / size[size > 0], costs(self.prior, np.where(size > 0, size, 1.0))[size > 0]
        values, vectors = np.linalg.eigh(scaled[fitted].T @ scaled[fitted] + np.diag(known))
        spread = vectors / np.sqrt(np.maximum(values, LEAST * values.max(initial=0.0)))
        told: FloatArray = np.sum((scaled @ spread) ** 2, axis=1)
        return told

    def _problem(self, panel: Panel, matrix: FloatArray, rows: BoolArray) -> JointProblem:
        return JointProblem(matrix, self.target, self.fold(panel), rows, self.prior)

    def _matrix(self, panel: Panel, named: Sequence[Trial]) -> FloatArray:
        """The baseline's columns and those of effects whose coefficients keep to their bounds, in all rows."""
        if not named:
            return self.matrix
        plain = self._problem(panel, self.matrix, self.keep)
        found = [(trial.effect, panel.columns(trial.effect, trial.shape, self.joint)) for trial in named]
        return np.hstack([self.matrix, *(c[:, usable(panel, plain, effect, plain.of(c))] for effect, c in found)])


def starts_of(panel: Panel, problem: JointProblem) -> IntArray:
    """Numbers of the rows that count with which each block begins."""
    return np.unique(np.searchsorted(problem.keep, panel.start))


def speed_of(panel: Panel, problem: JointProblem, joint: int) -> FloatArray:
    """A joint's speed (N,) in the rows that count."""
    speed: FloatArray = np.abs(panel.velocity[problem.keep, joint])
    return speed


def classes_of(panel: Panel, problem: JointProblem, joint: int) -> IntArray:
    """Class of speed (N,) of the rows that count, as the gate parts them."""
    return speed_classes(speed_of(panel, problem, joint))


def gate_of(panel: Panel, problem: JointProblem, joint: int) -> Gate:
    """The gate of a joint's rows."""
    return Gate(problem, starts_of(panel, problem), speed_of(panel, problem, joint))


def nested_errors(panel: Panel, gap: JointGap, named: Sequence[Trial], trial: Trial) -> tuple[FloatArray, FloatArray]:
    """Squared residuals (folds,) without and with an effect, of rows predicted from others that alone chose its shape.

    Folds are the joint's, unless hardly more than one of them tells of the effect.
    """
    problem, others = _with_others(panel, gap, named)
    if trial.effect.shapes and _hardly_told(panel, problem, others, trial, gap.joint):
        problem, others = _with_others(panel, gap.in_parts(panel), named)
    held_out = np.empty(len(problem.labels))
    for k, rows in enumerate(others):
        shape = best_shape(panel, rows, trial, gap.joint).shape
        held_out[k] = problem.errors(admissible(panel, problem, trial.effect, shape, gap.joint)).held_out[k]
    return problem.errors().held_out, held_out


def _with_others(panel: Panel, gap: JointGap, named: Sequence[Trial]) -> tuple[JointProblem, list[JointProblem]]:
    """The joint's regression, and those without each of its folds in turn."""
    problem, fold = gap.problem(panel, named), gap.fold(panel)
    return problem, [gap.without(fold == k).problem(panel, named) for k in problem.labels]


def _hardly_told(panel: Panel, problem: JointProblem, others: Sequence[JointProblem], trial: Trial, joint: int) -> bool:
    """Whether all folds but one hardly tell of a trial: warm logs say little of how a robot warms up.

    Args:
        panel: the rows.
        problem: the joint's.
        others: those without each fold in turn.
        trial: the effect at its shape.
        joint: the joint.
    """
    force = force_of(panel, problem, trial, joint)[:, None]
    told = [float(np.sum(rows.away(rows.of(force)) ** 2)) for rows in (problem, *others)]
    return min(told[1:]) < HARDLY * told[0]
