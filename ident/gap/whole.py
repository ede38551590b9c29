"""Causes of the whole robot, tried before those of single joints: one payload beats six offsets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.effects.base import Effect, Survey
from ident.gap.abstain import explainable
from ident.gap.agreement import IN_TIME, Predicted, agrees_at_any_pace
from ident.gap.belief import CERTAIN
from ident.gap.candidates import Trial, at_bound, forms, grid, refine
from ident.gap.climb import climb
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem, gain
from ident.gap.search import GAIN, LEVEL, RIVAL_LAW, Search, falls
from ident.gap.settle import LAW
from ident.gap.threads import in_threads

SHARE = 0.85
"""Share of what the best effects of single joints explain, together, that one cause of the whole robot must."""

MAJORITY = 2.0 / 3.0
"""Share of the joints that lack something on which it must explain that much, if not on all together."""

SETTLED = 2.0 / 3.0
"""Share of what it explains that must be where it leaves next to nothing, if it must: other joints may lack more."""

ALONE = 0.8
"""Share of the gain in likelihood from which a cause shows on one joint alone: else others bear it out."""

BEATS, NEARLY = 1.25, 0.98
"""What shows on one joint alone must explain so many times what its best effect does; with fewer parameters, nearly."""

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


def whole_effect(
    panel: Panel,
    survey: Survey,
    searches: Sequence[Search],
    present: Sequence[Effect],
    last: bool = False,
    instead: Effect | None = None,
) -> Whole | None:
    """The best cause of the whole robot, if it explains about as much as single joints' effects.

    Args:
        panel: the rows.
        survey: facts about the logs.
        searches: every joint's search.
        present: causes of the whole robot that are known.
        last: whether it must leave next to nothing where it explains most: what joints have of their own is known.
        instead: an effect of one joint that the searches leave out. Of its own kind (a delay of one joint, or of all)
            a cause of the whole robot need only explain more in all than that on its joint: the others bear it out.
    """
    problems = [search.problem for search in searches]
    before = np.array([p.errors().held_out for p in problems])
    squares = before.sum(axis=1)
    best_single = np.minimum(squares, [s.best_error for s in searches])
    single = _likelihoods(problems, squares, best_single)
    affected = _gains(squares, best_single) > GAIN
    candidates = forms(survey, None, present)
    tried = in_threads(lambda e: _try(panel, problems, e, _starts(panel, searches, e), before), candidates)
    ranking = _ranked([w for w in tried if w is not None])
    for best in ranking:
        after = best.held_out.sum(axis=1)
        gains = _gains(squares, after)
        # In every fold the joints together must gain: where some move little, others bear it out.
        repeats = falls(np.log(np.maximum(before, TINY) / np.maximum(best.held_out, TINY)).sum(axis=0))
        if gains.min() < -GAIN or not repeats or len(helped := _helped(panel, searches, best, squares, after)) == 0:
            continue
        likelihoods = _likelihoods(problems, squares, after)
        one = helped[0]
        alone = len(helped) == 1 and (last or panel.robot.n > 1) and likelihoods[one] >= ALONE * likelihoods.sum()
        if instead is not None and type(best.effect) is type(instead):
            shown = bool(likelihoods.sum() > single[instead.at])
        elif alone:
            shown = _stands_alone(best, searches[one].closest, likelihoods, single, int(one))
            shown = shown and bool(np.all(best.held_out[one] <= before[one]))
        else:
            shown = _rivals(likelihoods, single, affected, helped)
        if shown and (alone or last):
            told = [likelihoods[j] for j in helped.tolist() if _exhausts(panel, survey, problems[j], best, j)]
            shown = bool(sum(told) >= SETTLED * likelihoods[helped].sum())
        # Play is there where the load changes sides, which slow motion need not do.
        if not shown or not (best.effect.family == "hysteresis" or _at_any_pace(panel, problems, best)):
            continue
        p_value = _p_value(panel, best, searches)
        if p_value <= LEVEL:
            own = [(searches[j].closest, single[j], likelihoods[j]) for j in helped.tolist()] if alone else []
            others = _alternatives(best, ranking, own)
            return replace(best, p_value=p_value, alternatives=others, joint=int(np.argmax(likelihoods)))
    return None


def _ranked(tried: Sequence[Whole]) -> tuple[Whole, ...]:
    """Causes, best first; of rivals whose laws explain about the same, what explains more with any coefficients.

    No law is exact, nor is the model beside it: small errors of it must not choose between a delay and a filter.
    """
    ranking = sorted(tried, key=lambda w: -w.standing)
    for k in range(len(ranking) - 1):
        first, second = ranking[k : k + 2]
        close = first.effect.rivals_with(second.effect) and second.standing >= LAW * first.standing
        if close and second.likelihood > first.likelihood:
            ranking[k : k + 2] = second, first
    return tuple(ranking)


def _helped(panel: Panel, searches: Sequence[Search], whole: Whole, squares: FloatArray, after: FloatArray) -> IntArray:
    """Joints on which it lowers squared residuals (n,) by enough.

    What softens force must do so beside noise of the accelerations and what the filter cuts away of them, too.
    """
    enough = _gains(squares, after) > GAIN
    if whole.effect.softens:
        enough &= squares - after > panel.jolted * [len(search.problem) for search in searches]
        for j in np.flatnonzero(enough).tolist():
            enough[j] = searches[j].gains_by(panel, columns_of(panel, whole, j))
    return np.flatnonzero(enough)


def _at_any_pace(panel: Panel, problems: Sequence[JointProblem], whole: Whole) -> bool:
    added = (columns_of(panel, whole, j)[p.keep] for j, p in enumerate(problems))
    joints = [Predicted.of(panel, p, j, force) for j, (p, force) in enumerate(zip(problems, added, strict=True))]
    return agrees_at_any_pace(joints, IN_TIME)


def _stands_alone(whole: Whole, single: Trial | None, likelihoods: FloatArray, singles: FloatArray, joint: int) -> bool:
    """Whether a cause that shows on one joint explains more there than the joint's best effect does.

    What it costs other joints counts. A spring that shows on another joint than its own is chosen among those of all
    joints: it is no simpler cause than that effect.
    """
    simpler = whole.effect.joint in (None, joint) and _simpler(whole, single)
    explained = min(likelihoods[joint], likelihoods.sum())
    return bool(explained > (NEARLY if simpler else BEATS) * singles[joint])


def _simpler(whole: Whole, single: Trial | None) -> bool:
    """Whether a cause of the whole robot has fewer parameters than a joint's effect, which is of another law."""
    if single is None or single.effect.name == whole.effect.name:
        return False
    return len(whole.coefficients) + len(whole.shape) < single.columns + len(single.shape)


