"""Step 3, candidates: every effect of the catalogue on a joint, its shape parameters fitted, the baseline refitted."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.effects import load_catalogue
from ident.effects.base import Effect, Shape
from ident.effects.survey import Survey
from ident.gap.climb import climb
from ident.gap.gate import Gate
from ident.gap.panel import Panel
from ident.gap.problem import Errors, JointProblem

SEARCHED = 5
"""Laws on a joint, in all their forms, whose shape parameters are searched further than the grid of their starts."""

AS_WELL = 0.9
"""Share of what a law explains whose shape ends at a bound that a plainer form must explain to stand for it."""

HINTS = 0.01
"""Share of a joint's squared residual that a law must explain for its fuller forms to be tried, a tenth of what they
must themselves."""

BOUND = 0.01
"""Share of a shape parameter's range, or of the bound itself where that is less, that counts as the bound."""

BEHIND = 0.4
"""Share of what the best law so far explains that another must explain after a coarse search to be searched to the end:
what is behind then ends behind."""

TAIL = 0.2
"""Share of a law's largest force in all rows that those that count must reach for them to tell its size."""

TOGETHER = 32
"""Starting shapes that are looked at in one matrix product."""


@dataclass(frozen=True, eq=False)
class Trial:
    """An effect tried on a joint at the shape that suits the rows best.

    Attributes:
        effect: the candidate.
        shape: its shape parameters.
        drop: fall of the squared residual with all rows fitted.
        statistic: that fall over its mean on surrogates.
        errors: squared residuals with it.
        columns: how many columns it brought.
    """

    effect: Effect
    shape: FloatArray
    drop: float
    statistic: float = 0.0
    errors: Errors | None = None
    columns: int = 1

    @property
    def at_bound(self) -> bool:
        """Whether a shape parameter ended where its law stops being this one's."""
        return at_bound(self.effect, self.shape)


def at_bound(effect: Effect, shape: FloatArray) -> bool:
    """Whether a shape parameter (k,) of an effect is where its law stops being this one's."""
    return any(_at_bound(s, v) for s, v in zip(effect.shapes, shape.tolist(), strict=True))


def forms(survey: Survey, joint: int | None, present: Sequence[Effect]) -> list[Effect]:
    """Every form of every effect of whose kind a joint (None: the whole robot) has none yet."""
    found: list[Effect] = []
    for entry in load_catalogue().values():
        if entry.name != "links":
            found += entry.candidates(survey, joint)
    return [effect for effect in found if not any(_same(effect, there) for there in present)]


def _same(one: Effect, other: Effect) -> bool:
    """Whether two effects are of a kind on one joint, or either is on all."""
    return kind_of(one) == kind_of(other) and (None in (one.joint, other.joint) or one.joint == other.joint)


def kind_of(effect: Effect) -> tuple[str, int]:
    """What tells an effect from others of a joint: its kind, and the joint that drives it where another does."""
    return effect.kind or effect.name, getattr(effect, "source", 0)


def grid(shapes: Sequence[Shape]) -> Iterator[FloatArray]:
    """Yield every combination of the shapes' starting values."""
    for values in itertools.product(*(s.starts for s in shapes)):
        yield np.array(values, dtype=float)


def usable(panel: Panel, problem: JointProblem, effect: Effect, columns: FloatArray) -> BoolArray:
    """Which of an effect's columns (N, k) in a problem's rows keep coefficients to their bounds."""
    return _within(problem, columns, lower_bounds(panel, effect))


def admissible(panel: Panel, problem: JointProblem, effect: Effect, shape: FloatArray, joint: int) -> FloatArray:
    """Columns (N, k) of an effect in a problem's rows, without those whose coefficients would break their bounds."""
    return next(sweep(panel, problem, effect, [shape], joint))


def sweep(
    panel: Panel, problem: JointProblem, effect: Effect, shapes: Sequence[FloatArray], joint: int
) -> Iterator[FloatArray]:
    """Yield the admissible columns (N, k) of an effect at each of several shapes: none of which only a tail shows."""
    for columns, lower in _shown(panel, problem, effect, shapes, joint):
        used = _within(problem, columns, lower)
        yield columns if used.all() else columns[:, used]


def drops(
    panel: Panel, problem: JointProblem, effect: Effect, shapes: Sequence[FloatArray], joint: int
) -> Iterator[float]:
    """Yield the fall of the squared residual by the same columns."""
    for columns, lower in _shown(panel, problem, effect, shapes, joint):
        beyond = problem.beyond(columns)
        yield beyond.among(beyond.admissible(lower)).drop


