"""A torque constant that other joints' rows contradict: a joint's own rows bend their links to it and leave nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ident.arrays import FloatArray
from ident.effects.attached import GravityBalancer
from ident.effects.base import Term, initial_term
from ident.effects.electrical import DriveGain, TorqueSaturation
from ident.effects.rigid_body import CableSpring
from ident.gap.panel import Panel
from ident.gap.rows import left_by
from ident.gap.subject import Subject
from ident.model import NEWTON_METRE, CurrentModel

CONTRADICTS = 1.1
"""How many times what its own links leave, RMS, those that all rows share must leave on a joint to be looked at."""

SUSPECTS = 3
"""Joints that are tried, those of the largest contradiction first."""

ONE, ALL = 0.8, 0.5
"""Share of its joint's contradiction, in squares, or of the largest, and of all joints' together, that a gain must
account for (1.0 and .9 where one was 19 % wrong; up to .5 and .15 in logs of arms whose gains are right)."""

UNDECIDED = 0.95
"""Share of what the best gain accounts for from which on another joint's may as well be the wrong one."""

OFF = 0.03
"""Share by which a torque constant must be wrong: by less, models are."""

BENDS = 1.1
"""How many times as much may be accounted for by what links bend to as well, and others' gains with them: iron that
saturates, a spring."""


def wrong_gain(subject: Subject) -> Term | None:
    """Find the joint whose gain, taken for known, the others' rows say to be another.

    Where gains are known all rows share their links. A wrong one scales what its joint says of them, whose own links
    are fitted to its rows alone.

    Args:
        subject: a model fitted to all rows together, and the rows.
    """
    model, panel, gaps = subject.model, subject.panel, subject.gaps
    if model.force_unit != NEWTON_METRE or model.n < 2:
        return None
    own = np.array([float(np.mean(p.residual**2)) for p in (gap.bare().problem(panel) for gap in gaps)])

    def contradiction(tried: CurrentModel, seen: Panel) -> FloatArray:
        """By how many times each joint's own error, in squares, that of the links that rows share is larger."""
        left = left_by(tried, seen)
        shared = np.array([float(np.mean(left[gap.keep, gap.joint] ** 2)) for gap in gaps])
        return np.asarray(shared / np.maximum(own, 1e-300) - 1.0)

    def fallen(*terms: Term) -> tuple[Term, FloatArray]:
        """The last of some terms, fitted besides, and by how much the contradictions are smaller with them."""
        beside = subject.fitted(model, terms)
        return beside.terms[-1], before - contradiction(beside, panel.seen_by(beside))

    before = contradiction(model, panel)
    if before.max() < CONTRADICTS**2 - 1.0:
        return None
    present = [term.effect for term in model.terms]
    # A wrong gain may contradict the joints that carry the same links more than its own: the one that all agree with.
    suspects: list[int] = np.argsort(-before)[:SUSPECTS].tolist()
    tried = [fallen(initial_term(DriveGain(joint))) for joint in suspects if DriveGain(joint) not in present]
    if not tried:
        return None
    totals = np.array([falls.sum() for _, falls in tried])
    (gain, falls), most = tried[int(totals.argmax())], float(totals.max())
    accounted = (falls / np.maximum(before, 1e-300))[[gain.effect.at, suspects[0]]].max()
    if accounted < ONE or most < ALL * before.sum() or abs(float(gain.coefficients[0])) < OFF:
        return None
    if np.sum(totals >= UNDECIDED * most) > 1:
        return None
    # Its own joint's springs first: they are the likeliest to account for as much.
    nearest = sorted(suspects, key=lambda joint: joint != gain.effect.at)
    bending = (fallen(*terms)[1].sum() for joint in nearest for terms in _bending(subject, joint))
    return None if any(other > BENDS * most for other in bending) else gain


def _bending(subject: Subject, joint: int) -> Iterator[list[Term]]:
    """Yield, as terms not yet fitted, what a joint may have to which its own links bend."""
    yield [initial_term(TorqueSaturation(joint, float(subject.survey.largest[joint])))]
    yield [initial_term(CableSpring(joint))]
    if not subject.model.robot.multibody.prismatic[joint]:
        # Two of a quarter of a turn are one, whatever its neutral angle.
        one = initial_term(GravityBalancer(joint, ideal=True))
        yield [replace(one, shape=np.array([neutral])) for neutral in (0.0, 0.5 * np.pi)]
