"""How the direction of friction turns in detail: what no effect may be named for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Term
from ident.effects.friction import Coulomb
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.gap.problem import gain
from ident.gap.search import GAIN

EDGE, WIDEST, WIDER = 4.0, 0.012, 1.2
"""How much narrower and wider the sign of velocity may turn than the model says, how wide at most [rad/s] and how much
wider at least."""

LONGER = 2.0
"""How much shorter and longer the displacement may be over which friction builds up."""

MOST = 3.0
"""Times the model's dry friction that turns otherwise at most: more of it is no edge but an effect."""


def edge_columns(panel: Panel, own: Sequence[Term], joint: int) -> FloatArray:
    """Columns (N, 3), or none, by which a joint's direction may turn otherwise than modelled."""
    for term in own:
        if isinstance(term.effect, Coulomb) and term.effect.joint == joint:
            v, width = panel.velocity[:, joint], term.effect.smoothing
            sign = panel.columns(term.effect, term.shape, joint)[:, 0]
            if term.effect.presliding > 0.0:
                lengths = (term.effect.presliding / LONGER, term.effect.presliding * LONGER)
                others = (replace(term.effect, presliding=length) for length in lengths)
                bends = [np.tanh(v / width), *(panel.columns(other, term.shape, joint)[:, 0] for other in others)]
            else:
                rounder, wider = (
                    v / np.sqrt(v**2 + width**2),
                    np.tanh(v / min(EDGE * width, max(WIDEST, WIDER * width))),
                )
                bends = [rounder, np.tanh(EDGE * v / width), wider]
            return np.stack([bend - sign for bend in bends], axis=1)
    return np.zeros((len(panel), 0))


def with_less_edge(panel: Panel, gap: JointGap, terms: Sequence[Term]) -> JointGap | None:
    """A joint's rows with no more at the edge than its dry friction could bring; None where that makes no difference.

    Friction that turns slowly looks like more of it in motion that reverses quickly.
    """
    if not gap.nuisance:
        return None
    bare = gap.bare()
    edges = _slight(panel, bare, gap.matrix[:, -gap.nuisance :], terms)
    if edges.shape[1] == gap.nuisance:
        return None
    sharp = replace(bare, matrix=np.hstack([bare.matrix, edges]), nuisance=edges.shape[1])
    left, rest = sharp.problem(panel).residual, gap.problem(panel).residual
    return sharp if gain(float(left @ left), float(rest @ rest)) > GAIN else None


def with_slight_edge(panel: Panel, gap: JointGap, terms: Sequence[Term]) -> JointGap:
    """The rows of a joint that sticks, of whose edge no more is left than its dry friction could bring."""
    return gap if gap.edge is None else replace(gap, edge=_slight(panel, gap, gap.edge, terms))


def _slight(panel: Panel, gap: JointGap, edges: FloatArray, terms: Sequence[Term]) -> FloatArray:
    """Columns (N, k) of the edge but for those that would take up too much dry friction, the largest first."""
    dry = [t for t in terms if isinstance(t.effect, Coulomb) and t.effect.joint == gap.joint]
    problem, most = gap.problem(panel), MOST * sum(abs(float(t.coefficients[0])) for t in dry)
    while dry and edges.shape[1] > 0:
        sizes = np.abs(problem.beyond(problem.of(edges)).coefficients)
        if sizes.max() <= most:
            break
        edges = np.delete(edges, int(np.argmax(sizes)), axis=1)
    return edges
