"""Checks logs against one another: dead channels, units that differ, jittered stamps, and logs that are given twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.errors import InputError
from ident.log import JointLog, LogSource

MOVES = 0.05
"""A joint that has this far [rad or m] to go asks for some current."""

FACTOR = 100.0
"""RMS current of moving joints over that in other logs from which on the unit must differ: no motion asks for as much
more than another."""

AROUND, MANY = 0.5, 0.1
"""Time steps further than this share from their median are uneven, and are worth a warning from this share of them."""

ROWS = 65536
"""Rows that are read at a time."""


@dataclass(frozen=True, eq=False)
class LogFacts:
    """What is known of one log once it was read.

    Attributes:
        source: the log.
        ways: how far each joint moves [rad or m], (n,).
        spans: how far each current does, (n,).
        rms: of each current (n,).
        uneven: share of time steps that are not about the median step.
        steps: shortest, median and longest time step inside a segment [s]; NaN without any.
        head: its first rows.
    """

    source: LogSource
    ways: FloatArray
    spans: FloatArray
    rms: FloatArray
    uneven: float
    steps: tuple[float, float, float]
    head: JointLog

    @property
    def moves(self) -> BoolArray:
        """Which joints move, (n,)."""
        return self.ways > MOVES

    def same_as(self, other: LogFacts) -> bool:
        """Whether the other begins with the same rows, whatever its clock says: it is the same log, or a copy.

        Args:
            other: of another log.
        """
        one, two = self.head, other.head
        return all(np.array_equal(getattr(one, key), getattr(two, key)) for key in ("q", "current"))


def facts_of(source: LogSource) -> LogFacts:
    """Read a log once.

    Args:
        source: the log.

    Raises:
        InputError: it has no rows.
    """
    first: JointLog | None = None
    lows, highs, squares, steps = [], [], [], []
    rows = 0
    for block in source.blocks(ROWS):
        first = block if first is None else first
        both = np.stack([block.q, block.current])
        lows.append(both.min(axis=1))
        highs.append(both.max(axis=1))
        squares.append(np.sum(block.current**2, axis=0))
        rows += len(block)
        steps.append(np.diff(block.t)[np.diff(block.segment) == 0])
    if first is None:
        raise InputError("no rows", path_of(source), "give a log with at least one sample")
    ways, spans = np.max(highs, axis=0) - np.min(lows, axis=0)
    every = np.concatenate(steps)
    low, usual, high = np.quantile(every, (0.0, 0.5, 1.0)).tolist() if len(every) > 0 else [np.nan] * 3
    uneven = float(np.sum(np.abs(every - usual) > AROUND * usual) / max(len(every), 1))
    rms = np.sqrt(np.sum(squares, axis=0) / rows)
    return LogFacts(source, ways, spans, rms, uneven, (low, usual, high), first)


def check_together(train: Sequence[LogSource]) -> None:
    """Refuse logs of which a joint's current never changes as it moves, or of which one is in another unit.

    Args:
        train: logs that are to be learnt from.

    Raises:
        InputError: which column or log, and how to mend it.
    """
    if not train:
        return
    known = [facts_of(source) for source in train]
    moves, spans = (np.max([getattr(one, key) for one in known], axis=0) for key in ("ways", "spans"))
    dead = np.flatnonzero((spans == 0.0) & (moves > MOVES))
    if len(dead):
        joint = int(dead[0])
        what = f"i{joint + 1} never changes, though joint {joint + 1} moves by {moves[joint]:.3g}"
        raise InputError(what, path_of(train[0]), "check the channel, or which column [log] of the card takes for it")
    for one in known[1:]:
        both = one.moves & known[0].moves & (one.rms > 0.0) & (known[0].rms > 0.0)
        if not both.any():
            continue
        ratio = float(np.median(one.rms[both] / known[0].rms[both]))
        if not 1.0 / FACTOR < ratio < FACTOR:
            what = f"currents are {ratio:.2g} times those of {path_of(known[0].source)}"
            raise InputError(what, path_of(one.source), "give all logs in one unit")


def path_of(source: LogSource) -> str:
    """Return the file of a log, or the name of one that is of no file.

    Args:
        source: the log.
    """
    inner: object = source
    while not hasattr(inner, "path") and hasattr(inner, "source"):
        inner = inner.source  # of a view of it
    return str(getattr(inner, "path", source.name))


def set_warnings(train: Sequence[LogSource], test: Sequence[LogSource]) -> list[str]:
    """Name logs whose time stamps jitter, and those that are given twice.

    Args:
        train: logs that are learnt from.
        test: logs that are predicted.
    """
    known = [facts_of(source) for source in (*train, *test)]
    found = []
    for one in known:
        if one.uneven > MANY:
            low, usual, high = (1e3 * step for step in one.steps)
            found.append(
                f"{path_of(one.source)}: {100 * one.uneven:.0f} % of its time steps are not about their median of "
                f"{usual:.3g} ms ({low:.3g} to {high:.3g} ms): velocities are derived from stamps, and what jitters "
                "there looks like a delay, a filter or a touch. Log the time of sampling, not that of arrival."
            )
    for k, one in enumerate(known):
        twin = next((other for other in known[:k] if one.same_as(other)), None)
        if twin is not None:
            tells = k >= len(train)
            why = "its errors say nothing of other logs" if tells else "what it says counts twice"
            found.append(f"{path_of(one.source)} is the same log as {path_of(twin.source)}: {why}.")
    return found
