"""Noise of the positions, or of velocities as logged, by what the derivatives' filter takes away of them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from ident.arrays import FloatArray
from ident.model import CurrentModel
from ident.walk import Block

AROUND = 0.25
"""Seconds around a row over which noise is told: counts that stand still make none at rest."""


def velocities_used(model: CurrentModel, block: Block) -> FloatArray | None:
    """Velocities (N, n) as logged; None where there are none, or the model takes them from the positions."""
    return None if model.positions_only else block.log.dq


def removed_square(model: CurrentModel, block: Block) -> FloatArray:
    """Mean square (N, n), around each row, of what the filter takes of these velocities or else of the positions."""
    logged = velocities_used(model, block)
    return around_square(block, block.removed if logged is None else logged - block.motion.dq)


def around_square(block: Block, removed: FloatArray) -> FloatArray:
    """Mean square (N, n), around each row, of what the filter takes (N, n)."""
    around = max(3, round(AROUND * block.log.rate))
    square = uniform_filter1d(np.nan_to_num(removed) ** 2, around, axis=0, mode="nearest")
    return np.asarray(np.maximum(square, 0.0))
