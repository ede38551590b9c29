"""Rows in which a joint stands, or has hardly moved since it turned round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation, maximum_filter1d, minimum_filter1d

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.coupling import Coupling
from ident.walk import Block

SMEARED, DIP = 4.0, 0.25
"""A stop may be smeared to so many times that speed, where it is this share of the speeds before and after it."""

EARLY = 0.2
"""Share of a displacement after a turn that goes with it before the turn."""


def of_motors(block: Block, coupling: Coupling | None) -> Block:
    """A block with the motion of the motors, after which friction goes."""
    return block if coupling is None else replace(block, motion=coupling.motors(block.motion))


def stands(block: Block, speed: FloatArray, around: float) -> BoolArray:
    """Rows (N, n) of a block in which, or within seconds of which, each joint is slower than a speed (n,) or turns.

    So are those of a stop so short that the derivatives' filter smears it.
    """
    velocity, pace = block.motion.dq, np.abs(block.motion.dq)
    # A quick turn has no sample as slow as that.
    turns = (velocity[1:] * velocity[:-1] < 0.0) & (speed > 0.0)
    if len(pace) < 2:
        return pace < speed
    rows = max(1, round(around * block.log.rate))
    slow = (pace < speed) | ((pace < SMEARED * speed) & _dips(pace, rows))
    slow[1:] |= turns
    slow[:-1] |= turns
    if not slow.any():
        return slow
    return np.asarray(binary_dilation(slow, np.ones((2 * rows + 1, 1), dtype=bool)), dtype=bool)


def _dips(pace: FloatArray, rows: int) -> BoolArray:
    """Rows (N, n) at which speeds are least among so many rows on either side, and far less than on both."""
    known, half = np.nan_to_num(pace), (rows + 1) // 2
    before, after = (maximum_filter1d(known, 2 * half + 1, axis=0, mode="nearest", origin=o) for o in (half, -half))
    least = minimum_filter1d(known, 2 * rows + 1, axis=0, mode="nearest")
    return np.asarray((known <= least) & (known < DIP * np.minimum(before, after)), dtype=bool)


def hardly_moved(block: Block, within: FloatArray) -> BoolArray:
    """Rows (N, n) of a block in which each joint has moved by less than this (n,) since it turned round or began.

    So are the last before it turns: smoothed velocities may turn too early.
    """
    q, velocity = block.motion.q, block.motion.dq
    rows = np.arange(len(q))[:, None]
    turned = np.zeros(q.shape, dtype=bool)
    turned[:1] = block.first
    turned[1:] = velocity[1:] * velocity[:-1] < 0.0
    last = np.maximum.accumulate(np.where(turned, rows, -1), axis=0)
    coming = np.minimum.accumulate(np.where(turned, rows, len(q))[::-1], axis=0)[::-1]

    def from_there(turn: IntArray) -> FloatArray:
        there = np.take_along_axis(q, np.clip(turn, 0, len(q) - 1), axis=0)
        return np.where((turn >= 0) & (turn < len(q)), np.abs(q - there), np.inf)

    return np.asarray((from_there(last) < within) | (from_there(coming) < EARLY * within), dtype=bool)
