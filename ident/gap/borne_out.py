"""Whether joints bear a cause of the whole robot out, each by itself: then it is there, however little on any one.

What comes late does so by the same seconds on every joint. Errors of single joints' models ask each for another time,
some of them for less than none. Of a model held fixed that is not asked: currents may have come as late when it was
identified, and little of what it lacked then is no change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from ident.arrays import FloatArray
from ident.effects.base import Effect
from ident.effects.survey import Survey
from ident.effects.timing import Timing
from ident.gap.candidates import forms
from ident.gap.gate import LEAST
from ident.gap.joint_gap import JointGap
from ident.gap.on_all import TINY, OnAll, Whole, at_any_pace, columns_of, likelihoods
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.ranking import alternatives, by_motion, ranked
from ident.gap.search import LEVEL
from ident.gap.threads import in_threads
from ident.uncertainty import correlation_time

TELLS = 3.0
"""Standard errors from nought at which a joint tells of a cause, and from what all agree on at which it denies it."""

LEAST_JOINTS, MOST = 3, 2.0 / 3.0
"""Joints, and share of all, that must tell of it: two may agree by chance."""

ALIKE, HARDLY = 0.3, 1.0
"""Share by which joints may ask for more or less than all agree on beside that: no model of a joint is exact; and at a
shape that was not searched for yet."""


def late_on_all(panel: Panel, survey: Survey, gaps: Sequence[JointGap], present: Sequence[Effect]) -> Whole | None:
    """The law by which all currents come late, if joints bear it out: no joint's own effects need be known for that.

    None of a model held fixed.

    Args:
        panel: the rows.
        survey: facts about the logs.
        gaps: every joint's rows.
        present: causes of the whole robot that are known.
    """
    if survey.held:
        return None
    problems = [gap.problem(panel) for gap in gaps]
    before = np.array([p.errors().held_out for p in problems])
    tried = [OnAll(panel, problems, e, before) for e in forms(survey, None, present) if isinstance(e, Timing)]
    begun = in_threads(OnAll.begun, tried)
    # Most logs are in time: that is seen before anything is searched.
    best = max((one for one in begun if one is not None), key=lambda one: one.likelihood, default=None)
    if best is None or _chance(panel, problems, best, HARDLY) > LEVEL:
        return None
    searched = in_threads(lambda pair: pair[0].searched(pair[1]), zip(tried, begun, strict=True))
    ranking = ranked([one for one in searched if one is not None])
    for best in by_motion(panel, problems, ranking):
        p_value = chance_in_all(panel, survey, problems, best)
        if p_value <= LEVEL:
            explained = likelihoods(problems, before.sum(axis=1), best.held_out.sum(axis=1))
            others = alternatives(best, ranking, ())
            return replace(best, p_value=p_value, alternatives=others, joint=int(np.argmax(explained)))
    return None


def chance_in_all(panel: Panel, survey: Survey, problems: Sequence[JointProblem], whole: Whole) -> float:
    """Chance (p-value) of what joints tell where no current is late; 1 unless they bear out that all of it is.

    Args:
        panel: the rows.
        survey: facts about the logs; 1 of a model held fixed.
        problems: every joint's regression.
        whole: the cause, searched for.
    """
    if survey.held or (whole.law is None and whole.effect.plain(whole.shape) is not None):
        return 1.0
    return _chance(panel, problems, whole.as_meant)


def _chance(panel: Panel, problems: Sequence[JointProblem], law: Whole, alike: float = ALIKE) -> float:
    """The same of as much of a cause as there is; 1 if it makes no current late."""
    if not isinstance(law.effect, Timing) or law.effect.lateness(law.shape, law.coefficients) <= 0.0:
        return 1.0
    found, error = np.array([_share(panel, problem, law, j) for j, problem in enumerate(problems)]).T
    tells = np.sum(found > TELLS * error) >= max(LEAST_JOINTS, MOST * len(problems))
    agree = np.all(np.abs(found - 1.0) < np.hypot(TELLS * error, alike))
    if not (tells and agree and at_any_pace(panel, problems, law)):
        return 1.0
    return max(float(stats.chi2.sf(np.sum((found / error) ** 2), len(problems))), LEAST)


def _share(panel: Panel, problem: JointProblem, whole: Whole, joint: int) -> tuple[float, float]:
    """How many times a cause a joint asks for, and the standard error of that by independent samples."""
    column = columns_of(panel, whole, joint)[problem.keep, None]
    # Friction that builds up within what its encoder does not show comes late, too.
    shown = ~panel.unseen[problem.keep, joint]
    if not shown.any():
        return 0.0, np.inf
    if not shown.all():
        problem, column = problem.among(shown), column[shown]
    column = problem.away(column)[:, 0]
    square = max(float(column @ column), TINY)
    share = float(column @ problem.residual) / square
    left: FloatArray = problem.residual - share * column
    return share, float(np.sqrt(correlation_time(left) * max(float(np.mean(left**2)), TINY) / square))
