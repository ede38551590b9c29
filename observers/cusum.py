"""Cumulative sums: small contacts that last."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.compiled import compiled
from ident.errors import InputError
from observers.residual import Residual
from observers.thresholds import EPISODE, FEWEST, tail_level

USUAL = 0.9
"""Share of the contact-free residuals that the sum lets pass without growing."""


@dataclass(frozen=True)
class Alarm:
    """One alarm: ``start`` and ``end`` [s], and the ``joints`` whose sums passed their limits, counted from 1.

    It starts some time after the contact does, the later the weaker it is, and ends some time after it.
    """

    start: float
    end: float
    joints: tuple[int, ...]


class Cusum:
    """Two-sided cumulative sum of each joint's residual (Page 1954): grows by what exceeds the allowance.

    The sum is kept at no more than twice its limit, so that it falls soon after a contact ends.

    Args:
        allowance: residual that the sum lets pass [residual's unit], (n,).
        limit: sum that is an alarm [unit s], (n,).
    """

    def __init__(self, allowance: FloatArray, limit: FloatArray) -> None:
        self.allowance, self.limit = allowance, limit
        self._sums = np.zeros((2, len(allowance)))

    @staticmethod
    def fit(residuals: Sequence[Residual], false_alarms_per_hour: float = 1.0) -> Cusum:
        """Fit to residuals of logs without contact, for a rate of false alarms of all joints together.

        Raises:
            InputError: the logs hold too few seconds.
        """
        n = residuals[0].current.shape[1]
        usual = np.quantile(np.abs(np.concatenate([r.current[r.good] for r in residuals])), USUAL, axis=0)
        open_ended = Cusum(np.maximum(usual, 1e-12), np.full(n, np.inf))
        peaks = [_peaks(r, open_ended.run(r)) for r in residuals]
        every = np.concatenate(peaks)
        if len(every) < FEWEST:
            what = f"{len(every)} s without contact are too few for a cumulative sum"
            raise InputError(what, "cusum", f"give logs of at least {FEWEST} s")
        limit = np.array([tail_level(every[:, j], false_alarms_per_hour / n) for j in range(n)])
        return Cusum(open_ended.allowance, np.maximum(limit, 1e-12))

    def reset(self) -> None:
        """Forget all sums."""
        self._sums[:] = 0.0

    def step(self, residual: FloatArray, dt: float) -> FloatArray:
        """Take a residual (n,) that held for ``dt`` [s] and return the greater sum over the limit, (n,); 1 alarms."""
        out = np.empty(len(residual))
        _scan(np.array([dt]), residual[None], self.allowance, self.limit, self._sums, out[None])
        return out

    def run(self, residual: Residual) -> FloatArray:
        """Return the greater sum over the limit (an infinite one counts as 1), (N, n), from nought at each segment."""
        out = np.empty(residual.current.shape)
        steps = np.diff(residual.t, prepend=residual.t[:1])
        starts = np.diff(residual.segment, prepend=residual.segment[:1]) != 0
        steps[starts | ~residual.good | ~(steps > 0.0)] = 0.0
        for begin, end in _runs(starts):
            self.reset()
            _scan(steps[begin:end], residual.current[begin:end], self.allowance, self.limit, self._sums, out[begin:end])
        return out


def alarms(t: FloatArray, sums: FloatArray, apart: float = 0.1) -> list[Alarm]:
    """Return the alarms in what ``Cusum.run`` gave, in order.

    Args:
        t: time [s], (N,).
        sums: each joint's sum over its limit, (N, n).
        apart: alarms less than this [s] from each other are one.
    """
    over = sums > 1.0
    rows = np.flatnonzero(over.any(axis=1))
    if len(rows) == 0:
        return []
    groups = np.split(rows, np.flatnonzero(np.diff(t[rows]) > apart) + 1)
    joints = [tuple((np.flatnonzero(over[group].any(axis=0)) + 1).tolist()) for group in groups]
    return [Alarm(float(t[g[0]]), float(t[g[-1]]), felt) for g, felt in zip(groups, joints, strict=True)]


def _runs(starts: BoolArray) -> list[tuple[int, int]]:
    bounds = [0, *np.flatnonzero(starts).tolist(), len(starts)]
    return [(a, b) for a, b in itertools.pairwise(bounds) if b > a]


def _peaks(residual: Residual, sums: FloatArray) -> FloatArray:
    bins = np.floor((residual.t - residual.t[0]) / EPISODE).astype(np.int64)
    peaks: FloatArray = np.maximum.reduceat(sums, np.flatnonzero(np.diff(bins, prepend=-1)), axis=0)
    return peaks


@compiled
def _scan(
    step: FloatArray, residual: FloatArray, allowance: FloatArray, limit: FloatArray, sums: FloatArray, out: FloatArray
) -> None:
    for k in range(len(step)):
        for j in range(residual.shape[1]):
            for side in range(2):
                value = residual[k, j] if side == 0 else -residual[k, j]
                grown = sums[side, j] + step[k] * (value - allowance[j])
                sums[side, j] = min(max(grown, 0.0), 2.0 * limit[j])
            unit = limit[j] if np.isfinite(limit[j]) else 1.0
            out[k, j] = max(sums[0, j], sums[1, j]) / unit
