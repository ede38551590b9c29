"""Time stamps as they come: repeated, dropped, or with values that are no numbers."""

from __future__ import annotations

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.compiled import compiled
from observers.residual import UNUSABLE, Flag

LATE = 1.5
"""A time step of more nominal periods than this has dropped samples in it."""

_MISSING, _REPEATED, _GAP, _SETTLING = (int(f) for f in (Flag.MISSING, Flag.REPEATED, Flag.GAP, Flag.SETTLING))


class Stamps:
    """Flags samples and measures the time steps between those that can be used.

    Args:
        rate: nominal samples a second [Hz].
        forget: time step [s] after which everything starts anew.
        settle: time [s] after a start in which filters have not forgotten it yet.
    """

    def __init__(self, rate: float, forget: float, settle: float) -> None:
        self._limits = np.array([LATE / rate, forget, settle])
        self._clock = np.zeros(4)

    def reset(self) -> None:
        """Forget the past, as at the start of a segment."""
        self._clock[:] = 0.0

    def scan(self, t: FloatArray, *values: FloatArray) -> tuple[IntArray, FloatArray]:
        """Flag rows of stamps (N,) and values (N, k), going on from the rows before.

        Returns:
            flags: `Flag` of each row, (N,).
            step: time since the last usable row [s], (N,); 0 where an observer starts, negative before it may.
        """
        finite = np.isfinite(t)
        for value in values:
            finite &= np.isfinite(value).all(axis=1)
        flags, step = np.empty(len(t), dtype=np.int64), np.empty(len(t))
        _scan(t, finite, self._limits, self._clock, flags, step)
        return flags, step

    @property
    def parts(self) -> tuple[FloatArray, FloatArray]:
        """What ``judge`` works on: limits, and the clock that it changes in place."""
        return self._limits, self._clock


def usable(flags: IntArray) -> BoolArray:
    """Rows that carry a sample of their own, (N,)."""
    own: BoolArray = (flags & UNUSABLE) == 0
    return own


@compiled
def judge(t: float, finite: bool, limits: FloatArray, clock: FloatArray) -> tuple[int, float]:
    """Flag one sample and measure its time step, as ``Stamps.scan`` does.

    ``clock`` is [started, time of the last usable row, time of the start, whether an observer has started].
    """
    late, forget, settle = limits[0], limits[1], limits[2]
    if not finite:
        return _MISSING, -1.0
    flags = 0
    passed = t - clock[1]
    if clock[0] == 0.0 or passed > forget:
        if clock[0] != 0.0:
            flags |= _GAP
        clock[0], clock[2], clock[3] = 1.0, t, 0.0
    elif passed <= 0.0:
        return _REPEATED, -1.0
    elif passed > late:
        flags |= _GAP
    clock[1] = t
    if t - clock[2] < settle:
        return flags | _SETTLING, -1.0
    if clock[3] == 0.0:
        clock[3] = 1.0
        return flags, 0.0
    return flags, passed


@compiled
def _scan(
    t: FloatArray, finite: BoolArray, limits: FloatArray, clock: FloatArray, flags: IntArray, step: FloatArray
) -> None:
    for k in range(len(t)):
        flags[k], step[k] = judge(t[k], finite[k], limits, clock)
