"""Whether the force that an effect predicts is there in all kinds of motion, as that of a true cause is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.gap.gate import FAST, MOVING
from ident.gap.joint_gap import classes_of
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.uncertainty import correlation_time

AGREES, SLACK, HARM = 0.7, 0.05, 0.02
"""How much of the force that an effect predicts must be there, at rest and in motion; shares of the squared residual
that may be lacking of that, and that it may at most add."""

IN_TIME = 0.4
"""How much of what a cause of the whole robot predicts must be there in slow and in fast motion: .06 to .14 of a delay
was where joints creep as they turn round, .5 and more of true ones, whose slow motion is next to turns that noise
shifts."""


def agrees(problem: JointProblem, columns: FloatArray, groups: Sequence[BoolArray]) -> bool:
    """Whether what an effect predicts for rows held out is there in every group of rows: rests are few, however long.

    The slope of the residual r on the predicted force d is (r d) / d^2; one that fits the rests alone has none in
    motion. With r - d what is left, the squared residual falls by (2 slope - 1) d^2.

    Args:
        problem: the regression that the effect would be added to.
        columns: the effect's (N, k).
        groups: rows (N,) of each group.
    """
    before, after = problem.held_out(columns[:, :0]), problem.held_out(columns)
    for rows in groups:
        square, left = float(np.sum(before[rows] ** 2)), float(np.sum(after[rows] ** 2))
        predicted = float(np.sum((before[rows] - after[rows]) ** 2))
        least = max((2.0 * AGREES - 1.0) * predicted - SLACK * square, -HARM * square)
        if square - left < least:
            return False
    return True


@dataclass(frozen=True, eq=False)
class Predicted:
    """What an effect, fitted to all rows, adds on a joint.

    Attributes:
        force: what it adds (N,) beyond what the baseline absorbs.
        residual: what is there (N,) without it.
        pace: class of speed of each row (N,).
    """

    force: FloatArray
    residual: FloatArray
    pace: IntArray

    @classmethod
    def of(cls, panel: Panel, problem: JointProblem, joint: int, force: FloatArray) -> Predicted:
        """A force (N,) in a problem's rows."""
        return cls(problem.away(force[:, None])[:, 0], problem.residual, classes_of(panel, problem, joint))


def agrees_at_any_pace(joints: Sequence[Predicted], least: float) -> bool:
    """Whether a share of what one effect predicts is there in slow as in fast motion, by twice its standard error.

    A time or a mass is the same at any speed. Friction that creeps as a joint turns round looks late as well, but in
    motion its current is on time.

    Args:
        joints: what it predicts on each.
        least: the share.
    """
    noise = [correlation_time(left) * float(np.mean(left**2)) for left in (one.residual - one.force for one in joints)]
    for pace in (MOVING, FAST):
        product = square = 0.0
        for one, size in zip(joints, noise, strict=True):
            weight, rows = 1.0 / max(size, 1e-300), one.pace == pace
            product += weight * float(one.residual[rows] @ one.force[rows])
            square += weight * float(one.force[rows] @ one.force[rows])
        if product < least * square - 2.0 * np.sqrt(square):
            return False
    return True
