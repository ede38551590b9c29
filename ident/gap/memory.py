"""Step 7, abstain: what a residual tells of itself a moment later or earlier, whatever it may follow."""

from __future__ import annotations

import itertools

import numpy as np

from ident.arrays import FloatArray, IntArray

NEAREST, FARTHEST, WIDTH = 0.2, 0.8, 0.1
"""Seconds from a row to the nearest and to the farthest of its neighbours, and over which they are averaged.

Beyond the first, noise that a drive's filters have smoothed is forgotten, and so is what a baseline errs in reversals.
"""

STRETCH, FOLDS = 4.0, 3
"""Seconds of a stretch of rows that is held out as a whole, and every which one is."""


def remembered(residual: FloatArray, starts: IntArray, step: float) -> float:
    """Share of the squared residual that its own neighbours in time predict, on stretches held out.

    Noise predicts nothing; what has a cause lasts, though the cause be one that no signal shows. The prediction is
    linear in means over windows before and after (interpolation of a stationary series, Kolmogorov 1941).

    Args:
        residual: what is left in the rows (N,).
        starts: numbers of the rows with which each stretch begins.
        step: seconds from row to row; with rows farther apart than the neighbours nothing is told.
    """
    width = max(1, round(WIDTH / step))
    offsets = np.arange(max(1, round(NEAREST / step)), round(FARTHEST / step) - width + 2, width)
    if len(offsets) == 0:
        return 0.0
    edges = [*starts.tolist(), len(residual)]
    near = np.concatenate([_neighbours(residual[a:b], offsets, width) for a, b in itertools.pairwise(edges)])
    seconds = np.concatenate([step * np.arange(b - a) for a, b in itertools.pairwise(edges)])
    fold = (seconds // STRETCH).astype(np.int64) % FOLDS
    predicted = np.zeros(len(residual))
    for k in range(FOLDS):
        held = fold == k
        predicted[held] = near[held] @ np.linalg.lstsq(near[~held], residual[~held])[0]
    return max(1.0 - float(np.sum((residual - predicted) ** 2)) / max(float(np.sum(residual**2)), 1e-300), 0.0)


def _neighbours(values: FloatArray, offsets: IntArray, width: int) -> FloatArray:
    """Means (N, 2 k) of values (N,) over windows that begin k offsets before and after; nought beyond the ends."""
    reach = int(offsets[-1]) + width
    padded = np.pad(values, reach)
    sums = np.cumsum(np.insert(padded, 0, 0.0))
    at = reach + np.arange(len(values))
    after = [sums[at + k + width] - sums[at + k] for k in offsets.tolist()]
    before = [sums[at - k + 1] - sums[at - k - width + 1] for k in offsets.tolist()]
    return np.stack([*before, *after], axis=1) / width
