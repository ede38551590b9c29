"""Step 7, abstain: slow wandering of the residual that no motion repeats and no effect of the catalogue follows."""

from __future__ import annotations

import itertools

import numpy as np

from ident.arrays import FloatArray, IntArray

WINDOW = 4.0
"""Seconds over which the residual is averaged."""

FEWEST = 8
"""Windows without which nothing is said."""


def wandering(residual: FloatArray, starts: IntArray, step: float) -> float:
    """Share of the squared residual that means over windows hold beyond what quicker noise leaves in them.

    Within a window, the means of its quarters say how much noise of short memory leaves in the mean of the whole (a
    nested analysis of variance); what the windows' means spread beyond that is slow.

    Args:
        residual: what is left in the rows (N,).
        starts: numbers of the rows with which each stretch begins.
        step: seconds from row to row.
    """
    rows = max(4, round(WINDOW / step / 4.0) * 4)
    quarters = []
    for first, end in itertools.pairwise([*starts.tolist(), len(residual)]):
        count = (end - first) // rows
        quarters.append(residual[first : first + count * rows].reshape(count, 4, rows // 4).mean(axis=2))
    means = np.concatenate(quarters) if quarters else np.zeros((0, 4))
    if len(means) < FEWEST:
        return 0.0
    inside = float(means.var(axis=1, ddof=1).mean()) / 4.0
    between = float(means.mean(axis=1).var(ddof=1))
    return max(between - inside, 0.0) / max(float(np.mean(residual**2)), 1e-300)
