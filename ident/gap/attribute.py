"""Step 5, attribute: which effects, together, explain a joint's gap: forward selection, swaps, backward pruning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ident.effects.survey import Survey
from ident.gap.candidates import Trial, in_rows, kind_of, refine, with_errors
from ident.gap.joint_gap import JointGap, Named
from ident.gap.panel import Panel
from ident.gap.problem import gain
from ident.gap.search import GAIN, Beside, Search, penalised, search

MOST = 4
"""Effects at most that one joint is given."""


def attribute(panel: Panel, survey: Survey, first: Search) -> Search:
    """Name the effects that a joint lacks, in the order in which they were found; the search beside all of them.

    Where none of those left holds everywhere, the best of them is tried beside others yet to be found; all of them
    are named if, beside one another, each does.

    Args:
        panel: the rows.
        survey: facts about the logs.
        first: the joint's search with nothing named.
    """
    gap = first.gap
    last = _grown(panel, survey, first)
    bold = last.winner(panel, certain=False) if len(last.named) < MOST - 1 else None
    if bold is not None:
        more = _grown(panel, survey, search(panel, survey, gap, [*last.named, bold]))
        enough = len(more.named) > len(last.named) + 1
        if enough and all(holds_beside(panel, gap, one, more.named) for one in more.named):
            return more
    return last


def _grown(panel: Panel, survey: Survey, tried: Search) -> Search:
    """Add effects to those named while one passes; return the search in which none does."""
    gap, named = tried.gap, list(tried.named)
    while len(named) < MOST and (found := tried.winner(panel)) is not None:
        named.append(found)
        if len(named) > 1:
            named = _swapped(panel, gap, named)
        tried = search(panel, survey, gap, named)
    kept = _pruned(panel, gap, named)
    return tried if len(kept) == len(named) else search(panel, survey, gap, kept)


def still_holding(panel: Panel, gap: JointGap, named: Sequence[Named]) -> list[Named]:
    """Names, each fitted anew among the others or its better rival; none unless each passes beside the others."""
    again = _swapped(panel, gap, list(named))
    return again if all(holds_beside(panel, gap, one, again) for one in again) else []


def holds_beside(panel: Panel, gap: JointGap, one: Named, named: Sequence[Named]) -> bool:
    """Whether an effect passes with all the others in place."""
    beside = Beside.of(panel, gap, [n for n in named if n is not one])
    return beside.passes(panel, with_errors(panel, beside.problem, one.trial, gap.joint))


def _swapped(panel: Panel, gap: JointGap, named: list[Named]) -> list[Named]:
    """Fit shapes again, each effect's among the others, and put a rival in its place where that is better and holds."""
    for k, old in enumerate(named):
        beside = Beside.of(panel, gap, [n for n in named if n is not old])
        taken = {kind_of(n.effect) for n in named if n is not old}
        rivals = [t for t in old.ranking[:6] if t.effect is not old.effect and kind_of(t.effect) not in taken]
        again = (_again(panel, beside, t) for t in [old.trial, *rivals])
        tried = sorted((with_errors(panel, beside.problem, t, gap.joint) for t in again), key=penalised)
        untried = [t for t in old.ranking if all(t.effect is not x.effect for x in tried)]
        best = next(t for t in tried if t.effect is old.effect or _could_replace(panel, beside, old, t))
        named[k] = replace(old, trial=best, ranking=(*tried, *untried))
    return named


def _could_replace(panel: Panel, beside: Beside, old: Named, trial: Trial) -> bool:
    """Whether a rival passes in a name's place, which is no limit of it."""
    if old.effect.name in trial.effect.contains or beside.explained(trial) <= beside.law_error(trial.effect):
        return False
    return beside.passes(panel, trial)


def _again(panel: Panel, beside: Beside, trial: Trial) -> Trial:
    return refine(panel, beside.problem, [in_rows(panel, beside.problem, trial, beside.joint)], beside.joint)


def _pruned(panel: Panel, gap: JointGap, named: list[Named]) -> list[Named]:
    """Leave out effects that the others make needless."""
    kept = list(named)
    for one in list(named):
        others = [n for n in kept if n is not one]
        # What is a limit of another's shape cannot but be needless beside it.
        if not others or any(one.effect.name in n.effect.contains for n in others if n.effect.shapes):
            continue
        with_it = gap.problem(panel, [n.trial for n in kept]).errors()
        without = gap.problem(panel, [n.trial for n in others]).errors()
        if gain(without.total, with_it.total) <= GAIN:
            kept = others
    return kept