def _shown(
    panel: Panel, problem: JointProblem, effect: Effect, shapes: Sequence[FloatArray], joint: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the columns (N, k) of an effect that a problem's rows show more of than a tail, and lower bounds (k,)."""
    lower = lower_bounds(panel, effect)
    for everywhere in panel.sweep(effect, shapes, joint):
        columns = problem.of(everywhere)
        if not effect.shapes or columns is everywhere:
            yield columns, lower
            continue
        shown = largest(columns) >= TAIL * largest(problem.left_out_of(everywhere))
        yield (columns, lower) if shown.all() else (columns[:, shown], lower[shown])


def _within(problem: JointProblem, columns: FloatArray, lower: FloatArray) -> BoolArray:
    """Which of columns (N, k) keep their coefficients to lower bounds (k,)."""
    if not np.isfinite(lower).any():
        return np.ones(len(lower), dtype=bool)
    return problem.beyond(columns).admissible(lower)


def lower_bounds(panel: Panel, effect: Effect) -> FloatArray:
    """Lower bounds (k,) of an effect's coefficients."""
    return np.array([c.lower for c in effect.coefficients(panel.robot)])


def largest(columns: FloatArray) -> FloatArray:
    """Largest size (k,) of each of columns (N, k)."""
    # Column by column in memory: along rows of a few numbers NumPy takes thirty times as long.
    found: FloatArray = np.abs(columns.T, order="C").max(axis=1, initial=0.0)
    return found


def coefficients(panel: Panel, problem: JointProblem, trial: Trial, joint: int) -> FloatArray:
    """Linear parameters (k,) of a trial fitted to a problem's rows; those at their bounds are nought."""
    return _fitted(panel, problem, trial.effect, panel.columns(trial.effect, trial.shape, joint))


def force_of(panel: Panel, problem: JointProblem, trial: Trial, joint: int) -> FloatArray:
    """What a trial, fitted to a problem's rows, adds to all of the joint's rows, (N,)."""
    everywhere = panel.columns(trial.effect, trial.shape, joint)
    added: FloatArray = everywhere @ _fitted(panel, problem, trial.effect, everywhere)
    return added


def _fitted(panel: Panel, problem: JointProblem, effect: Effect, everywhere: FloatArray) -> FloatArray:
    columns = problem.of(everywhere)
    used = usable(panel, problem, effect, columns)
    values = np.zeros(len(used))
    values[used] = problem.beyond(columns[:, used]).coefficients
    return values


def screen(panel: Panel, gate: Gate, effect: Effect, joint: int) -> Trial:
    """Try an effect at all its starting shapes, on the residual and on its surrogates."""
    best: Trial | None = None
    shapes = list(grid(effect.shapes))
    for first in range(0, len(shapes), TOGETHER):
        some = shapes[first : first + TOGETHER]
        tried = list(sweep(panel, gate.problem, effect, some, joint))
        for k in {columns.shape[1] for columns in tried}:
            same = [i for i, columns in enumerate(tried) if columns.shape[1] == k]
            falls, statistics = gate.look([tried[i] for i in same])
            top = int(np.argmax(falls))
            if best is None or falls[top] > best.drop:
                best = Trial(effect, some[same[top]], float(falls[top]), float(statistics[top]))
    assert best is not None
    return best


def refine(panel: Panel, problem: JointProblem, starts: Sequence[Trial], joint: int, least: float = 0.0) -> Trial:
    """Search the shape parameters of an effect, if it has any, around starts; roughly where it explains too little."""
    first = starts[0]

    def drop(shape: FloatArray) -> float:
        return next(drops(panel, problem, first.effect, [shape], joint))

    shape, best = climb(drop, first.effect.shapes, [(one.shape, one.drop) for one in starts], least)
    return replace(first, shape=shape, drop=best)


def best_start(panel: Panel, problem: JointProblem, effect: Effect, joint: int) -> Trial:
    """An effect at that of its starting shapes that suits a problem's rows best."""
    best: Trial | None = None
    shapes = list(grid(effect.shapes))
    for shape, drop in zip(shapes, drops(panel, problem, effect, shapes, joint), strict=True):
        if best is None or drop > best.drop:
            best = Trial(effect, shape, drop)
    assert best is not None
    return best


def within_bounds(panel: Panel, problem: JointProblem, trial: Trial, joint: int) -> Trial:
    """A trial as it is, or at the best usual shape of its law if it ended where that does.

    Two laws that are one in these rows fit best where one of them ends; short of that it may do as well.
    """
    if not trial.at_bound:
        return trial
    return with_errors(panel, problem, best_start(panel, problem, trial.effect, joint), joint)


def best_shape(panel: Panel, problem: JointProblem, trial: Trial, joint: int) -> Trial:
    """A trial's effect at the shape that suits a problem's rows best.

    Several parameters are searched from the trial's as well, lest the search of fewer rows end on the way.
    """
    effect = trial.effect
    starts = [best_start(panel, problem, effect, joint)]
    if len(effect.shapes) > 1:
        starts.append(in_rows(panel, problem, trial, joint))
    return refine(panel, problem, starts, joint)


def in_rows(panel: Panel, problem: JointProblem, trial: Trial, joint: int) -> Trial:
    """A trial, at its shape, with what it explains of a problem's rows."""
    return replace(trial, drop=next(drops(panel, problem, trial.effect, [trial.shape], joint)))


def with_errors(panel: Panel, problem: JointProblem, trial: Trial, joint: int) -> Trial:
    """Add the held-out errors of a trial."""
    columns = admissible(panel, problem, trial.effect, trial.shape, joint)
    return replace(trial, errors=problem.errors(columns), columns=columns.shape[1])


def best_trials(panel: Panel, survey: Survey, gate: Gate, effects: Sequence[Effect], joint: int) -> list[Trial]:
    """Try effects on a joint; those that explain most are searched further and judged on held-out rows, best first."""
    problem = gate.problem
    screened = sorted((screen(panel, gate, e, joint) for e in effects), key=lambda t: -t.drop)
    laws = [(trial.effect.name, *kind_of(trial.effect)) for trial in screened]
    further = list(dict.fromkeys(laws))[:SEARCHED]
    found, most = [], 0.0
    for law, trial in zip(laws, screened, strict=True):
        searched = refine(panel, problem, [trial], joint, BEHIND * most) if law in further else trial
        found.append(searched)
        most = max(most, 0.0 if searched.at_bound else searched.drop)
    least = HINTS * float(np.sum(problem.residual**2))
    likely = [k for k, trial in enumerate(found) if laws[k] in further and trial.drop > least]
    plain = [(found[k], screened[k]) for k in likely]
    found += [fuller_trial(panel, gate, e, both, joint) for both in plain for e in both[0].effect.fuller(survey)]
    for ended in [found[k] for k in likely if found[k].at_bound]:
        plainer = [refine(panel, problem, [screen(panel, gate, e, joint)], joint) for e in ended.effect.plainer()]
        found += [trial for trial in plainer if trial.drop > AS_WELL * ended.drop]
    return sorted((with_errors(panel, problem, trial, joint) for trial in found), key=_held_out)


def fuller_trial(panel: Panel, gate: Gate, effect: Effect, plain: Sequence[Trial], joint: int) -> Trial:
    """A fuller form of a law at the shape that suits it best near those of the plain one, whose parameters are first.

    Where the plain one began may be nearer to it than where that ended up without what it lacks. Half waves have no
    parameters, and take none.
    """
    more = [parameter.starts[0] for parameter in effect.shapes[len(plain[0].shape) :]]
    starts = []
    for shape in (np.append(trial.shape, more)[: len(effect.shapes)] for trial in plain):
        # Of some shapes fewer columns show.
        falls, statistics = gate.look([admissible(panel, gate.problem, effect, shape, joint)])
        starts.append(Trial(effect, shape, float(falls[0]), float(statistics[0])))
    return refine(panel, gate.problem, starts, joint)


def _held_out(trial: Trial) -> float:
    return trial.errors.total if trial.errors is not None else np.inf


def _at_bound(parameter: Shape, value: float) -> bool:
    low, high, place = (parameter.place(x) for x in (parameter.lower, parameter.upper, value))

    def near(end: float) -> bool:
        # Of hundreds of repeats a turn, six are not next to four.
        size = high - low if parameter.log or end == 0.0 else min(high - low, abs(end))
        return abs(place - end) <= BOUND * size

    return (near(low) and parameter.ends[0]) or (near(high) and parameter.ends[1])
