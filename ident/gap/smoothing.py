"""Over which speed the sign of velocity turns: dry friction predicts best where it turns as the logs ask for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import BoolArray
from ident.effects.friction import Coulomb, VelocityEffect
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.gap.rests import Rests
from ident.gap.rows import panel_of
from ident.log import LogSource
from ident.model import CurrentModel

SMOOTHINGS = np.geomspace(3e-4, 1e-2, 12)
"""Speeds [rad/s or m/s] over which the sign of velocity may turn; beyond, it is an effect of its own (sigmoid)."""

TOLD = 0.05
"""Share by which a joint's mean squared error in motion must be larger with another smoothing for motion to tell."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A model whose signs of velocity turn as the logs ask for, and its held-out error over all joints' rows.

    The error is the sum over joints of the logarithm of its mean square.
    """

    model: CurrentModel
    error: float
    rows: int


def smoothed(model: CurrentModel, sources: Sequence[LogSource], rests: Rests) -> Smoothed:
    """Let a model's signs of velocity turn over the speeds that predict logs best; nothing else is fitted again.

    Args:
        model: the model.
        sources: the logs.
        rests: which joints' rests are left out.
    """
    panel = panel_of(model, sources)
    counts = panel.gather(rests.counts)
    # What follows turns does not even tell how the sign turns of a joint that yields there.
    telling = counts | ~rests.yields
    found = [_smoothing(model, panel, counts[:, j], telling[:, j], j) for j in range(model.n)]
    smoothing = [width for width, _ in found]
    terms = tuple(
        replace(term, effect=replace(term.effect, smoothing=smoothing[term.effect.at]))
        if isinstance(term.effect, VelocityEffect)
        else term
        for term in model.terms
    )
    return Smoothed(replace(model, terms=terms), float(np.sum(np.log([error for _, error in found]))), len(panel))


def _smoothing(
    model: CurrentModel, panel: Panel, counts: BoolArray, telling: BoolArray, joint: int
) -> tuple[float, float]:
    """The smoothing that predicts best, fitted to the rows that count, and their held-out error with it.

    Of those between which these rows do not decide, the one that predicts all telling ones best: rests that do not
    count still tell how well the sign is predicted as the joint creeps, but what is held there is no friction.
    """
    own = [t for t in model.terms if t.effect.acts_on in (None, joint)]
    friction = next((t.effect for t in own if isinstance(t.effect, Coulomb)), None)
    others = [panel.columns(t.effect, t.shape, joint) for t in own if not isinstance(t.effect, Coulomb)]
    rows = JointGap(joint, np.hstack(others), panel.force[:, joint], counts, ())
    tried = [(float(SMOOTHINGS[0]), rows)]
    if friction is not None:
        laws = [(width, replace(friction, smoothing=width)) for width in SMOOTHINGS.tolist()]
        columns = [(width, panel.columns(law, np.zeros(0), joint)) for width, law in laws]
        tried = [(width, replace(rows, matrix=np.hstack([rows.matrix, c]))) for width, c in columns]
    problems = [one.problem(panel) for _, one in tried]
    moving = np.array([float(problem.residual @ problem.residual) for problem in problems])
    likely = np.flatnonzero(moving <= (1.0 + TOLD) * moving.min()).tolist()
    best = min(likely, key=lambda k: float(np.sum(tried[k][1].everywhere(panel)[telling] ** 2)))
    return tried[best][0], max(problems[best].errors().total / len(problems[best]), 1e-300)
