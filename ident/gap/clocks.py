"""Logs whose clocks begin anew: nobody knows when they were recorded, so they are taken to follow one another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ident.arrays import FloatArray
from ident.log import Later, LogSource

ROWS = 65536
"""Rows that are read at a time to find a log's first and last time stamp."""

CLOCKED = {"thermal-friction", "sensor-drift"}
"""Effects that follow the clock from log to log."""

PAUSE = 1.0
"""Seconds from the end of one log to the beginning of the next."""


@dataclass(frozen=True)
class OneClock:
    """Logs on one clock.

    Attributes:
        train, test: the logs.
        begins: time stamp [s] at which each log to learn from begins; none where one clock has stamped them as it is.
    """

    train: Sequence[LogSource]
    test: Sequence[LogSource]
    begins: tuple[float, ...] = ()


def on_one_clock(train: Sequence[LogSource], test: Sequence[LogSource]) -> OneClock:
    """Put logs to learn from, whose time stamps overlap, one after the other as they are given, and others behind them.

    Heat and drift then go on from log to log. Of a log that stands alone no clock can be said to begin anew.
    """
    spans = [_span(source) for source in train]
    if all(before[1] <= after[0] for before, after in pairwise(sorted(spans))):
        return OneClock(train, test)
    begins, later = [spans[0][0]], list[LogSource]()
    for source, (first, last) in zip((*train, *test), (*spans, *map(_span, test)), strict=True):
        later.append(Later(source, begins[-1] - first))
        begins.append(begins[-1] + last - first + PAUSE)
    return OneClock(later[: len(train)], later[len(train) :], tuple(begins[: len(train)]))


def since_begin(t: FloatArray, begins: tuple[float, ...]) -> FloatArray:
    """Seconds (N,) since the log of each time stamp (N,) began; the stamp where one clock has stamped all."""
    if not begins:
        return t
    starts = np.array(begins)
    # From within the pause, for a log's first stamp may be rounded to before it begins.
    passed: FloatArray = t - starts[np.searchsorted(starts[1:] - 0.5 * PAUSE, t)]
    return passed


def clock_warnings(begins: Sequence[float], named: Iterable[str]) -> list[str]:
    """Say of names that follow the clock that the logs' clocks begin anew."""
    clocked = sorted(CLOCKED & set(named))
    if not begins or not clocked:
        return []
    return [
        f"Each log's clock begins anew: the logs were taken to follow each other as given, and {' and '.join(clocked)} "
        "to go on or to begin anew with them, whichever explains more. Check their order."
    ]


def _span(source: LogSource) -> tuple[float, float]:
    """First and last time stamp [s] of a log."""
    stamps = [stamp for block in source.blocks(ROWS) if len(block) > 0 for stamp in (block.t[0], block.t[-1])]
    return float(min(stamps, default=0.0)), float(max(stamps, default=0.0))
