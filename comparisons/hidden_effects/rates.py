"""Shares, medians and F1 with their intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from ident.arrays import FloatArray

RESAMPLED = 1000


@dataclass(frozen=True)
class Rate:
    """How many of how many, with Wilson's 95 % interval."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        """The share; NaN of nothing."""
        return self.hits / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's score interval (Wilson 1927); NaN of nothing."""
        if not self.of:
            return math.nan, math.nan
        z, n = NormalDist().inv_cdf(0.975), self.of
        centre = self.value + z * z / (2 * n)
        half = z * math.sqrt(self.value * (1 - self.value) / n + z * z / (4 * n * n))
        low, high = (centre - half) / (1 + z * z / n), (centre + half) / (1 + z * z / n)
        return max(low, 0.0) if self.hits else 0.0, min(high, 1.0) if self.hits < n else 1.0

    @staticmethod
    def of_all(values: Iterable[bool]) -> Rate:
        """Count the true ones."""
        listed = list(values)
        return Rate(sum(listed), len(listed))


@dataclass(frozen=True)
class Score:
    """One figure of the table: a share, a median or an F1, its interval, and how many it was taken of."""

    value: float
    interval: tuple[float, float]
    of: int

    @staticmethod
    def share(values: Iterable[bool]) -> Score:
        """Return a share with Wilson's interval."""
        rate = Rate.of_all(values)
        return Score(rate.value, rate.interval, rate.of)

    @staticmethod
    def median(values: Iterable[float]) -> Score:
        """Return the median of those values that are known, with the quartiles."""
        known = np.array([v for v in values if math.isfinite(v)])
        if len(known) == 0:
            return Score(math.nan, (math.nan, math.nan), 0)
        low, middle, high = np.quantile(known, [0.25, 0.5, 0.75])
        return Score(float(middle), (float(low), float(high)), len(known))

    @staticmethod
    def f1(counts: Sequence[tuple[int, int, int]]) -> Score:
        """Return F1 over all cases together, with its 95 % interval by resampling of cases.

        Args:
            counts: of each case, names that are right, names too many, effects that are missed.
        """
        table = np.array(counts, dtype=float).reshape(-1, 3)
        if len(table) == 0:
            return Score(math.nan, (math.nan, math.nan), 0)
        drawn = np.random.default_rng(0).integers(0, len(table), (RESAMPLED, len(table)))
        spread = [_f1(table[rows].sum(axis=0)) for rows in drawn]
        low, high = np.quantile(spread, [0.025, 0.975])
        return Score(_f1(table.sum(axis=0)), (float(low), float(high)), len(table))


def _f1(counts: FloatArray) -> float:
    found, extra, missed = counts.tolist()
    whole = 2 * found + extra + missed
    return 2 * found / whole if whole else 1.0
