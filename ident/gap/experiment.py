"""Step 6, the next experiment: which motion would tell two names apart, by simulating each on a catalogue of motions.

With the one name taken for the truth, the other is fitted to what the one says, shape and baseline with it, on the logs
and on the motion together. What it cannot follow is what the motion would show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import FloatArray
from ident.cutoff import HIGHEST_SHARE
from ident.effects.base import Effect
from ident.effects.elapsed import PAUSE
from ident.effects.survey import Survey
from ident.gap.candidates import Trial, admissible, best_shape, best_start, force_of, kind_of, refine
from ident.gap.clocks import begun_again
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.log import JointLog, Later
from ident.model import CurrentModel
from ident.walk import collect

ROWS = 4000
"""Rows of the logs, and as many of a motion, that names are compared on."""

REFINED = 3
"""Motions for which the other name's shape is searched; the rest are only compared at the shape it has."""

SETTLED = 0.05
"""Share of what a name explains, on logs and motion together, that the other must miss: no law is exact."""

PLAIN = 0.5
"""RMS by which they must differ on the motion, over that of what is left: no model of a joint is exact, and it errs by
another force on another motion (two gains beside friction stayed open on motions with .16 and .45)."""


SHOWS = 0.1
"""The same below which a motion shows nothing."""


@dataclass(frozen=True)
class Experiment:
    """A motion that separates two names.

    Attributes:
        motion: its name.
        ratio: RMS by which the names would differ on it, the nearer way round, over the RMS of the joint's residual.
        settles: whether they differ, both ways round, by more than laws may be wrong by, and plainly.
    """

    motion: str
    ratio: float
    settles: bool

    @property
    def shows(self) -> bool:
        """Whether it would show any difference."""
        return self.ratio >= SHOWS


@dataclass(frozen=True, eq=False)
class Question:
    """Two names of one joint that the logs leave open.

    Attributes:
        one, other: the names with their shapes.
        besides: what else the joint was given.
        residual: RMS of what both leave, in force units.
        survey: facts about the logs, by which a law has its forms.
    """

    one: Trial
    other: Trial
    besides: tuple[Trial, ...]
    residual: float
    survey: Survey

    def with_log_at(self, begin: float) -> Question:
        """The same where one more log begins at a time stamp [s], for names by which each does so anew."""
        one, other, *besides = (
            replace(trial, effect=begun_again(trial.effect, begin)) for trial in (self.one, self.other, *self.besides)
        )
        survey = self.survey
        if survey.begins:
            survey = replace(survey, begins=(*survey.begins, begin))
        return replace(self, one=one, other=other, besides=tuple(besides), survey=survey)


@dataclass(frozen=True, eq=False)
class Continued:
    """Rows of logs with those of a motion behind them, recorded next.

    Attributes:
        panel: all of them.
        added: how many rows the motion has.
        begin: time stamp [s] at which it begins.
    """

    panel: Panel
    added: int
    begin: float


@dataclass(frozen=True, eq=False)
class Joined:
    """A joint's baseline on such rows.

    Attributes:
        logs: the rows.
        gap: the joint's baseline on them.
    """

    logs: Continued
    gap: JointGap


def with_motion(model: CurrentModel, panel: Panel, commanded: JointLog) -> Continued:
    """Put a commanded motion's rows behind some of a panel's, on their clock."""
    begin = max(float(block.motion.t[-1]) for block in panel.blocks) + PAUSE
    # Logs may be sampled faster than the motion.
    next_one = Later(commanded, begin - float(commanded.t[0]))
    blocks = collect([next_one], min(model.cutoff, HIGHEST_SHARE * commanded.rate))
    contexts = [model.context(block.motion, total=True) for block in blocks]
    own = [np.flatnonzero(block.keep) for block in blocks]
    every = max(1, sum(len(r) for r in own) // ROWS)
    own = [r[::every] for r in own]
    added = sum(len(r) for r in own)
    thin = max(1, len(panel) // ROWS)
    fold = np.zeros(added + sum(len(r[::thin]) for r in panel.rows), dtype=np.int64)
    fold[1::2] = 1
    rows = [*(r[::thin] for r in panel.rows), *own]
    both = Panel(panel.model, [*panel.blocks, *blocks], [*panel.contexts, *contexts], rows, fold)
    return Continued(both, added, begin)


def separating(question: Question, motions: Mapping[str, Joined]) -> Experiment:
    """The motion on which the names of a question differ most, whichever of them is the true one.

    Args:
        question: the two names.
        motions: motions by name, each with the logs' rows and the joint's baseline on them; one at least.
    """
    first = {name: _difference(question, joined, refined=False) for name, joined in motions.items()}
    best = sorted(first, key=lambda name: -first[name].on_motion)[:REFINED]
    found = {name: _difference(question, motions[name], refined=True) for name in best}
    name, most = max(found.items(), key=lambda one: (one[1].settles, one[1].on_motion))
    ratio = most.on_motion / max(question.residual, 1e-300)
    return Experiment(name, ratio, most.settles and ratio >= PLAIN)


@dataclass(frozen=True)
class _Difference:
    """What a rival cannot follow: RMS on the motion's rows, and share of what the truth explains on all rows."""

    on_motion: float
    missed: float

    @property
    def settles(self) -> bool:
        """Whether that is more than laws may be wrong by."""
        return self.missed >= SETTLED


def _difference(question: Question, joined: Joined, refined: bool) -> _Difference:
    """How far two names differ the way round in which they differ less."""
    question = question.with_log_at(joined.logs.begin)
    both = [
        _unfollowed(truth, rival, question, joined, refined)
        for truth, rival in ((question.one, question.other), (question.other, question.one))
    ]
    return _Difference(min(d.on_motion for d in both), min(d.missed for d in both))


def _unfollowed(truth: Trial, rival: Trial, question: Question, joined: Joined, refined: bool) -> _Difference:
    """Compare with a rival that is fitted to all rows of what the truth says, in each of its forms."""
    panel, gap = joined.logs.panel, joined.gap
    problem = replace(gap, target=_said(truth, question.besides, joined)).problem(panel, question.besides)
    rivals = [rival]
    if refined:
        others = [best_start(panel, problem, form, gap.joint) for form in _other_forms(rival.effect, question.survey)]
        rivals = [best_shape(panel, problem, rival, gap.joint)]
        rivals += [refine(panel, problem, [start], gap.joint) for start in others]
    lefts = [problem.left(admissible(panel, problem, r.effect, r.shape, gap.joint)) for r in rivals]
    left = min(lefts, key=lambda one: float(one @ one))
    explained = float(problem.residual @ problem.residual)
    there = problem.keep >= len(panel) - joined.logs.added
    on_motion = float(np.sqrt(np.mean(left[there] ** 2))) if there.any() else 0.0
    return _Difference(on_motion, float(left @ left) / max(explained, 1e-300))


def _other_forms(effect: Effect, survey: Survey) -> list[Effect]:
    """Other forms of an effect's law that the search tries once it has a motion's log."""
    first = [e for e in type(effect).candidates(survey, effect.joint) if kind_of(e) == kind_of(effect)]
    return [e for e in (*first, *(more for one in first for more in one.fuller(survey))) if e != effect]


def _said(truth: Trial, besides: Sequence[Trial], joined: Joined) -> FloatArray:
    """Force (N,) of an effect as fitted to the logs' own rows."""
    panel, gap = joined.logs.panel, joined.gap
    logs = np.arange(len(panel)) < len(panel) - joined.logs.added
    problem = gap.without(~logs).problem(panel, besides)
    return force_of(panel, problem, truth, gap.joint)
