"""Motion asked of a robot, in blocks: what protocols hand to the virtual robot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from comparisons.virtual_robot.contact import Push
from ident.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class ReferenceBlock:
    """Consecutive rows of a commanded motion.

    Attributes:
        q: commanded positions [rad, prismatic m] at the protocol's rate, (N, n).
        segment: the segment they belong to; a new number starts at rest at its first row.
        pushes: all pushes of that segment, their times counted from its first row.
    """

    q: FloatArray
    segment: int = 0
    pushes: tuple[Push, ...] = ()


@dataclass(frozen=True)
class Protocol:
    """A motion protocol: name, sampling rate [Hz], exact number of rows, and a fresh walk through its blocks.

    Attributes:
        name: of the protocol.
        rate: samples a second [Hz].
        frames: rows in all.
        blocks: called for a fresh walk.
    """

    name: str
    rate: float
    frames: int
    blocks: Callable[[], Iterator[ReferenceBlock]]


def in_blocks(
    q: FloatArray, segment: int = 0, pushes: tuple[Push, ...] = (), rows: int = 4096
) -> Iterator[ReferenceBlock]:
    """Yield positions (N, n) of one segment in blocks of at most ``rows`` rows.

    Args:
        q: commanded positions, (N, n).
        segment: their number.
        pushes: of the segment.
        rows: in a block, at most.
    """
    for start in range(0, len(q), rows):
        yield ReferenceBlock(q[start : start + rows], segment, pushes)


def reblocked(blocks: Iterable[ReferenceBlock], rows: int) -> Iterator[ReferenceBlock]:
    """Yield the same motion in blocks of exactly ``rows`` rows, except for the last of each segment.

    Args:
        blocks: of a motion, of any length.
        rows: in a block.
    """
    held: list[FloatArray] = []
    last: ReferenceBlock | None = None

    def drain(everything: bool) -> Iterator[ReferenceBlock]:
        nonlocal held
        if last is None:
            return
        q = np.concatenate(held) if held else last.q[:0]
        whole = len(q) if everything else len(q) // rows * rows
        yield from in_blocks(q[:whole], last.segment, last.pushes, rows)
        held = [q[whole:]]

    for block in blocks:
        if last is not None and block.segment != last.segment:
            yield from drain(everything=True)
            held = []
        last = block
        held.append(block.q)
        yield from drain(everything=False)
    yield from drain(everything=True)
