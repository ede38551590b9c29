"""Averages over a little time that do not reach from one stretch of the logs into the next."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.ndimage import uniform_filter1d

from ident.arrays import FloatArray, IntArray


def moving_average(values: FloatArray, starts: IntArray, rows: int) -> FloatArray:
    """Return values (N, ...) averaged over so many rows around each.

    Args:
        values: one row after the other.
        starts: numbers of the rows with which stretches begin.
        rows: how many rows.
    """
    found = np.zeros_like(values)
    for a, b in itertools.pairwise([*starts.tolist(), len(values)]):
        if b > a:
            found[a:b] = uniform_filter1d(values[a:b], rows, axis=0, mode="nearest")
    return found
