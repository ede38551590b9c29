"""An effect of the whole robot on all joints' rows: the coefficients that they share, and the shapes that suit all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Effect
from ident.gap.agreement import IN_TIME, Predicted, agrees_at_any_pace
from ident.gap.candidates import Trial, at_bound, grid, lower_bounds, refine
from ident.gap.climb import climb, together
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.search import RIVAL_LAW, Search
from ident.uncertainty import correlation_time

TINY = 1e-300
"""In place of a nought that is divided by, such as the squared residual of a joint without rows that count."""

SHOWS = 0.02
"""Share of its own joint's squared residual that what one joint has must explain to be searched for in all rows."""

STARTS = 4
"""Best starts from which what one joint has is searched for in its own row."""

VISIBLE = 1e-6
"""Share of an effect's square that the baseline must leave."""


@dataclass(frozen=True, eq=False)
class Whole:
    """One effect of the whole robot.

    Attributes:
        effect: the candidate.
        shape: its shape parameters.
        coefficients: its linear parameters.
        held_out: squared residuals (n, folds) with it.
        likelihood: gain in log-likelihood on held-out rows, all joints together.
        standing: the same with the only coefficients that its law means, at the shape that suits those best, less what
            laws err by if that is where its law is another: a quick filter is a delay.
        p_value: chance of so good a candidate where there is nothing.
        alternatives: names that explain nearly as much, with their fitted shapes.
        joint: where it shows most.
        law: the same at the shape that suits the only coefficients that its law means, if that explains nearly as much.
            Any coefficient may make up for any shape: twice the current, through a filter twice as quick.
    """

    effect: Effect
    shape: FloatArray
    coefficients: FloatArray
    held_out: FloatArray
    likelihood: float
    standing: float
    p_value: float = 1.0
    alternatives: Mapping[str, Trial] = field(default_factory=dict)
    joint: int = 0
    law: Whole | None = None

    @property
    def as_meant(self) -> Whole:
        """The same as its law means it, where that explains nearly as much; else itself."""
        return self if self.law is None else self.law


@dataclass(frozen=True, eq=False)
class OnAll:
    """An effect of the whole robot, tried on all joints' rows.

    Attributes:
        panel: the rows.
        problems: every joint's regression.
        effect: the effect.
        before: held-out squares (n, folds) without it.
        own: the search of its joint, if it is of one.
        least: gain in log-likelihood below which, at the shapes that suit its own joint's row best, what one joint has
            is not searched for in all rows.
    """

    panel: Panel
    problems: Sequence[JointProblem]
    effect: Effect
    before: FloatArray
    own: Search | None = None
    least: float = 0.0

    def at(self, shape: FloatArray, lawful: bool = False) -> Whole | None:
        """The effect at a shape, with any coefficients or those that its law means; None where it shows not."""
        effect, problems = self.effect, self.problems
        lower = lower_bounds(self.panel, effect)
        every = self.panel.all_columns(effect, shape)
        columns = [p.of(every[:, j]) for j, p in enumerate(problems)]
        # A lead is no delay over a span that it does not fill.
        meant = effect.plain(shape)
        found = _shared(problems, columns, self.before, meant if lawful else None)
        if found is None or np.any(found[0] < lower) or (meant is not None and np.any(found[0] * meant < 0.0)):
            return None
        likelihood = float(likelihoods(problems, self.before.sum(axis=1), found[1].sum(axis=1)).sum())
        return Whole(effect, shape, *found, likelihood, likelihood)

    def begun(self) -> Whole | None:
        """The effect at the best of its starts; what one joint has shows in its own row first."""
        return self._best([one.shape for one in self._shown()] if self._is_ones else list(grid(self.effect.shapes)))

    def searched(self, begun: Whole | None) -> Whole | None:
        """The effect, which had so begun, at the shape that suits all rows best."""
        effect = self.effect
        starts = self._refined() if self._is_ones else list(grid(effect.shapes))
        begun = self._best(starts) if self._is_ones else begun
        if begun is None or (self._is_ones and begun.likelihood < self.least):
            return None
        best = self._climbed(begun)
        if best is None or best.likelihood <= 0.0 or (effect.joint is not None and at_bound(effect, best.shape)):
            return None
        any_is_its = all(effect.plain(shape) is None for shape in starts)
        law = best if any_is_its else self._climbed(self._best([*starts, best.shape], lawful=True), lawful=True)
        assert law is not None
        limit = at_bound(effect, law.shape)
        near = law is not best and not limit and law.likelihood >= (1.0 - RIVAL_LAW) * best.likelihood
        standing = law.likelihood * (1.0 - RIVAL_LAW if limit else 1.0)
        return replace(best, standing=standing, law=self.at(law.shape) if near else None)

    def _best(self, starts: Sequence[FloatArray], lawful: bool = False) -> Whole | None:
        tried = [one for one in (self.at(shape, lawful) for shape in starts) if one is not None]
        return max(tried, key=lambda one: one.likelihood, default=None)

    def _climbed(self, best: Whole | None, lawful: bool = False) -> Whole | None:
        if best is None or not self.effect.shapes or (best.likelihood <= 0.0 and not lawful):
            return best

        def likelihood(shape: FloatArray) -> float:
            one = self.at(shape, lawful)
            return -np.inf if one is None else one.likelihood

        start, shapes = (best.shape, best.likelihood), self.effect.shapes
        # What was searched for in its own row is next to its best.
        found = together(likelihood, shapes, *start) if self._is_ones else climb(likelihood, shapes, [start])
        return self.at(found[0], lawful)

    @property
    def _is_ones(self) -> bool:
        """Whether it is of one joint, and has shapes to be searched for in that one's row."""
        return self.effect.joint is not None and bool(self.effect.shapes)

    @property
    def _own(self) -> Search:
        assert self.own is not None
        return self.own

    def _shown(self) -> list[Trial]:
        """Starts that its own joint's row shows best."""
        own, written = self._own, repr(self.effect)  # an effect of the user's may not be hashable
        if written not in own.shown:
            own.shown[written] = _shown(self.panel, own.problem, self.effect, self.effect.at)
        return own.shown[written]

    def _refined(self) -> list[FloatArray]:
        """The shape to which these lead in that row, if there are any."""
        own, written = self._own, repr(self.effect)
        if written not in own.refined:
            shown = self._shown()
            found = [refine(self.panel, own.problem, shown, self.effect.at)] if shown else []
            own.refined[written] = [one.shape for one in found]
        return own.refined[written]


