"""Walking a log in blocks, with derivatives, in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.log import JointLog, LogSource, concatenate
from ident.signals import Motion, derive, late

ROWS = 16384
"""Rows a block: the link regressor of a 7-axis arm then takes 64 MB."""

SEARCH_ROWS = 60_000
"""Rows that ``collect`` aims at: shape parameters and structure settle long before the linear parameters do."""

MARGIN_PERIODS = 6.0
"""Periods of the cut-off kept on either side of a block, after which a zero-phase filter has forgotten its ends."""

EDGE_PERIODS = 0.5
"""Periods of the cut-off at a segment's ends in which a zero-phase filter still leans on its padding."""


@dataclass(frozen=True)
class Block:
    """Contiguous rows of one segment of a log.

    Attributes:
        log: the rows as logged.
        motion: their motion.
        first: whether a segment starts here, so that effects with memory start anew.
        keep: rows to learn from, (N,): those with derivatives that are not late, away from the segment's ends.
    """

    log: JointLog
    motion: Motion
    first: bool
    keep: BoolArray

    @property
    def removed(self) -> FloatArray:
        """What the filter took from the positions, (N, n)."""
        return self.log.q - self.motion.q


def walk(source: LogSource, cutoff: float, rows: int = ROWS) -> Iterator[Block]:
    """Yield a log block by block with zero-phase derivatives at the cut-off [Hz].

    Blocks overlap while they are filtered, so their derivatives are those of the whole segment (to the filter's
    forgetting, below 1e-9 of the signal).
    """
    for segment_blocks in _segments(source, rows):
        yield from _walk_segment(segment_blocks, cutoff)


def collect(sources: Iterable[LogSource], cutoff: float, limit: int = SEARCH_ROWS) -> list[Block]:
    """Hold the logs' rows in memory, segment by segment, or evenly spread stretches where they exceed the limit.

    Effects with memory start anew in every block; the first tenth of one that does not begin a segment is not kept.
    """
    held: list[Block] = []
    every, seen = 1, 0
    for source in sources:
        for block in walk(source, cutoff):
            seen += 1
            if (seen - 1) % every:
                continue
            held.append(block)
            if sum(len(b.keep) for b in held) > 2 * limit:
                held, every = held[::2], every * 2
    begun = _whole(held) if every == 1 else [block if block.first else _begun(block) for block in held]
    return [block for block in begun if block.keep.any()]


def kept_rows(blocks: Iterable[Block]) -> int:
    """Number of rows to learn from."""
    return sum(int(block.keep.sum()) for block in blocks)


def slowest_rate(blocks: Iterable[Block]) -> float:
    """Lowest sampling rate [Hz] of the logs that blocks are of."""
    return min(block.log.rate for block in blocks)


def _whole(blocks: Sequence[Block]) -> list[Block]:
    """Join blocks that follow one another to segments, in which memories last."""
    runs: list[list[Block]] = []
    for block in blocks:
        if block.first:
            runs.append([])
        runs[-1].append(block)
    return [run[0] if len(run) == 1 else _one(run) for run in runs]


def _one(run: Sequence[Block]) -> Block:
    parts = [block.motion for block in run]
    motion = Motion(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "q", "dq", "ddq")))
    return Block(_join([block.log for block in run]), motion, True, np.concatenate([block.keep for block in run]))


def _begun(block: Block) -> Block:
    """A block that does not begin a segment, as one that does: its first tenth tells memories where they are."""
    keep = block.keep.copy()
    keep[: len(keep) // 10] = False
    return replace(block, first=True, keep=keep)


def thin(blocks: Sequence[Block], limit: int) -> list[Block]:
    """Keep every k-th row of blocks, so that no more than ``limit`` rows are kept.

    Neighbouring rows of a robot's residual say nearly the same, so a search loses little by it; memories still see
    every row.
    """
    every = -(-kept_rows(blocks) // limit)
    if every < 2:
        return list(blocks)
    return [replace(block, keep=block.keep & (np.arange(len(block.keep)) % every == 0)) for block in blocks]


def _segments(source: LogSource, rows: int) -> Iterator[Iterator[tuple[JointLog, bool]]]:
    """Group a log's blocks by segment; each block comes with whether it is the segment's last."""
    blocks = source.blocks(rows)
    ahead = next(blocks, None)

    def one_segment() -> Iterator[tuple[JointLog, bool]]:
        nonlocal ahead
        while ahead is not None:
            block, ahead = ahead, next(blocks, None)
            last = ahead is None or ahead.segment[0] != block.segment[-1]
            yield block, last
            if last:
                return

    while ahead is not None:
        yield one_segment()


def _walk_segment(blocks: Iterator[tuple[JointLog, bool]], cutoff: float) -> Iterator[Block]:
    """Filter each block together with a margin of the rows before and after it."""
    window: JointLog | None = None
    begun = 0  # rows of the window that have been given out
    first = True
    for block, last in blocks:
        window = block if window is None else _join([window, block])
        # A single row has no rate: it waits for more, or is a segment of its own.
        margin = math.ceil(MARGIN_PERIODS * window.rate / cutoff) if len(window) > 1 else 1
        end = len(window) if last else len(window) - margin
        if end <= begun:
            continue
        motion = derive(window, cutoff) if len(window) > 1 else _unknown(window)
        rows = slice(begun, end)
        keep = np.isfinite(motion.ddq).all(axis=1) & _settled(window, cutoff, first, last) & ~late(window)
        yield Block(window[rows], motion[rows], first, keep[rows])
        first = False
        start = max(0, end - margin)
        window, begun = window[start:], end - start


def _unknown(row: JointLog) -> Motion:
    """Motion of a row of which nothing is known but where it is."""
    nothing = np.full(row.q.shape, np.nan)
    return Motion(row.t, row.q, nothing, nothing)


def _settled(window: JointLog, cutoff: float, first: bool, last: bool) -> BoolArray:
    edge = EDGE_PERIODS / cutoff
    settled = np.ones(len(window), dtype=bool)
    if first:
        settled &= window.t >= window.t[0] + edge
    if last:
        settled &= window.t <= window.t[-1] - edge
    return settled


def _join(logs: Sequence[JointLog]) -> JointLog:
    """Rows of one segment that follow one another."""
    joined = concatenate(list(logs), logs[0].name)
    return joined.replace(segment=np.full(len(joined), logs[0].segment[0]))
