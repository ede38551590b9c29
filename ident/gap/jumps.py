"""Step 7, abstain: a slow change that may as well be a jump at one moment of each log, as of a brake, has no name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.gap.candidates import with_errors
from ident.gap.joint_gap import JointGap, Named
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.search import penalised, priced

SLOW = {"thermal-friction": "coulomb", "sensor-drift": "current-offset"}
"""Effects that change slowly, and what it is that may jump instead."""

MOMENTS = tuple((0.05 * np.arange(1, 20)).tolist())
"""Shares of a log at which it may."""


def may_be_jump(panel: Panel, gap: JointGap, one: Named, named: Sequence[Named]) -> bool:
    """Whether a jump would explain a joint better than a slow change that it was given, beside its other names."""
    own = {term.effect.name: term.effect for term in panel.model.terms if term.effect.joint == gap.joint}
    steady = own.get(SLOW.get(one.effect.name, ""))
    if steady is None:
        return False
    problem = gap.problem(panel, [n.trial for n in named if n is not one])
    column = panel.columns(steady, np.zeros(0), gap.joint)[problem.keep, 0]
    log = panel.log[problem.keep]
    logs = [log == k for k in np.unique(log)]
    jumping = _jumping(problem, column, logs, panel.motion.t[problem.keep])
    least = penalised(with_errors(panel, problem, one.trial, gap.joint))
    return priced(problem.errors(jumping[:, None]).total, 1 + len(logs)) < least


def _jumping(problem: JointProblem, column: FloatArray, logs: Sequence[BoolArray], t: FloatArray) -> FloatArray:
    """A column (N,) up to a moment of each log, or none of it: those at which one force explains most."""
    until = [[column * (rows & (t < np.quantile(t[rows], share))) for share in MOMENTS] for rows in logs]
    seen = [[problem.away(one[:, None])[:, 0] for one in tried] for tried in until]
    told = np.array([[one @ problem.residual for one in tried] for tried in seen])
    squares = np.array([[max(float(one @ one), 1e-300) for one in tried] for tried in seen])
    first = np.argmax(told**2 / squares, axis=1)
    each = np.arange(len(logs))
    force = told[each, first].sum() / squares[each, first].sum()
    fallen = 2.0 * force * told - force**2 * squares
    best = np.argmax(fallen, axis=1)
    return np.asarray(np.sum([until[k][best[k]] * (fallen[k, best[k]] > 0.0) for k in each], axis=0))
