"""What logs tell of a hidden effect: how much nearer its own law is to it than rivals are, and with which figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_triangular, toeplitz

from comparisons.hidden_effects.cases import LASTS, SLOW
from ident.arrays import FloatArray
from ident.effects import load_catalogue
from ident.effects.base import Effect
from ident.effects.survey import Survey
from ident.gap.candidates import forms, grid, lower_bounds
from ident.gap.climb import climb
from ident.gap.panel import Panel
from ident.gap.problem import Beyond, JointProblem, sizes
from ident.gap.rows import gap_of, held_of, panel_of, survey_of

if TYPE_CHECKING:
    from comparisons.hidden_effects.cases import Case, Made
    from ident.log import JointLog
    from ident.model import CurrentModel

ROWS, STRETCH = 4000, 200
"""Rows of a case's logs that laws are compared on, and how many of these follow one another."""

ALL = 10**9
"""More rows than logs have."""

SURE = 2.33
"""Standard deviations by which the true law must be ahead of its rivals: noise makes the wrong one the likelier in one
case of a hundred then."""


@dataclass(frozen=True)
class Told:
    """What logs tell of a hidden effect, if all else were known.

    Attributes:
        margin: by how much its law is nearer to it than the nearest of its rivals, in standard deviations that noise
            gives to the difference of their log-likelihoods, negative where the rival is nearer; None of an effect that
            the catalogue does not have, or that has no rivals.
        nearest: the figures of the catalogue's law of its name that is nearest to it, by the contract's keys: where the
            law that hides is another, none that is fitted to these logs comes nearer to its own figures.
    """

    margin: float | None = None
    nearest: Mapping[str, float | list[float]] = field(default_factory=dict)


def told(model: CurrentModel, refit: bool, case: Case, made: Made, number: int) -> Told:
    """Return what the logs of a case tell of one of its effects.

    What is hidden is known exactly: it is the difference of logs with and without it. The catalogue's law of that
    name and those that are known to be taken for it are each fitted to it, with the model's own columns beside them.
    What the nearest rival leaves of it, less what its own law leaves, is held against the noise, whose colour is known.

    Args:
        model: the model before.
        refit: whether its own parameters are fitted again with the effect.
        case: what is hidden.
        made: its logs.
        number: which of the hidden effects is asked about.
    """
    catalogue, hidden = load_catalogue(), case.hidden[number]
    own = catalogue.get(hidden.effect)
    if own is None:
        return Told()
    rivals = {name for name, entry in catalogue.items() if name in own.rivals or own.name in entry.rivals}
    sight = _Sight.of(model, refit, made, made.alone[number])
    present = [term.effect for term in model.terms] if refit else []
    best: dict[str, _Nearest] = {}
    for joint in dict.fromkeys((hidden.joint, None)):
        for effect in forms(sight.survey, joint, present):
            if effect.name in rivals or (effect.name == own.name and effect.joint == hidden.joint):
                found = sight.nearest(effect)
                if effect.name not in best or found.left < best[effect.name].left:
                    best[effect.name] = found
    if own.name not in best:
        return Told()
    law = best[own.name]
    figures = law.effect.summary(model.robot, law.shape, law.coefficients)
    rival = min((best[name] for name in rivals if name in best), key=lambda one: one.left, default=None)
    return Told(None if rival is None else law.ahead_of(rival), figures)


@dataclass(frozen=True, eq=False)
class _Nearest:
    """A law at the shape and coefficients that are nearest to what is hidden.

    Attributes:
        effect, shape, coefficients: the law.
        force: what it gives of the target (n N,), in standard deviations of the noise.
        left: log-likelihood that it misses.
    """

    effect: Effect
    shape: FloatArray
    coefficients: FloatArray
    force: FloatArray
    left: float

    def ahead_of(self, other: _Nearest) -> float:
        """Mean of the difference of log-likelihoods of two laws, over its standard deviation by the noise."""
        return (other.left - self.left) / max(float(np.linalg.norm(self.force - other.force)), 1e-12)


