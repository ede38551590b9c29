"""A torque constant that other joints' rows contradict: a joint's own rows bend their links to it and leave nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Survey, Term, initial_term
from ident.effects.electrical import DriveGain, TorqueSaturation
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.gap.rows import left_by
from ident.model import NEWTON_METRE, CurrentModel

CONTRADICTS = 1.1
"""How many times what its own links leave, RMS, those that all rows share must leave on a joint to be looked at."""

SUSPECTS = 3
"""Joints that are tried, those of the largest contradiction first."""

OWN, ALL = 0.8, 0.5
"""Share of a joint's contradiction, in squares, and of that of all joints together, that its gain must account for
(1.0 and .9 where one was 19 % wrong; up to .5 and .15 in logs of arms whose gains are right)."""

SATURATES = 1.1
"""How many times as much iron that saturates may account for: links bend to it, and others' gains with them."""


def wrong_gain(
    model: CurrentModel,
    panel: Panel,
    survey: Survey,
    gaps: Sequence[JointGap],
    fitted: Callable[[CurrentModel, Sequence[Term]], CurrentModel],
) -> Term | None:
    """Find the joint whose gain, taken for known, the others' rows say to be another.

    Where gains are known all rows share their links. A wrong one scales what its joint says of them.

    Args:
        model: fitted to all rows together.
        panel: the rows, as that model sees them.
        survey: facts about them.
        gaps: each joint's rows, whose links are fitted to them alone.
        fitted: fits a model again with further terms.
    """
    if model.force_unit != NEWTON_METRE or model.n < 2:
        return None
    own = np.array([float(np.mean(p.residual**2)) for p in (gap.bare().problem(panel) for gap in gaps)])

    def contradiction(tried: CurrentModel, seen: Panel) -> FloatArray:
        """By how many times each joint's own error, in squares, that of the links that rows share is larger."""
        left = left_by(tried, seen)
        shared = np.array([float(np.mean(left[gap.keep, gap.joint] ** 2)) for gap in gaps])
        return np.asarray(shared / np.maximum(own, 1e-300) - 1.0)

    def fallen(effect: DriveGain | TorqueSaturation) -> tuple[Term, FloatArray]:
        """An effect fitted besides, and by how much the contradictions are smaller with it."""
        tried = fitted(model, [initial_term(effect)])
        return tried.terms[-1], before - contradiction(tried, panel.seen_by(tried))

    before = contradiction(model, panel)
    if before.max() < CONTRADICTS**2 - 1.0:
        return None
    present = [term.effect for term in model.terms]
    suspects: list[int] = np.argsort(-before)[:SUSPECTS].tolist()
    for joint in suspects:
        if DriveGain(joint) in present:
            continue
        gain, falls = fallen(DriveGain(joint))
        if falls[joint] >= OWN * before[joint] and falls.sum() >= ALL * before.sum():
            iron = (fallen(TorqueSaturation(j, float(survey.largest[j])))[1].sum() for j in suspects)
            return None if any(other > SATURATES * falls.sum() for other in iron) else gain
    return None
