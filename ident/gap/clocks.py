"""Logs whose clocks begin anew: nobody knows when they were recorded, so they are taken to follow one another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from ident.effects.base import Effect, Term
from ident.effects.elapsed import PAUSE
from ident.effects.electrical import SensorDrift
from ident.effects.thermal import ThermalFriction
from ident.log import Later, LogSource
from ident.model import CurrentModel

ROWS = 65536
"""Rows that are read at a time to find a log's first and last time stamp."""

CLOCKED = {SensorDrift.name, ThermalFriction.name}
"""Effects that follow the clock from log to log."""


@dataclass(frozen=True)
class Clock:
    """What one clock for logs whose own each begin anew says.

    Attributes:
        begins: time stamp [s] at which each log begins, the first the earliest of their own clocks; none where one
            clock has stamped them as they are.
        later: seconds by which it is ahead of the own clock of a log that follows them.
    """

    begins: tuple[float, ...] = ()
    later: float = 0.0


AS_STAMPED = Clock()
"""Of logs that one clock has stamped."""


def on_one_clock(model: CurrentModel, logs: Sequence[LogSource]) -> tuple[Sequence[LogSource], Clock]:
    """Put logs whose time stamps overlap one after the other, as they are given: heat and drift then go on.

    Of a log that stands alone no clock can be said to begin anew; and a model that has what follows the clock knows
    what that of the logs means.
    """
    spans = [_span(source) for source in logs]
    anew = any(after[0] < before[1] for before, after in pairwise(sorted(spans)))
    if not anew or any(term.effect.name in CLOCKED for term in model.terms):
        return logs, AS_STAMPED
    begins, later = [min(first for first, _ in spans)], list[LogSource]()
    for source, (first, last) in zip(logs, spans, strict=True):
        later.append(Later(source, begins[-1] - first))
        begins.append(begins[-1] + last - first + PAUSE)
    return later, Clock(tuple(begins[:-1]), begins[-1] - begins[0])


def by_own_clock(model: CurrentModel, clock: Clock) -> CurrentModel:
    """A model found with logs on one clock, as it holds for a log that follows them and has a clock of its own."""
    if not clock.begins:
        return model
    terms = [_own(term, clock) if term.effect.name in CLOCKED else term for term in model.terms]
    return replace(model, terms=tuple(terms))


def begun_again(effect: Effect, begin: float) -> Effect:
    """An effect that begins anew in each log, as it holds where one more begins at a time stamp [s]."""
    if isinstance(effect, SensorDrift | ThermalFriction) and effect.begins:
        return replace(effect, begins=(*effect.begins, begin))
    return effect


def _own(term: Term, clock: Clock) -> Term:
    effect = term.effect
    assert isinstance(effect, SensorDrift | ThermalFriction)
    since = clock.begins[0] if effect.begins else effect.since - clock.later
    return replace(term, effect=replace(effect, since=since, begins=()))


def clock_warnings(clock: Clock, named: Iterable[str]) -> list[str]:
    """Say of names that follow the clock that the logs' clocks begin anew."""
    clocked = sorted(CLOCKED & set(named))
    if not clock.begins or not clocked:
        return []
    return [
        f"Each log's clock begins anew: the logs were taken to follow each other as given, and {' and '.join(clocked)} "
        "to go on or to begin anew with them, whichever explains more. Check their order."
    ]


def _span(source: LogSource) -> tuple[float, float]:
    """A log's first and last time stamp [s]."""
    stamps = [t for block in source.blocks(ROWS) if len(block) > 0 for t in (float(block.t[0]), float(block.t[-1]))]
    return min(stamps, default=0.0), max(stamps, default=0.0)
