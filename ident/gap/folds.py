"""Which rows are predicted from which: folds are logs, or parts of logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.walk import Block

FOLDS = 4

FASTER = 2.0
"""A log in which a joint moves so many times as fast as in all logs of other folds is cut into parts of every fold:
predicted from those, it would ask what friction does at speeds that they never saw."""

FARTHER = 1.5
"""The same, of one joint's rows, for a fold with so many times the range of positions of all others."""

ENDS = (0.005, 0.995)
"""Quantiles of positions, and of speeds, that count as their ends."""

FAST = 99.0
"""Percentile of a joint's speed in a log that counts as its speed."""


def log_numbers(blocks: Sequence[Block], rows: Sequence[IntArray]) -> IntArray:
    """Number of the log, in order of appearance, that each row looked at of blocks is of."""
    names = [block.log.name for block in blocks]
    order = list(dict.fromkeys(names))
    return np.repeat([order.index(name) for name in names], [len(looked_at) for looked_at in rows])


def folds_of(blocks: Sequence[Block], rows: Sequence[IntArray]) -> IntArray:
    """Number of the fold of each row: logs dealt out, or cut into parts where they are few or one is by far faster."""
    names = list(dict.fromkeys(block.log.name for block in blocks))
    logs = [[k for k, block in enumerate(blocks) if block.log.name == name] for name in names]
    parts = np.full(len(names), -(-FOLDS // len(names)))
    parts[_faster(blocks, rows, logs)] = FOLDS
    log = log_numbers(blocks, rows)
    return _dealt(log, np.ones(len(log), dtype=bool), parts)


def even_folds(log: IntArray, keep: BoolArray, parts: int = 1) -> IntArray:
    """Number of the fold of each row, every log being cut into parts of each by those of its rows that count.

    Args:
        log: number of the log (N,) that each row is of.
        keep: rows (N,) that count.
        parts: of each fold in each log.
    """
    return _dealt(log, keep, np.full(log.max(initial=-1) + 1, parts * FOLDS))


def goes_beyond(fold: IntArray, position: FloatArray, velocity: FloatArray) -> bool:
    """Whether a joint moves far beyond all other folds in one, to other positions (N,) or faster (N,)."""

    def reach(rows: BoolArray) -> FloatArray:
        least, most = np.quantile(position[rows], ENDS)
        return np.array([most - least, np.quantile(np.abs(velocity[rows]), ENDS[1])])

    others = [reach(rows) for k in range(FOLDS) if (rows := fold != k).any()]
    return bool(np.any(reach(fold >= 0) > np.min(others, axis=0) * [FARTHER, FASTER]))


def _dealt(log: IntArray, keep: BoolArray, parts: IntArray) -> IntArray:
    """Cut logs into so many parts each, of as many rows that count, and deal those out to folds."""
    fold = np.zeros(len(log), dtype=np.int64)
    for number, count in enumerate(parts.tolist()):
        own = np.flatnonzero(log == number)
        before: IntArray = np.cumsum(keep[own]) - keep[own]
        part = np.minimum(before * count // max(int(keep[own].sum()), 1), count - 1)
        fold[own] = (number * count + part) % FOLDS
    return fold


def _faster(blocks: Sequence[Block], rows: Sequence[IntArray], logs: Sequence[Sequence[int]]) -> list[int]:
    """Numbers of the logs, of as many as folds at least, that move a joint much faster than all logs of other folds."""
    if len(logs) < FOLDS:
        return []
    speeds = np.array([
        np.percentile(np.abs(np.concatenate([blocks[k].motion.dq[rows[k]] for k in own])), FAST, axis=0)
        for own in logs
        if sum(len(rows[k]) for k in own)
    ])  # fmt: skip
    if len(speeds) < len(logs):
        return []
    fold = np.arange(len(logs)) % FOLDS
    return [k for k in range(len(logs)) if np.any(speeds[k] > FASTER * speeds[fold != fold[k]].max(axis=0))]
