"""How the sign of velocity turns in detail: what no effect may be named for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Term
from ident.effects.friction import Coulomb
from ident.gap.panel import Panel

EDGE, WIDEST = 4.0, 0.012
"""How much narrower and wider the sign of velocity may turn than the model says, and how wide at most [rad/s]."""


def edge_columns(panel: Panel, own: Sequence[Term], joint: int) -> FloatArray:
    """Columns (N, 3), or none, by which a joint's sign of velocity may turn otherwise than modelled."""
    for term in own:
        if isinstance(term.effect, Coulomb):
            v, width = panel.velocity[:, joint], term.effect.smoothing
            sign = np.tanh(v / width)
            bends = [v / np.sqrt(v**2 + width**2), np.tanh(EDGE * v / width), np.tanh(v / min(EDGE * width, WIDEST))]
            return np.stack([bend - sign for bend in bends], axis=1)
    return np.zeros((len(panel), 0))
