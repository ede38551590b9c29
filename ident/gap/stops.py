"""Step 7, abstain: a spring that may as well be a stop, which is met towards an end of the range and has no name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ident.arrays import FloatArray
from ident.gap.candidates import with_errors
from ident.gap.joint_gap import JointGap, Named
from ident.gap.panel import Panel
from ident.gap.search import penalised, priced

SPRING = "spring"
"""Kind of the effects that a stop is taken for."""

MET = tuple((0.05 * np.arange(1, 9)).tolist())
"""Shares of the positions seen, from either end, from which on a stop may be met."""

POWERS = (1.0, 1.5, 2.0, 3.0)
"""Powers of the way into a stop by which its force may grow: one and a half between round bodies (Hertz 1882)."""

PARAMETERS = 3
"""Where it is met, a power and a force."""


def may_be_stop(panel: Panel, gap: JointGap, one: Named, named: Sequence[Named]) -> bool:
    """Whether a stop would explain a joint better than a spring that it was given, beside its other names."""
    if one.effect.kind != SPRING:
        return False
    problem = gap.problem(panel, [n.trial for n in named if n is not one])
    least = penalised(with_errors(panel, problem, one.trial, gap.joint))
    position = panel.motion.q[problem.keep, gap.joint]
    return any(priced(problem.errors(into[:, None]).total, PARAMETERS) < least for into in _stops(position))


def _stops(position: FloatArray) -> Iterator[FloatArray]:
    """Yield how far positions (N,) are beyond where a stop is met, to each power."""
    low, high = float(position.min()), float(position.max())
    for share in MET:
        for beyond in (position - (high - share * (high - low)), low + share * (high - low) - position):
            into = np.maximum(beyond, 0.0)
            if into.any():
                yield from (into**power for power in POWERS)
