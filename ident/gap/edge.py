"""How the sign of velocity turns in detail: what no effect may be named for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Term
from ident.effects.friction import Coulomb
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem

EDGE, WIDEST = 4.0, 0.012
"""How much narrower and wider the sign of velocity may turn than the model says, and how wide at most [rad/s]."""

MOST = 2.0
"""Times the model's dry friction that turns otherwise at most: more of it is no edge but an effect."""


def edge_columns(panel: Panel, own: Sequence[Term], joint: int, matrix: FloatArray, target: FloatArray) -> FloatArray:
    """Columns (N, k), three at most, by which a joint's sign of velocity may turn otherwise than modelled.

    Args:
        panel: the rows.
        own: the model's terms on the joint.
        joint: the joint, from 0.
        matrix: columns (N, p) that are fitted whatever else is.
        target: what they are fitted to (N,).
    """
    for term in own:
        if isinstance(term.effect, Coulomb):
            v, width = panel.velocity[:, joint], term.effect.smoothing
            sign = np.tanh(v / width)
            bends = [v / np.sqrt(v**2 + width**2), np.tanh(EDGE * v / width), np.tanh(v / min(EDGE * width, WIDEST))]
            columns = np.stack([bend - sign for bend in bends], axis=1)
            problem = JointProblem(matrix, target, panel.fold, np.ones(len(panel), dtype=bool))
            return moderate(problem, columns, MOST * abs(float(term.coefficients[0])))
    return np.zeros((len(panel), 0))


def moderate(problem: JointProblem, columns: FloatArray, most: float) -> FloatArray:
    """Leave out columns (N, k) whose fitted coefficients are larger than allowed, the largest first."""
    while columns.shape[1] > 0:
        sizes = np.abs(problem.fit(columns)[problem.matrix.shape[1] :])
        if sizes.max() <= most:
            break
        columns = np.delete(columns, int(np.argmax(sizes)), axis=1)
    return columns
