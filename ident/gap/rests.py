"""Rests of joints that stick: while a joint stands, its dry friction holds whatever current the drive happens to give.

Within plus and minus its Coulomb friction that current says nothing of links, drives or effects: least squares that are
given such rows bend to them. They are left out, unless something that the model could learn explains them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, label

from ident.arrays import BoolArray, FloatArray
from ident.effects.base import Survey
from ident.effects.friction import Coulomb
from ident.gap.candidates import admissible, best_start, forms
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.gap.spectrum import spectral_line
from ident.gap.touch import row_step
from ident.model import CurrentModel
from ident.walk import Block

STANDS, OF_MEAN = 5e-3, 0.05
"""A joint slower than this [rad/s or m/s], and than this share of its mean speed, stands."""

AROUND = 0.05
"""Seconds around a rest that go with it: derived velocities are smoothed."""

RESTS, MOVES = 0.02, 0.2
"""Share of the rows that must be rests for them to be looked at, and motion for it to tell what is usual."""

STICKS = 4.0
"""A joint sticks if its mean square is this many times larger in rests than in motion, that motion being fitted."""

HELD, MOST = 1.3, 2.0
"""Dry friction holds this many times its force in motion in the mean square, and at most as joints break away."""

RATTLES = 2.0
"""What dry friction holds is quiet: it changes from row to row at most this many times as much as in motion."""

HUNTS = 0.15
"""Share of what rests hold, without the mean of each, that a line in the spectrum has where a drive hunts."""

EXPLAINED = 0.75
"""Share of the rests' squares that an effect must explain for them to tell of it."""

TELLING = ("hysteresis", "rigid-body")
"""Families of effects that act on a joint that stands."""


@dataclass(frozen=True, eq=False)
class Rests:
    """Which joints stick, and when.

    Attributes:
        speed: speed (n,) below which a joint that sticks is held by its dry friction; nought for others.
        most: force (n,) that its dry friction holds at most.
    """

    speed: FloatArray
    most: FloatArray

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints, from 0, whose rests are left out."""
        return tuple(np.flatnonzero(self.speed > 0.0).tolist())

    def counts(self, block: Block) -> BoolArray:
        """Whether each joint's row of a block (N, n) counts."""
        speed = np.abs(np.nan_to_num(block.motion.dq))
        return np.stack([~_around(speed[:, j] < s, block) for j, s in enumerate(self.speed)], axis=1)

    def beyond(self, joint: int, left: FloatArray) -> FloatArray:
        """The part of a resting joint's residuals (M,) that its dry friction cannot hold."""
        return np.asarray(np.sign(left) * np.maximum(np.abs(left) - self.most[joint], 0.0))


def no_rests(n: int) -> Rests:
    """No joint sticks."""
    return Rests(np.zeros(n), np.zeros(n))


def rests_of(model: CurrentModel, panel: Panel, survey: Survey, gaps: Sequence[JointGap]) -> Rests:
    """Find the joints that stick.

    Args:
        model: the model, with its dry friction.
        panel: the rows.
        survey: facts about them.
        gaps: every joint's rows.
    """
    speed = np.minimum(STANDS, OF_MEAN * survey.pace)
    moving = panel.gather(Rests(speed, speed).counts)
    dry = np.zeros(model.n)
    for term in model.terms:
        if isinstance(term.effect, Coulomb):
            dry[term.effect.at] = abs(term.coefficients[0])
    sticks = [_sticks(panel, survey, gap, ~moving[:, gap.joint], dry[gap.joint]) for gap in gaps]
    return Rests(np.where(sticks, speed, 0.0), MOST * dry)


def _sticks(panel: Panel, survey: Survey, gap: JointGap, rest: BoolArray, dry: float) -> bool:
    if rest.mean() < RESTS or rest.mean() > 1.0 - MOVES:
        return False
    left = gap.without(rest).everywhere(panel)
    usual, held = float(np.mean(left[~rest] ** 2)), float(np.mean(left[rest] ** 2))
    if held < STICKS * usual or held > (HELD * dry) ** 2 + usual:
        return False
    if _rattles(left, rest) or _hunts(panel, _without_levels(left, rest), rest, usual):
        return False
    return not _told(panel, survey, gap, rest)


def _rattles(left: FloatArray, rest: BoolArray) -> bool:
    """Whether what rests hold changes from row to row by more than it does in motion."""
    step = np.abs(np.diff(left))
    return bool(np.median(step[rest[1:]]) > RATTLES * np.median(step[~rest[1:]]))


def _hunts(panel: Panel, swings: FloatArray, rest: BoolArray, usual: float) -> bool:
    """Whether what rests hold swings at one frequency, by more than is usual in motion."""
    if np.mean(swings[rest] ** 2) < STICKS * usual:
        return False
    line = spectral_line(swings, panel.start, row_step(panel))
    return line is not None and line[1] > HUNTS


def _without_levels(left: FloatArray, rest: BoolArray) -> FloatArray:
    """What is left in rests (N,), without the mean of each: a drive that hunts is held by no friction."""
    pieces, _ = label(rest)
    level = np.bincount(pieces, left) / np.maximum(np.bincount(pieces), 1)
    return np.where(rest, left - level[pieces], 0.0)


def _told(panel: Panel, survey: Survey, gap: JointGap, rest: BoolArray) -> bool:
    """Whether an effect explains most of what the rests of a joint are above the rest."""
    problem = gap.problem(panel)
    least = (1.0 - EXPLAINED) * float(np.sum(problem.residual[rest] ** 2))
    for effect in forms(survey, gap.joint, gap.present):
        if effect.family in TELLING:
            start = best_start(panel, problem, effect, gap.joint)
            columns = admissible(panel, problem, effect, start.shape, gap.joint)
            if np.sum(problem.left(columns)[rest] ** 2) < least:
                return True
    return False


def _around(rest: BoolArray, block: Block) -> BoolArray:
    if not rest.any():
        return rest
    return np.asarray(binary_dilation(rest, iterations=max(1, round(AROUND * block.log.rate))), dtype=bool)
