"""Step 7, abstain: what a residual tells of itself a moment later or earlier, whatever it may follow."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ident.arrays import FloatArray, IntArray
from ident.gap.abstain import FOLDS, STRETCH

NEAREST, REACH, WIDTH = 0.2, 0.6, 0.1
"""Seconds from a row to the nearest of its neighbours, from that to the farthest, and over which they are averaged.

Beyond the first, noise that a drive's filters have smoothed is forgotten, and so is what a baseline errs in reversals.
"""

PERIODS = 1.1
"""Periods of the cut-off of a slower filter that the nearest neighbours are away: it smears a reversal as far."""


def remembered(residual: FloatArray, starts: IntArray, step: float, cutoff: float = np.inf) -> float:
    """Share of the squared residual that its own neighbours in time predict, on stretches held out.

    Noise predicts nothing; what has a cause lasts, though the cause be one that no signal shows. The prediction is
    linear in means over windows before and after (interpolation of a stationary series, Kolmogorov 1941).

    Args:
        residual: what is left in the rows (N,).
        starts: numbers of the rows with which each stretch begins.
        step: seconds from row to row; where none is as near as that and no nearer, nothing is told.
        cutoff: of the filter [Hz] that derives velocities.
    """
    nearest = max(NEAREST, PERIODS / cutoff)
    farthest = nearest + REACH
    width = max(1, round(WIDTH / step))
    # A hair's breadth, since .2 / .01 is more than 20.
    offsets = np.arange(math.ceil(nearest / step - 1e-6), math.floor(farthest / step + 1e-6) - width + 2, width)
    squares = float(residual @ residual)
    if len(offsets) == 0 or squares == 0.0:
        return 0.0
    edges = [*starts.tolist(), len(residual)]
    near = np.concatenate([_neighbours(residual[a:b], offsets, width) for a, b in itertools.pairwise(edges)])
    fold = (step * np.arange(len(residual)) // STRETCH).astype(np.int64) % FOLDS
    predicted = np.zeros(len(residual))
    for k in range(FOLDS):
        held = fold == k
        predicted[held] = near[held] @ np.linalg.lstsq(near[~held], residual[~held])[0]
    return max(1.0 - float(np.sum((residual - predicted) ** 2)) / squares, 0.0)


def _neighbours(values: FloatArray, offsets: IntArray, width: int) -> FloatArray:
    """Means (N, 2 k) of values (N,) over windows that begin k offsets before and after; nought beyond the ends."""
    reach = int(offsets[-1]) + width
    means = sliding_window_view(np.pad(values, reach), width).mean(axis=1)
    at = reach + np.arange(len(values))[:, None]
    near: FloatArray = means[at + np.concatenate([1 - width - offsets, offsets])]
    return near
