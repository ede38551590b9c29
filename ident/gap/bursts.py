"""Step 7, abstain: a residual that comes in bursts, whatever they follow."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.gap.moving_average import moving_average

WINDOW = 0.1
"""Seconds over which squares are averaged; gears ring for as long after a knock."""

USUAL, TIMES = 0.8, 10.0
"""Quantile of averaged squares that is usual, and how many times that bursts have: of noise no window has it."""

RARE = 0.1
"""Share of the rows that bursts fill at most; what is there more often is a kind of motion."""


def bursts(squares: FloatArray, starts: IntArray, step: float) -> float:
    """Share of a squared residual by which it is larger in rare bursts than usual; nought without any.

    Args:
        squares: of what is left in the rows (N,).
        starts: numbers of the rows with which each stretch begins.
        step: seconds from row to row.
    """
    power = moving_average(squares, starts, max(1, round(WINDOW / step)))
    usual = float(np.quantile(power, USUAL))
    there = power > TIMES * usual
    if usual <= 0.0 or not there.any() or there.mean() > RARE:
        return 0.0
    return float(np.sum(squares[there] - usual) / max(float(squares.sum()), 1e-300))