def _rivals(likelihoods: FloatArray, single: FloatArray, affected: BoolArray, helped: IntArray) -> bool:
    """Whether it explains nearly what joints' best effects do, on most joints that lack something or all that it helps.

    A joint may have a cause of its own besides, and one that it does not help has.
    """
    most = (affected & (likelihoods >= SHARE * single)).sum() >= max(2, MAJORITY * affected.sum())
    return bool(most or likelihoods.sum() >= SHARE * single[helped].sum())


def _alternatives(
    best: Whole, ranking: Sequence[Whole], own: Sequence[tuple[Trial | None, float, float]]
) -> dict[str, Trial]:
    """Names that explain nearly as much, or nearly so of a rival, whose laws are closer than either is to the truth.

    Args:
        best: the cause that is named.
        ranking: all that were tried.
        own: joints' best effects instead, each with what it explains and what the cause does there.
    """
    tried = [(Trial(other.effect, other.shape, 0.0), other.likelihood, best.likelihood) for other in ranking]
    tried += [(trial, explained, by_best) for trial, explained, by_best in own if trial is not None]
    names: dict[str, Trial] = {}
    for trial, explained, by_best in tried:
        share = 1.0 - RIVAL_LAW if best.effect.rivals_with(trial.effect) else LAW
        if trial.effect.name != best.effect.name and explained >= share * by_best:
            names.setdefault(trial.effect.name, trial)
    return names


def _exhausts(panel: Panel, survey: Survey, problem: JointProblem, whole: Whole, joint: int) -> bool:
    """Whether the effect leaves next to nothing on a joint that could still be explained."""
    added = columns_of(panel, whole, joint)[problem.keep]
    before, after = problem.residual, problem.away((problem.target - added)[:, None])[:, 0]
    rest = explainable(panel, survey, joint, after, problem.keep).share * float(after @ after)
    return float(before @ before - after @ after) >= CERTAIN * rest


def columns_of(panel: Panel, whole: Whole, joint: int) -> FloatArray:
    """What the effect adds to a joint's rows, (N,)."""
    added: FloatArray = panel.columns(whole.effect, whole.shape, joint) @ whole.coefficients
    return added


