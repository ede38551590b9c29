"""Corners rounded off commanded positions, sample by sample, so that blocks of any size give the same motion."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, lfilter, sosfilt, sosfilt_zi

from ident.arrays import FloatArray


class Rounding:
    """Two moving averages in a row: a step of speed becomes a smooth ramp of ``seconds``, with no overshoot.

    A joint that stops does not turn back: what friction remembers is the motion that was asked for.
    """

    def __init__(self, seconds: float, rate: float, start: FloatArray) -> None:
        longer = max(2, round(seconds * rate * 2 / 3))
        shorter = max(1, round(seconds * rate / 3))
        self._taps: FloatArray = np.convolve(np.full(longer, 1.0 / longer), np.full(shorter, 1.0 / shorter))
        # the filter's memory as if the robot had stood at ``start`` (n,) for ever
        left = np.cumsum(self._taps[::-1])[::-1][1:]
        self._state: FloatArray = left[:, None] * start

    def smooth(self, q: FloatArray) -> FloatArray:
        """Return the smoothed positions (N, n)."""
        smooth, self._state = lfilter(self._taps, [1.0], q, axis=0, zi=self._state)
        result: FloatArray = smooth
        return result


class ButterworthSmoothing:
    """A causal Butterworth filter of third ``order`` on commanded positions, settled at ``start`` (n,)."""

    def __init__(self, cutoff: float, rate: float, start: FloatArray, order: int = 3) -> None:
        self._sections = butter(order, cutoff, fs=rate, output="sos")
        self._state = sosfilt_zi(self._sections)[:, :, None] * start

    def smooth(self, q: FloatArray) -> FloatArray:
        """Return the smoothed positions (N, n)."""
        smooth, self._state = sosfilt(self._sections, q, axis=0, zi=self._state)
        result: FloatArray = smooth
        return result


def travel(corners: FloatArray, times: FloatArray, rate: float, ramp: float = 0.15) -> FloatArray:
    """Return positions (N, n) that run straight between ``corners`` (K, n), reached at ``times`` (K,) [s], rounded off.

    The last corner is held for a second so that the rounded motion has come to rest.
    """
    t = np.arange(round((times[-1] + 1.0) * rate)) / rate
    q = np.stack([np.interp(t, times, column) for column in corners.T], axis=1)
    return Rounding(ramp, rate, corners[0]).smooth(q)
