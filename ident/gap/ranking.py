"""Causes of the whole robot by how much they explain, and what else explains as much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.effects.timing import Timing
from ident.gap.belief import mostly
from ident.gap.candidates import Trial
from ident.gap.gate import MOVING
from ident.gap.joint_gap import classes_of
from ident.gap.on_all import TINY, Whole, left_by, times_of
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.search import PRICE, RIVAL_LAW
from ident.gap.settle import LAW


def ranked(tried: Sequence[Whole]) -> tuple[Whole, ...]:
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


def by_motion(panel: Panel, problems: Sequence[JointProblem], ranking: Sequence[Whole]) -> list[Whole]:
    """The ranking, but of laws of when the current comes the one first that tells motion best.

    Which way a joint that stands is about to move is noise, which a filter takes away from its dry friction.
    """
    timing = [(whole, whole.effect) for whole in ranking if isinstance(whole.effect, Timing)]
    near = [(one, effect) for one, effect in timing if one.standing >= LAW * timing[0][0].standing]
    if len(near) < 2:
        return list(ranking)
    best, _ = max(near, key=lambda pair: _in_motion(panel, problems, pair[0], pair[1].counts_as))
    place = ranking.index(timing[0][0])
    return [*ranking[:place], best, *(whole for whole in ranking[place:] if whole is not best)]


def _in_motion(panel: Panel, problems: Sequence[JointProblem], whole: Whole, parameters: int) -> float:
    """Gain in log-likelihood of what a cause explains of rows in which joints move, less the price of parameters.

    By the shape that its law means, if that is near, and Schwarz (1978); a sample is as long as what is left is
    like itself.
    """
    law = whole.as_meant
    gained, rows = 0.0, 0
    for j, problem in enumerate(problems):
        moving = classes_of(panel, problem, j) >= MOVING
        left = left_by(panel, problem, law, j)[moving]
        before, after = float(np.sum(problem.residual[moving] ** 2)), float(np.sum(left**2))
        gained += 0.5 * len(left) * np.log(max(before, TINY) / max(after, TINY))
        rows += len(left)
    time = float(times_of(panel, problems, law).mean())
    return float(gained - PRICE * 0.5 * parameters * time * np.log(max(rows / time, 2.0)))


def mostly_there(whole: Whole) -> bool:
    """Whether at least half of what a law means is there, as of a current that passes a filter."""
    return whole.law is not None or mostly(whole.effect, whole.shape, lambda: whole.coefficients)


def alternatives(best: Whole, ranking: Sequence[Whole], own: Sequence[tuple[Trial, float, float]]) -> dict[str, Trial]:
    """Names that explain nearly as much, or nearly so of a rival, whose laws are closer than either is to the truth.

    Args:
        best: the cause that is named.
        ranking: all that were tried.
        own: effects of one joint instead, each with what it explains and what the cause does there.
    """
    tried = [(Trial(other.effect, other.shape, 0.0), other.likelihood, best.likelihood) for other in ranking]
    tried += own
    names: dict[str, Trial] = {}
    for trial, explained, by_best in tried:
        share = 1.0 - RIVAL_LAW if best.effect.rivals_with(trial.effect) else LAW
        if trial.effect.name != best.effect.name and explained >= share * by_best:
            names.setdefault(trial.effect.name, trial)
    return names
