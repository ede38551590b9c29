"""Step 2, localise: in which joint and which regime of motion the gap is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.effects.survey import Survey
from ident.gap.panel import Panel

REGIMES = (
    "rest",
    "breakaway",
    "reversal",
    "slow",
    "medium",
    "fast",
    "accelerating",
    "lifting",
    "lowering",
    "early",
    "late",
)
REVERSAL = 0.05
"""Seconds before and after a change of direction that are reversal."""

RESAMPLES, BLOCKS = 200, 40
"""Draws of the bootstrap, and stretches that are drawn: residuals are alike over less than a fortieth of the rows."""


@dataclass(frozen=True, eq=False)
class GapMap:
    """RMS residual of each joint in each regime, (n, regimes), with the ends of its 95 % block-bootstrap interval.

    NaN where a regime has too few rows. ``share`` is that of the joint's squared residual that lies in the regime.
    """

    regimes: tuple[str, ...]
    rms: FloatArray
    low: FloatArray
    high: FloatArray
    share: FloatArray


def regimes_of(panel: Panel, survey: Survey, joint: int) -> dict[str, BoolArray]:
    """Which rows (N,) belong to each regime of a joint's motion; a row may belong to several."""
    dq = panel.velocity[:, joint]
    ddq = panel.motors.ddq[:, joint]
    load = panel.seen("load")[:, joint]
    t = panel.motion.t
    speed, still = np.abs(dq), 2.0 * survey.smoothing[joint]
    usual = max(float(np.quantile(speed, 0.95)), 10.0 * still)
    soon = panel.turns(np.sign(dq), REVERSAL)
    moving = speed >= still
    return {
        "rest": ~moving & ~soon,
        "breakaway": moving & (speed < 6.0 * still),
        "reversal": soon & moving,
        "slow": moving & (speed < 0.25 * usual),
        "medium": (speed >= 0.25 * usual) & (speed < 0.65 * usual),
        "fast": speed >= 0.65 * usual,
        "accelerating": np.abs(ddq) > np.quantile(np.abs(ddq), 0.8),
        "lifting": moving & (load * dq > 0),
        "lowering": moving & (load * dq < 0),
        "early": t <= np.quantile(t, 0.25),
        "late": t >= np.quantile(t, 0.75),
    }


def gap_map(panel: Panel, survey: Survey, residuals: FloatArray, seed: int = 0) -> GapMap:
    """Map the residuals (N, n; NaN in rows that are left out) by joint and regime."""
    n = residuals.shape[1]
    rms, low, high, share = (np.full((n, len(REGIMES)), np.nan) for _ in range(4))
    rng = np.random.default_rng(seed)
    block = np.arange(len(panel)) * BLOCKS // max(len(panel), 1)
    draws = np.stack([np.bincount(rng.integers(0, BLOCKS, BLOCKS), minlength=BLOCKS) for _ in range(RESAMPLES)])
    for j in range(n):
        square = residuals[:, j] ** 2
        known = np.isfinite(square)
        for k, regime in enumerate(regimes_of(panel, survey, j).values()):
            rows = regime & known
            if rows.sum() < 30:
                continue
            sums = np.bincount(block[rows], square[rows], BLOCKS)
            counts = np.bincount(block[rows], minlength=BLOCKS)
            rms[j, k] = np.sqrt(sums.sum() / counts.sum())
            drawn = np.sqrt((draws @ sums) / np.maximum(draws @ counts, 1))
            low[j, k], high[j, k] = np.quantile(drawn, [0.025, 0.975])
            share[j, k] = sums.sum() / max(square[known].sum(), 1e-300)
    return GapMap(REGIMES, rms, low, high, share)
