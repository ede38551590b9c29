"""How the direction of dry friction turns: over the speed or displacement with which it predicts logs best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.effects.friction import Coulomb
from ident.effects.friction_curve import SLOWEST_SIGMOID
from ident.gap.panel import Panel
from ident.gap.presliding import DryFriction, with_directions
from ident.gap.problem import JointProblem
from ident.gap.rests import Rests
from ident.gap.rows import gap_of, panel_of
from ident.gap.threads import in_threads
from ident.log import LogSource
from ident.model import CurrentModel
from ident.walk import Block, kept_rows

SMOOTHINGS = np.geomspace(3e-4, 2.0 * SLOWEST_SIGMOID, 15)
"""Speeds [rad/s or m/s] over which the sign of velocity may turn; beyond, it is an effect of its own (sigmoid)."""

SHARPER = np.geomspace(3e-6, SMOOTHINGS[0], 6, endpoint=False)
"""Those tried where none of them is sharp enough, as of slides that move by millimetres a second."""

TOLD = 0.05
"""Share by which a joint's mean squared error in motion must be larger with another smoothing for motion to tell."""

GROWS = np.array([2.0, 5.0, 14.0])
"""Times the slowest of them over which friction that grows with the speed does so."""

FAR_MORE = 0.15
"""Share of the squared residual that such friction beside a sharper sign must tell, and a sign sharper than those."""

MOST_ROWS = 0.9
"""Share of the rows that must be left without logs' ends."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A model whose directions of friction turn as the logs ask for, and its held-out error over all joints' rows.

    The error is the sum over joints of the logarithm of its mean square.
    """

    model: CurrentModel
    error: float
    rows: int


def smoothed(model: CurrentModel, sources: Sequence[LogSource], rests: Rests, ends: float) -> Smoothed:
    """Let a model's directions turn as predicts logs best; nothing else is fitted again.

    Args:
        model: the model.
        sources: the logs.
        rests: which joints' rests are left out.
        ends: seconds at the ends of logs that are left out, unless they would leave too few rows.
    """
    panel = panel_of(model, sources)
    counts = panel.gather(rests.counts)
    inside = panel.gather(lambda block: _inside(block, ends))
    if inside.mean() > MOST_ROWS:
        counts &= inside[:, None]
    found = in_threads(lambda j: _turning(model, panel, counts[:, j], j), range(model.n))
    turned = with_directions(model, {j: friction for j, (friction, _) in enumerate(found)})
    return Smoothed(turned, float(np.sum(np.log([error for _, error in found]))), kept_rows(panel.blocks))


def _inside(block: Block, ends: float) -> BoolArray:
    """Rows (N,) of a block that are so many seconds from its ends."""
    t = block.motion.t
    return np.asarray((t >= t[0] + ends) & (t <= t[-1] - ends))


def _turning(model: CurrentModel, panel: Panel, counts: BoolArray, joint: int) -> tuple[Coulomb | None, float]:
    """The dry friction that predicts best, fitted to the rows that count, and their held-out error with it.

    A sign that turns slowly is what a sharp one looks like that lacks friction which grows with the speed: where that
    tells far more, and beside it motion tells a sharper sign from the slow one, it is the sharper one.
    """
    dry = DryFriction.of(model, panel, joint)
    if dry is None:
        return None, _mean_error(gap_of(model, panel, joint).bare().without(~counts).problem(panel))
    turns = dry.law.presliding == 0.0
    laws, columns = _turned(dry, SMOOTHINGS if turns else np.array([dry.law.smoothing]))
    best, left = _best(dry, counts, columns)
    if turns and best == 0:
        finer, of_finer = _turned(dry, SHARPER)
        sharp, rest = _best(dry, counts, of_finer)
        if rest.min() < (1.0 - FAR_MORE) * left.min():
            laws, best = finer, sharp
    elif best > 0:
        grows = np.tanh(panel.velocity[:, joint, None] / (GROWS * SMOOTHINGS[-1]))
        beside = replace(dry, others=np.hstack([dry.others, grows]))
        sharp, rest = _best(beside, counts, columns)
        told = rest[best] > (1.0 + TOLD) * rest.min()
        if sharp < best and told and rest.min() < (1.0 - FAR_MORE) * left.min():
            dry, best = beside, sharp
    law = laws[best]
    return law, _mean_error(dry.rows(counts, law).problem(panel))


def _turned(dry: DryFriction, widths: FloatArray) -> tuple[list[Coulomb], list[FloatArray]]:
    """The law turning over each of some speeds, and its columns."""
    laws = [replace(dry.law, smoothing=width) for width in widths.tolist()]
    return laws, [dry.columns(law) for law in laws]


def _best(dry: DryFriction, counts: BoolArray, columns: Sequence[FloatArray]) -> tuple[int, FloatArray]:
    """Which of the laws of these columns predicts best, and what each of them leaves of the rows that count.

    Of those between which the rows that count do not decide, the one that predicts all best: rests that do not count
    still tell how well the sign is predicted as the joint creeps, but what is held there is no friction.
    """
    problem = dry.rows(counts).problem(dry.panel)
    left = float(problem.residual @ problem.residual)
    moving = np.array([left - problem.drop(problem.of(own)) for own in columns])
    likely = np.flatnonzero(moving <= (1.0 + TOLD) * moving.min()).tolist()
    best = min(likely, key=lambda k: float(np.sum(dry.left(problem, columns[k]) ** 2)))
    return best, moving


def _mean_error(problem: JointProblem) -> float:
    return max(problem.errors().total / len(problem), 1e-300)
