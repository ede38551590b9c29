"""Which rows are predicted from which: folds are logs, or parts of logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import BoolArray, IntArray
from ident.walk import Block

FOLDS = 4

FASTER = 2.0
"""A log in which a joint moves so many times as fast as in all logs of other folds is cut into parts of every fold:
predicted from those, it would ask what friction does at speeds that they never saw."""

FAST = 99.0
"""Percentile of a joint's speed in a log that counts as its speed."""


def folds_of(blocks: Sequence[Block], rows: Sequence[IntArray]) -> IntArray:
    """Number of the fold of each row: logs dealt out, or cut into parts where they are few or one is by far faster."""
    names = list(dict.fromkeys(block.log.name for block in blocks))
    logs = [[k for k, block in enumerate(blocks) if block.log.name == name] for name in names]
    parts = np.full(len(names), -(-FOLDS // len(names)))
    parts[_faster(blocks, rows, logs)] = FOLDS
    fold = [np.empty(0, dtype=np.int64)] * len(blocks)
    for number, own in enumerate(logs):
        total, seen = sum(len(rows[k]) for k in own), 0
        for k in own:
            order = seen + np.arange(len(rows[k]))
            fold[k] = (number * parts[number] + order * parts[number] // max(total, 1)) % FOLDS
            seen += len(rows[k])
    return np.concatenate(fold)


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


def even_folds(log: IntArray, keep: BoolArray) -> IntArray:
    """Number of the fold of each row, every log being cut into a part of each by those of its rows that count.

    Args:
        log: number of the log (N,) that each row is of.
        keep: rows (N,) that count.
    """
    fold = np.zeros(len(log), dtype=np.int64)
    for number in np.unique(log):
        own = np.flatnonzero(log == number)
        before: IntArray = np.cumsum(keep[own]) - keep[own]
        fold[own] = before * FOLDS // max(int(keep[own].sum()), 1)
    return np.minimum(fold, FOLDS - 1)
