"""Steps 3 to 5 on the whole robot: first causes that joints share, then each joint's own, and which are believed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Effect, Term
from ident.effects.timing import Timing
from ident.gap.attribute import attribute, holds_beside, still_holding
from ident.gap.belief import believed
from ident.gap.borne_out import late_on_all
from ident.gap.candidates import coefficients
from ident.gap.edge import with_less_edge
from ident.gap.joint_gap import JointGap, Named
from ident.gap.on_all import Whole, columns_of
from ident.gap.panel import Panel
from ident.gap.rests import slipless
from ident.gap.search import LEVEL, Search, search
from ident.gap.subject import Subject
from ident.gap.threads import in_threads
from ident.gap.whole import whole_effect

MOST_OF_ALL = 2
"""Causes of the whole robot at most that no joint has; springs it may have as many as joints."""

DEPENDENT = {"links", "load", "total"}
"""What effects need of a model that is fitted again with them before they are judged."""

AS_MUCH = 0.9
"""Share of what is explained of a joint that links not bent to its effect must leave explained: a law that is nearly
right may bend them further."""


@dataclass(frozen=True, eq=False)
class Causes:
    """Causes of the whole robot, each joint's rows without them, its own causes, and those that are not believed.

    ``p_values`` (n,) say how sure the first of each joint is; ``stuck`` are joints that are given friction with a
    memory of no displacement: that is dry friction that sticks.
    """

    wholes: list[Whole]
    gaps: list[JointGap]
    named: list[list[Named]]
    doubted: list[list[Named]]
    p_values: FloatArray
    stuck: list[int]

    def without(self, denied: Sequence[Named]) -> Causes:
        """Causes of which some of joints' own are doubted."""
        named = [[one for one in own if one not in denied] for own in self.named]
        doubted = [
            [*old, *(one for one in own if one in denied)] for old, own in zip(self.doubted, self.named, strict=True)
        ]
        return replace(self, named=named, doubted=doubted)

    def lateness(self, panel: Panel) -> FloatArray:
        """Seconds (n,) by which each joint's current comes late in slow motion."""
        late = _lateness(panel, self.wholes)
        for gap, names in zip(self.gaps, self.named, strict=True):
            for one in names:
                if isinstance(one.effect, Timing):
                    found = gap.coefficients_of(panel, one, names)
                    late[gap.joint] += one.effect.lateness(one.trial.shape, found)
        return late


def name_causes(subject: Subject, tell: Callable[[float], None]) -> Causes | None:
    """Name what a model lacks, on rows that are seen anew by links that names would bend.

    None if currents that come late on all joints made signs of velocity be chosen anew, with which to begin again.

    Args:
        subject: the model and its rows.
        tell: told the share of it that is done.
    """
    tell(0.0)
    gaps = subject.sure_gaps()
    late = late_on_all(subject.panel, subject.survey, gaps, _known(subject, []))
    wholes: list[Whole] = []
    if late is not None:
        wholes.append(late)
        if subject.turn(_lateness(subject.panel, wholes)):
            return None
        gaps = _without(subject, gaps, late)
    searches = _seen_anew(subject, _searches(subject, gaps))
    p_values = np.array([one.least_p_value(subject.panel) for one in searches])
    tell(0.5)
    for _ in range(subject.model.n + MOST_OF_ALL):
        found = whole_effect(subject.panel, subject.survey, searches, _known(subject, wholes))
        if found is None:
            break
        wholes.append(found)
        gaps = _without(subject, gaps, found)
        searches = _searches(subject, gaps)
    named = _attributed(subject, searches)
    beside = _whole_beside(subject, searches, named, _known(subject, wholes))
    if beside is None:
        beside = _whole_beside_likely(subject, gaps, named, _known(subject, wholes))
    if beside is not None:
        wholes.append(beside)
        named = _attributed(subject, _searches(subject, _without(subject, gaps, beside)))
    tell(1.0)
    gaps, sure, doubted = map(list, zip(*in_threads(lambda one: _judged(subject, one), named), strict=True))
    each = zip(gaps, sure, doubted, strict=True)
    stuck = [gap.joint for gap, names, others in each if _slipless(subject, gap, [*names, *others])]
    return Causes(wholes, gaps, sure, doubted, p_values, stuck)


def _lateness(panel: Panel, wholes: Sequence[Whole]) -> FloatArray:
    """Seconds (n,) by which causes of the whole robot make each joint's current come late in slow motion."""
    timing = (w.effect.lateness(w.shape, w.coefficients) for w in wholes if isinstance(w.effect, Timing))
    return np.full(panel.robot.n, sum(timing, start=0.0))


def _searches(subject: Subject, gaps: Sequence[JointGap]) -> list[Search]:
    return in_threads(lambda gap: search(subject.panel, subject.survey, gap), gaps)


def _attributed(subject: Subject, searches: Sequence[Search]) -> list[Search]:
    """Every joint's search beside its own causes, from those with nothing named."""
    return in_threads(lambda first: attribute(subject.panel, subject.survey, first), searches)


def _known(subject: Subject, wholes: Sequence[Whole]) -> list[Effect]:
    """Causes of the whole robot that the model has, and those found."""
    return [*(t.effect for t in subject.model.terms if t.effect.acts_on is None), *(w.effect for w in wholes)]


def _without(subject: Subject, gaps: Sequence[JointGap], whole: Whole) -> list[JointGap]:
    """Every joint's rows with a cause of the whole robot, which none has once more, taken away."""
    added = (columns_of(subject.panel, whole, gap.joint) for gap in gaps)
    return [gap.knowing(subject.panel, whole.effect, force) for gap, force in zip(gaps, added, strict=True)]