def _p_value(panel: Panel, whole: Whole, searches: Sequence[Search]) -> float:
    values = []
    for joint, search in enumerate(searches):
        column = columns_of(panel, whole, joint)[search.problem.keep, None]
        values.append(search.gate.p_value(search.gate.statistic(column)))
    return min(1.0, min(values) * len(values))


def _try(
    panel: Panel, problems: Sequence[JointProblem], effect: Effect, starts: Sequence[FloatArray], before: FloatArray
) -> Whole | None:
    lower = np.array([c.lower for c in effect.coefficients(panel.robot)])

    def at(shape: FloatArray, lawful: bool) -> Whole | None:
        every = panel.all_columns(effect, shape)
        columns = [p.of(every[:, j]) for j, p in enumerate(problems)]
        # A lead is no delay over a span that it does not fill.
        meant = effect.plain(shape)
        found = _shared(problems, columns, before, meant if lawful else None)
        if found is None or np.any(found[0] < lower) or (meant is not None and np.any(found[0] * meant < 0.0)):
            return None
        likelihood = float(_likelihoods(problems, before.sum(axis=1), found[1].sum(axis=1)).sum())
        return Whole(effect, shape, *found, likelihood, likelihood)

    def searched(starts: Sequence[FloatArray], lawful: bool) -> Whole | None:
        tried = [one for one in (at(shape, lawful) for shape in starts) if one is not None]
        best = max(tried, key=lambda one: one.likelihood, default=None)
        if best is None or not effect.shapes or (best.likelihood <= 0.0 and not lawful):
            return best

        def likelihood(shape: FloatArray) -> float:
            one = at(shape, lawful)
            return -np.inf if one is None else one.likelihood

        return at(climb(likelihood, effect.shapes, best.shape, best.likelihood)[0], lawful)

    best = searched(starts, lawful=False)
    if best is None or best.likelihood <= 0.0 or (effect.joint is not None and at_bound(effect, best.shape)):
        return None
    any_is_its = all(effect.plain(shape) is None for shape in starts)
    law = best if any_is_its else searched([*starts, best.shape], lawful=True)
    assert law is not None
    limit = at_bound(effect, law.shape)
    near = law is not best and not limit and law.likelihood >= (1.0 - RIVAL_LAW) * best.likelihood
    standing = law.likelihood * (1.0 - RIVAL_LAW if limit else 1.0)
    return replace(best, standing=standing, law=at(law.shape, lawful=False) if near else None)


def _starts(panel: Panel, searches: Sequence[Search], effect: Effect) -> list[FloatArray]:
    """Shapes from which an effect is searched for in all rows; what one joint has shows in its own row first."""
    if effect.joint is None or not effect.shapes:
        return list(grid(effect.shapes))
    own, written = searches[effect.joint], repr(effect)  # an effect of the user's may not be hashable
    if written not in own.starts:
        own.starts[written] = _shown(panel, own.problem, effect, effect.joint)
    return own.starts[written]


def _shown(panel: Panel, problem: JointProblem, effect: Effect, joint: int) -> list[FloatArray]:
    """Shapes of an effect that explain most of a joint's row, each column alone; none where none shows."""
    shapes = list(grid(effect.shapes))
    columns = np.hstack([problem.of(columns) for columns in panel.sweep(effect, shapes, joint)])
    each, found = (x.reshape(len(shapes), -1) for x in problem.drops(columns))
    positive = np.array([c.lower >= 0.0 for c in effect.coefficients(panel.robot)])
    drops = np.where(positive & (found < 0.0), 0.0, each).max(axis=1)
    best = np.argsort(-drops)[:STARTS]
    if drops[best[0]] < SHOWS * float(np.sum(problem.residual**2)):
        return []
    tried = (Trial(effect, shapes[k], float(drops[k])) for k in best)
    return [refine(panel, problem, one, joint).shape for one in tried]


def _likelihoods(problems: Sequence[JointProblem], before: FloatArray, after: FloatArray) -> FloatArray:
    """Gain in log-likelihood (n,) of each joint when its squared residual falls."""
    lengths = np.array([len(p) for p in problems])
    return np.asarray(0.5 * lengths * np.log(np.maximum(before, TINY) / np.maximum(after, TINY)))


def _gains(before: FloatArray, after: FloatArray) -> FloatArray:
    """Share (n,) by which each joint's RMS residual falls."""
    return np.array([gain(b, a) for b, a in zip(before, after, strict=True)])


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
    sums = [p.sums(c[:, seen] / size) for p, c in zip(problems, columns, strict=True)]
    reduced = [s.reduced(None) for s in sums]
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
