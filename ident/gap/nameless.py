"""Step 7, abstain: laws without a name against which names are held, lest the nearest name be given to one of them.

A stop is met towards an end of the range and looks like a spring; a brake that drags for a while, or a sensor that is
knocked, jumps at one moment and looks like what changes slowly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ident.arrays import FloatArray
from ident.gap.candidates import with_errors
from ident.gap.joint_gap import JointGap, Named
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.search import penalised, priced

SPRING = "spring"
"""Kind of the effects that a stop is taken for."""

MET = tuple((0.05 * np.arange(1, 9)).tolist())
"""Shares of the positions seen, from either end, from which on a stop may be met."""

POWERS = (1.0, 1.5, 2.0, 3.0)
"""Powers of the way into a stop by which its force may grow: one and a half between round bodies (Hertz 1882)."""

STOP = 3
"""Its parameters: where it is met, a power and a force."""

SLOW = {"thermal-friction": "coulomb", "sensor-drift": "current-offset"}
"""Effects that change slowly, and what it is that may jump instead."""

MOMENTS = tuple((0.05 * np.arange(1, 20)).tolist())
"""Shares of a log at which it may."""


def may_have_no_name(panel: Panel, gap: JointGap, one: Named, named: Sequence[Named]) -> bool:
    """Whether such a law would explain a joint better than an effect that it was given, beside its other names."""
    if one.effect.kind != SPRING and one.effect.name not in SLOW:
        return False
    problem = gap.problem(panel, [n.trial for n in named if n is not one])
    least = penalised(with_errors(panel, problem, one.trial, gap.joint))
    steady = SLOW.get(one.effect.name)
    laws = _stops(panel, problem, gap.joint) if steady is None else _jumps(panel, problem, gap.joint, steady)
    return any(priced(problem.errors(column).total, parameters) < least for column, parameters in laws)


def _stops(panel: Panel, problem: JointProblem, joint: int) -> Iterator[tuple[FloatArray, int]]:
    """Yield how far positions (N, 1) are beyond where a stop is met, to each power, and its parameters."""
    position = panel.motion.q[problem.keep, joint]
    low, high = float(position.min()), float(position.max())
    for share in MET:
        for beyond in (position - (high - share * (high - low)), low + share * (high - low) - position):
            into = np.maximum(beyond, 0.0)[:, None]
            if into.any():
                yield from ((into**power, STOP) for power in POWERS)


def _jumps(panel: Panel, problem: JointProblem, joint: int, steady: str) -> Iterator[tuple[FloatArray, int]]:
    """Yield what is there up to a moment of each log (N, 1), as the model's steady effect is, and its parameters."""
    log, t = panel.log[problem.keep], panel.motion.t[problem.keep]
    logs = [log == k for k in np.unique(log)]
    for term in panel.model.terms:
        if term.effect.name == steady and term.effect.joint == joint:
            column = panel.columns(term.effect, term.shape, joint)[problem.keep, 0]
            until = [[column * (own & (t < moment)) for moment in np.quantile(t[own], MOMENTS)] for own in logs]
            yield _of_one_force(problem, until)[:, None], 1 + len(logs)


def _of_one_force(problem: JointProblem, until: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Sum (N,) of a column (N,) of each log, or none of it: those of which one force explains most."""
    seen = [[problem.away(one[:, None])[:, 0] for one in tried] for tried in until]
    told = np.array([[one @ problem.residual for one in tried] for tried in seen])
    squares = np.array([[max(float(one @ one), 1e-300) for one in tried] for tried in seen])
    first = np.argmax(told**2 / squares, axis=1)
    each = np.arange(len(until))
    force = told[each, first].sum() / squares[each, first].sum()
    fallen = 2.0 * force * told - force**2 * squares
    best = zip(until, fallen, np.argmax(fallen, axis=1).tolist(), strict=True)
    return np.asarray(np.sum([tried[k] * (falls[k] > 0.0) for tried, falls, k in best], axis=0))