def _seen_anew(subject: Subject, searches: Sequence[Search]) -> list[Search]:
    """The searches, anew where a likely effect depends on links that, fitted without it, have bent to it.

    Where less is explained then, the links are left as they were.
    """
    if not subject.refit:
        return list(searches)
    likely = {one.joint: one.winner(subject.panel, certain=False) for one in searches}
    dependent = {j: n.trial for j, n in likely.items() if n is not None and DEPENDENT & {*n.effect.needs}}
    if not dependent:
        return list(searches)
    seen = subject.panel, subject.survey
    subject.bend([
        Term(trial.effect, trial.shape, coefficients(subject.panel, searches[j].problem, trial, j))
        for j, trial in dependent.items()
    ])  # fmt: skip
    unbent = [one for one in searches if one.joint in dependent]
    anew = {one.joint: one for one in _searches(subject, [one.gap for one in unbent])}
    if any(anew[one.joint].most < AS_MUCH * one.most for one in unbent):
        subject.panel, subject.survey = seen
        return list(searches)
    return [anew.get(one.joint, one) for one in searches]


def _whole_beside(
    subject: Subject, plain: Sequence[Search], full: Sequence[Search], present: Sequence[Effect]
) -> Whole | None:
    """A cause of the whole robot that shows only once joints' own causes are known, or that one was taken for.

    Args:
        subject: the model and its rows.
        plain: every joint's search with nothing named.
        full: the same beside its own causes.
        present: causes of the whole robot that are known.
    """
    if not any(one.named for one in full):
        return None
    found = (
        whole_effect(subject.panel, subject.survey, searches, present, last=True, instead=left_out)
        for searches, left_out in _beside(subject, plain, full)
    )
    return next((one for one in found if one is not None), None)


def _beside(
    subject: Subject, plain: Sequence[Search], full: Sequence[Search]
) -> Iterator[tuple[list[Search], Effect | None]]:
    """Yield every joint's search beside all that is named, and beside all but one name, with that, in turn."""
    yield list(full), None
    for j, one in enumerate(full):
        for left_out in one.named:
            others = [n for n in one.named if n is not left_out]
            without = search(subject.panel, subject.survey, one.gap, others) if others else plain[j]
            yield [*full[:j], without, *full[j + 1 :]], left_out.effect


def _whole_beside_likely(
    subject: Subject, gaps: Sequence[JointGap], full: Sequence[Search], present: Sequence[Effect]
) -> Whole | None:
    """A cause of the whole robot that shows only beside what a joint is likely to have, as that does beside it.

    Args:
        subject: the model and its rows.
        gaps: every joint's rows.
        full: every joint's search beside its own causes.
        present: causes of the whole robot that are known.
    """
    panel, survey = subject.panel, subject.survey
    for j, one in enumerate(full):
        likely = one.closest
        if one.named or likely is None or not one.gains(likely):
            continue
        beside = search(panel, survey, one.gap, [Named(likely, LEVEL, one.explained(likely), one.trials)])
        found = whole_effect(panel, survey, [*full[:j], beside, *full[j + 1 :]], present, last=True)
        if found is None:
            continue
        own = attribute(panel, survey, search(panel, survey, _without(subject, gaps, found)[j]))
        names, doubted = _parted(subject, own)
        if names and not doubted:
            return found
    return None


def _judged(subject: Subject, last: Search) -> tuple[JointGap, list[Named], list[Named]]:
    """A joint's rows, the names that are believed, and those that explain what is left but are not."""
    names, doubted = _parted(subject, last)
    if names:
        return last.gap, names, doubted
    sharp = with_less_edge(subject.panel, last.gap, subject.model.terms)
    if sharp is not None:
        found = attribute(subject.panel, subject.survey, search(subject.panel, subject.survey, sharp))
        names, withdrawn = _parted(subject, found)
        if names or (withdrawn and not doubted):
            return sharp, names, withdrawn
    bold = None if doubted else last.winner(subject.panel, certain=False)
    return last.gap, [], doubted if bold is None else [bold]


def _parted(subject: Subject, last: Search) -> tuple[list[Named], list[Named]]:
    """Names of a joint that are believed, and those that are withdrawn: all, if the others do not hold alone."""
    named = list(last.named)
    believable = believed(subject.panel, subject.survey, last.gap, named)
    if len(believable) < len(named):
        named, believable = _steadier(subject, last.gap, named, believable)
    sticks = _slipless(subject, last.gap, believable)
    names = [one for one in believable if one not in sticks]
    withdrawn = [one for one in named if one not in names]
    if not withdrawn:
        return names, []
    names = still_holding(subject.panel, last.gap, names)
    return names, withdrawn if names else named


def _steadier(
    subject: Subject, gap: JointGap, named: list[Named], believable: list[Named]
) -> tuple[list[Named], list[Named]]:
    """Names of a joint and those that are believed, once more with other forms of the laws that were withdrawn.

    A law may have coefficients of its own for what it takes for one, as friction where the load drives.
    """
    for k, one in enumerate(named):
        if one in believable:
            continue
        for form in (t for t in one.ranking if t.effect.name == one.effect.name and t.effect is not one.effect):
            others = [*named[:k], replace(one, trial=form), *named[k + 1 :]]
            if not holds_beside(subject.panel, gap, others[k], others):
                continue
            found = believed(subject.panel, subject.survey, gap, others)
            if len(found) > len(believable):
                named, believable = others, found
                break
    return named, believable


def _slipless(subject: Subject, gap: JointGap, named: Sequence[Named]) -> list[Named]:
    """Names of a joint, beside one another, that are hysteresis of no displacement."""
    return [
        one
        for one in named
        if slipless(subject.panel, gap, one.trial, [other.trial for other in named if other is not one])
    ]
