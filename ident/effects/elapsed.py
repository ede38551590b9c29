"""Time since a robot was switched on, or since each of its logs began."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray

PAUSE = 1.0
"""Seconds at least from the end of one log to the beginning of the next, where logs are put on one clock."""


def elapsed(t: FloatArray, since: float, begins: tuple[float, ...] = ()) -> FloatArray:
    """Seconds (N,) by which time stamps (N,) are later than one, or than the log of each began.

    Args:
        t: time stamps [s].
        since: that one [s].
        begins: time stamp [s] at which each log began, in order; none where all count from that one.
    """
    if not begins:
        return t - since
    starts = np.array(begins)
    # From within the pause, for a log's first stamp may be rounded to before it begins.
    passed: FloatArray = t - starts[np.searchsorted(starts[1:] - 0.5 * PAUSE, t)]
    return passed