@dataclass(frozen=True, eq=False)
class _Sight:
    """What logs show of what is hidden in them.

    Attributes:
        panel, survey: some of the logs' rows, in stretches, and facts about them.
        problems: every joint's regression in rows whose noise is white, with the hidden force for target.
        weights: square roots (n,) of the samples that a row stands for, over the noise [1 / force unit].
        whitening: takes the noise's colour from columns in those rows.
    """

    panel: Panel
    survey: Survey
    problems: Sequence[JointProblem]
    weights: FloatArray
    whitening: _Whitening

    @classmethod
    def of(cls, model: CurrentModel, refit: bool, made: Made, logs: Sequence[JointLog]) -> _Sight:
        """Logs of a case, of whose current what differs from its plain ones is the hidden one."""
        panel = _stretches(panel_of(model, logs, ALL))
        pairs = zip(logs, made.plain, strict=False)  # those of the test logs come last
        other = panel_of(model, [replace(log, current=log.current - plain.current) for log, plain in pairs], ALL)
        hidden = replace(other, rows=panel.rows, fold=panel.fold).force
        whitening = _Whitening.of(panel)
        gaps = [(gap_of if refit else held_of)(model, panel, j) for j in range(model.n)]
        problems = []
        for j, gap in enumerate(gaps):
            # How large its friction is now, a model that was identified before does not know.
            own = gap.matrix if gap.friction is None else np.hstack([gap.matrix, gap.friction])
            white = whitening.applied(np.column_stack([own, hidden[:, j]]))
            problems.append(
                JointProblem(white[:, :-1], white[:, -1], panel.fold, gap.keep, gap.prior / made.correlation)
            )
        samples = sum(len(log.t) for log in logs) / len(panel)
        return cls(panel, survey_of(model, panel), problems, np.sqrt(samples) / (made.noise * model.gain), whitening)

    @cached_property
    def target(self) -> FloatArray:
        """The hidden force (n N,) of all joints beyond what the model's own columns absorb, over the noise."""
        return np.concatenate([w * p.residual for w, p in zip(self.weights, self.problems, strict=True)])

    def nearest(self, effect: Effect) -> _Nearest:
        """An effect at its best shape, in place of what is hidden."""

        def explained(shape: FloatArray) -> float:
            return 0.5 * float(self.target @ self.target) - self._at(effect, shape).left

        best = max(((shape, explained(shape)) for shape in grid(effect.shapes)), key=lambda one: one[1])
        if effect.shapes:
            best = climb(explained, effect.shapes, [best])
        return self._at(effect, best[0])

    def _at(self, effect: Effect, shape: FloatArray) -> _Nearest:
        """An effect at a shape, its coefficients within their bounds."""
        columns, size = self._columns(effect, shape)
        coefficients = effect.plain(shape)
        if coefficients is None:
            beyond = Beyond(columns.T @ columns / np.outer(size, size), columns.T @ self.target / size, size)
            used = beyond.admissible(lower_bounds(self.panel, effect))
            coefficients = np.zeros(len(used))
            coefficients[used] = beyond.among(used).coefficients
        force = columns @ coefficients
        return _Nearest(effect, shape, coefficients, force, 0.5 * float(np.sum((self.target - force) ** 2)))

    def _columns(self, effect: Effect, shape: FloatArray) -> tuple[FloatArray, FloatArray]:
        """An effect's columns (n N, k) in all joints' rows beyond the model's own, and their whole lengths (k,)."""
        every = self.panel.all_columns(effect, shape)
        beyond, square = [], np.zeros(every.shape[-1])
        for joint, (weight, problem) in enumerate(zip(self.weights, self.problems, strict=True)):
            if every.ndim == 2 and effect.acts_on != joint:
                beyond.append(np.zeros((len(problem), every.shape[1])))
                continue
            own = weight * self.whitening.applied(every[:, joint] if every.ndim == 3 else every)
            beyond.append(problem.away(own))
            square += sizes(own) ** 2
        return np.concatenate(beyond), np.sqrt(np.where(square > 0.0, square, 1.0))


def _stretches(panel: Panel) -> Panel:
    """Rows of a panel in stretches, evenly spread."""
    every = max(1, round(len(panel) / ROWS))
    kept = [np.arange(len(rows)) // STRETCH % every == k % every for k, rows in enumerate(panel.rows)]
    taken = [rows[some] for rows, some in zip(panel.rows, kept, strict=True)]
    return replace(panel, rows=taken, fold=panel.fold[np.concatenate(kept)])


@dataclass(frozen=True, eq=False)
class _Whitening:
    """What takes the colour of cases' noise from columns.

    Attributes:
        stretches: rows that follow one another.
        factor: Cholesky factor of the correlation of the noise of as many rows as the longest of them has.
    """

    stretches: list[slice]
    factor: FloatArray

    @classmethod
    def of(cls, panel: Panel) -> _Whitening:
        """For columns in a panel's rows."""
        begins = np.concatenate([np.diff(rows, prepend=-2) != 1 for rows in panel.rows])
        edges = [*np.flatnonzero(begins).tolist(), len(panel)]
        rows = np.arange(max(b - a for a, b in pairwise(edges)))
        correlation = SLOW * np.exp(-panel.step / LASTS * rows) + (1.0 - SLOW) * (rows == 0)
        return cls([slice(a, b) for a, b in pairwise(edges)], np.linalg.cholesky(toeplitz(correlation)))

    def applied(self, columns: FloatArray) -> FloatArray:
        """Columns (N, k) as they are where noise is white."""
        pieces = [columns[rows] for rows in self.stretches]
        return np.concatenate([solve_triangular(self.factor[: len(x), : len(x)], x, lower=True) for x in pieces])
