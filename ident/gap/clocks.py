"""Logs whose clocks begin anew: nobody knows when they were recorded, so they are taken to follow one another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Term
from ident.effects.electrical import SensorDrift
from ident.effects.thermal import ThermalFriction
from ident.log import Later, LogSource
from ident.model import CurrentModel

ROWS = 65536
"""Rows that are read at a time to find a log's first and last time stamp."""

CLOCKED = {SensorDrift.name, ThermalFriction.name}
"""Effects that follow the clock from log to log."""

PAUSE = 1.0
"""Seconds from the end of one log to the beginning of the next."""


@dataclass(frozen=True)
class Clock:
    """What one clock for logs whose own each begin anew says.

    Attributes:
        begins: time stamp [s] at which each log begins; none where one clock has stamped them as they are.
        later: seconds by which it is ahead of the own clock of a log that follows them.
    """

    begins: tuple[float, ...] = ()
    later: float = 0.0


AS_STAMPED = Clock()
"""Of logs that one clock has stamped."""


def on_one_clock(model: CurrentModel, logs: Sequence[LogSource]) -> tuple[Sequence[LogSource], Clock]:
    """Put logs whose time stamps overlap one after the other, as they are given: heat and drift then go on.

    Of a log that stands alone no clock can be said to begin anew; of logs of several segments what begins anew in each
    log would in each segment; and a model that has what follows the clock knows what that of the logs means.
    """
    segments, spans = zip(*map(_stamps, logs), strict=True)
    anew = max(segments) == 1 and any(after[0] < before[1] for before, after in pairwise(sorted(spans)))
    if not anew or any(term.effect.name in CLOCKED for term in model.terms):
        return logs, AS_STAMPED
    begins, later = [spans[0][0]], list[LogSource]()
    for source, (first, last) in zip(logs, spans, strict=True):
        later.append(Later(source, begins[-1] - first))
        begins.append(begins[-1] + last - first + PAUSE)
    return later, Clock(tuple(begins[:-1]), begins[-1] - begins[0])


def by_own_clock(model: CurrentModel, clock: Clock) -> CurrentModel:
    """A model found with logs on one clock, as it holds for a log that follows them and has a clock of its own."""
    terms = [_earlier(term, clock.later) if term.effect.name in CLOCKED else term for term in model.terms]
    return replace(model, terms=tuple(terms)) if clock.begins else model


def _earlier(term: Term, seconds: float) -> Term:
    assert isinstance(term.effect, SensorDrift | ThermalFriction)
    return replace(term, effect=replace(term.effect, since=term.effect.since - seconds))


def since_begin(t: FloatArray, begins: tuple[float, ...]) -> FloatArray:
    """Seconds (N,) since the log of each time stamp (N,) began; the stamp where one clock has stamped all."""
    if not begins:
        return t
    starts = np.array(begins)
    # From within the pause, for a log's first stamp may be rounded to before it begins.
    passed: FloatArray = t - starts[np.searchsorted(starts[1:] - 0.5 * PAUSE, t)]
    return passed


def clock_warnings(clock: Clock, named: Iterable[str]) -> list[str]:
    """Say of names that follow the clock that the logs' clocks begin anew."""
    clocked = sorted(CLOCKED & set(named))
    if not clock.begins or not clocked:
        return []
    return [
        f"Each log's clock begins anew: the logs were taken to follow each other as given, and {' and '.join(clocked)} "
        "to go on or to begin anew with them, whichever explains more. Check their order."
    ]


def _stamps(source: LogSource) -> tuple[int, tuple[float, float]]:
    """How many segments a log has, and its first and last time stamp [s]."""
    blocks = [(int(b.segment[0]), float(b.t[0]), float(b.t[-1])) for b in source.blocks(ROWS) if len(b) > 0]
    first, last = min((b[1] for b in blocks), default=0.0), max((b[2] for b in blocks), default=0.0)
    return len({number for number, _, _ in blocks}), (first, last)