def columns_of(panel: Panel, whole: Whole, joint: int) -> FloatArray:
    """What the effect adds to a joint's rows, (N,)."""
    added: FloatArray = panel.columns(whole.effect, whole.shape, joint) @ whole.coefficients
    return added


def left_by(panel: Panel, problem: JointProblem, whole: Whole, joint: int) -> FloatArray:
    """What (N,) a cause leaves of a joint's rows that count."""
    rest = problem.target - columns_of(panel, whole, joint)[problem.keep]
    return problem.away(rest[:, None])[:, 0]


def times_of(panel: Panel, problems: Sequence[JointProblem], whole: Whole) -> FloatArray:
    """Correlation times (n,) [samples] of what a cause leaves of every joint."""
    return np.array([correlation_time(left_by(panel, p, whole, j)) for j, p in enumerate(problems)])


def at_any_pace(panel: Panel, problems: Sequence[JointProblem], whole: Whole) -> bool:
    """Whether what a cause adds to joints is there in slow and in fast motion."""
    added = (columns_of(panel, whole, j)[p.keep] for j, p in enumerate(problems))
    joints = [Predicted.of(panel, p, j, force) for j, (p, force) in enumerate(zip(problems, added, strict=True))]
    return agrees_at_any_pace(joints, IN_TIME)


def _shown(panel: Panel, problem: JointProblem, effect: Effect, joint: int) -> list[Trial]:
    """Starts of an effect that explain most of a joint's row, each column alone; none where none shows."""
    shapes = list(grid(effect.shapes))
    columns = np.hstack([problem.of(columns) for columns in panel.sweep(effect, shapes, joint)])
    each, found = (x.reshape(len(shapes), -1) for x in problem.drops(columns))
    positive = lower_bounds(panel, effect) >= 0.0
    drops = np.where(positive & (found < 0.0), 0.0, each).max(axis=1)
    best = np.argsort(-drops)[:STARTS]
    if drops[best[0]] < SHOWS * float(np.sum(problem.residual**2)):
        return []
    return [Trial(effect, shapes[k], float(drops[k])) for k in best]


def likelihoods(problems: Sequence[JointProblem], before: FloatArray, after: FloatArray) -> FloatArray:
    """Gain in log-likelihood (n,) of each joint when its squared residual falls."""
    lengths = np.array([len(p) for p in problems])
    return np.asarray(0.5 * lengths * np.log(np.maximum(before, TINY) / np.maximum(after, TINY)))


def _shared(
    problems: Sequence[JointProblem], columns: Sequence[FloatArray], before: FloatArray, known: FloatArray | None
) -> tuple[FloatArray, FloatArray] | None:
    """Coefficients that all joints share, weighted by the joints' residuals, and held-out squares (n, folds)."""
    weights = np.array([len(p) for p in problems]) / np.maximum(before.sum(axis=1), TINY)
    whole = np.asarray(sum(np.sum(c**2, axis=0) for c in columns))
    seen = np.flatnonzero(whole > 1e-20 * max(whole.max(), TINY))
    if len(seen) == 0:
        return None
    size = np.sqrt(whole[seen])
    sums = [p.further(c[:, seen] / size) for p, c in zip(problems, columns, strict=True)]
    reduced = [s.reduced() for s in sums]
    unique = sum(w * np.diag(normal) for w, (normal, _) in zip(weights, reduced, strict=True))
    inside = sum(w * np.diag(s.inside.sum(axis=0)) for w, s in zip(weights, sums, strict=True))
    # What the motion does not show stays nought; an effect of which it shows nothing is no candidate.
    if np.max(np.asarray(unique) / np.maximum(inside, TINY)) < VISIBLE:
        return None
    coefficients = np.zeros(len(whole))
    coefficients[seen] = _solve(reduced, weights) / size if known is None else known[seen]
    folds = len(problems[0].folds)
    held_out = np.empty((len(problems), folds))
    for k in range(folds):
        shared = _solve([s.reduced(k) for s in sums], weights) if known is None else known[seen] * size
        held_out[:, k] = [s.held_out(k, shared) for s in sums]
    return coefficients, held_out


def _solve(parts: Sequence[tuple[FloatArray, FloatArray]], weights: FloatArray) -> FloatArray:
    normal = sum(w * a for w, (a, _) in zip(weights, parts, strict=True))
    right = sum(w * b for w, (_, b) in zip(weights, parts, strict=True))
    found: FloatArray = np.linalg.lstsq(np.asarray(normal), np.asarray(right), rcond=1e-9)[0]
    return found
