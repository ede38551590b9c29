"""What the user of an identification should look at: joints that stand still, flipped signs, gains left open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.drive_gain import GainEstimate
from ident.model import CurrentModel
from ident.robot import Robot
from ident.walk import Block

NEVER_MOVES = 2e-3
"""A joint that stays within this [rad or m] teaches nothing of its own friction."""


def still_joints(held: Sequence[Block]) -> list[int]:
    """Joints, from 0, that never move in blocks of rows."""
    q = np.concatenate([block.motion.q[block.keep] for block in held])
    return [int(j) for j in np.flatnonzero(np.ptp(q, axis=0) < NEVER_MOVES)]


def still_warnings(robot: Robot, still: Sequence[int]) -> list[str]:
    """Name joints that never move."""
    return [
        f"Joint {j + 1} ({robot.joints[j]}) never moves: its friction and its own inertia cannot be identified."
        for j in still
    ]


def gain_warnings(estimate: GainEstimate | None) -> list[str]:
    """Name drive gains that the logs leave open, and why."""
    if estimate is None:
        return []
    return [
        f"Joint {j + 1}: the logs leave its drive gain open, {estimate.reason[j]}; its forces in N m rest on a "
        f"gain between {estimate.low[j]:.3g} and {estimate.high[j]:.3g}."
        for j in np.flatnonzero(estimate.open)
    ]


def sign_warnings(model: CurrentModel, held: Sequence[Block]) -> list[str]:
    """Name joints whose friction would drive the motion: the sign of their current or position is flipped."""
    power = np.zeros(model.n)
    for block in held:
        friction = model.friction(block.motion)
        power += np.sum((friction * block.motion.dq)[block.keep], axis=0)
    return [
        f"Joint {j + 1} ({model.robot.joints[j]}): friction would drive the motion; the sign of its current is "
        "probably flipped. Give the card a scale of -1 for it: [log] scale = { current = [...] }."
        for j in np.flatnonzero(power < 0)
    ]
