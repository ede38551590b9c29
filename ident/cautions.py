"""What a model's user should look at: joints that stand still, flipped signs, open gains, wider logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import FloatArray
from ident.drive_gain import GainEstimate
from ident.effects.electrical import CurrentOffset
from ident.log import LogSource
from ident.model import CurrentModel
from ident.robot import Robot
from ident.walk import Block, walk

NEVER_MOVES = 2e-3
"""A joint that stays within this [rad or m] teaches nothing of its own friction."""

FURTHER, ROWS = 0.1, 0.05
"""Logs go further than others if this share of their rows is this share of the others' range beyond it."""

WORSE = 3.0
"""Times what a joint errs by on train logs that it may on test logs without a word."""

WITHIN = 0.2
"""Share of what a model leaves that its own errors may make up, from which on it is said."""

SPARSE = 10
"""Of so many rows one is looked at."""


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


def error_warnings(robot: Robot, share: FloatArray) -> list[str]:
    """Name joints whose gap, a share (n,) of it, may be no change but the errors of a model held fixed."""
    return [
        f"Joint {j + 1} ({robot.joints[j]}): {100 * share[j]:.0f} % of the squared gap that is left lies within the "
        "errors of the model's own parameters, so it is no sign of a change: identify the model from longer or "
        "richer logs (sensorless excite)."
        for j in np.flatnonzero(share >= WITHIN)
    ]


def sign_warnings(model: CurrentModel, held: Sequence[Block]) -> list[str]:
    """Name joints whose friction would drive the motion: the sign of their current or position is flipped."""
    power = np.zeros(model.n)
    # An offset is no friction: where a log ends elsewhere than it began, it works.
    plain = replace(model, terms=tuple(t for t in model.terms if not isinstance(t.effect, CurrentOffset)))
    for block in held:
        friction = plain.friction(block.motion)
        power += np.sum((friction * model.robot.motors(block.motion).dq)[block.keep], axis=0)
    return [
        f"Joint {j + 1} ({model.robot.joints[j]}): friction would drive the motion; the sign of its current is "
        "probably flipped. Give the card a scale of -1 for it: [log] scale = { current = [...] }."
        for j in np.flatnonzero(power < 0)
    ]


def misfit_warnings(robot: Robot, train: FloatArray, test: FloatArray, touched: bool = False) -> list[str]:
    """Name joints that a model predicts far worse in test logs, RMS error (n,), than in train logs (n,).

    Args:
        robot: the robot.
        train: NaN where not known.
        test: of the same model.
        touched: whether contact was cut out of the train logs.
    """
    unlike = "they hold what those do not show, as quicker motion, another load, a touch or a flipped sign"
    why = "contact was cut out of those alone, or " + unlike if touched else unlike
    return [
        f"Joint {j + 1} ({robot.joints[j]}) errs {test[j] / train[j]:.0f} times as much on the test logs as on the "
        f"train logs: {why}."
        for j in np.flatnonzero(test > WORSE * train)
    ]


def reach_warnings(robot: Robot, train: Sequence[LogSource], test: Sequence[LogSource], cutoff: float) -> list[str]:
    """Say which joints go further, faster or quicker off in test logs than in train logs: a model extrapolates there.

    Args:
        robot: the robot.
        train: logs that were learnt from.
        test: logs that are predicted.
        cutoff: cut-off [Hz] of the filter that derives velocity and acceleration.
    """
    reached, asked = [[*_motions(logs, cutoff)] for logs in (train, test)]
    if not reached or not asked:
        return []
    low, high = np.min([x.min(axis=0) for x in reached], axis=0), np.max([x.max(axis=0) for x in reached], axis=0)
    low[1:] = 0.0
    margin = FURTHER * (high - low)
    share = np.mean([(x < low - margin) | (x > high + margin) for x in np.concatenate(asked)], axis=0)
    further = []
    for j in range(robot.n):
        unit = robot.displacement_unit(j)
        known = (
            f"beyond {low[0, j]:.3g} to {high[0, j]:.3g} {unit}",
            f"faster than {high[1, j]:.3g} {unit}/s",
            f"with more than {high[2, j]:.3g} {unit}/s^2",
        )
        parts = [f"{words} in {100 * share[k, j]:.0f} %" for k, words in enumerate(known) if share[k, j] > ROWS]
        if parts:
            further.append(f"joint {j + 1} ({robot.joints[j]}) {' and '.join(parts)} of the rows")
    if not further:
        return []
    return [f"The test logs go further than the train logs, so that the model extrapolates: {'; '.join(further)}."]


def _motions(sources: Sequence[LogSource], cutoff: float) -> Iterator[FloatArray]:
    """Yield positions, speeds and sizes of acceleration (N, 3, n) of rows that can be learnt from, one in SPARSE."""
    for source in sources:
        for block in walk(source, cutoff):
            rows = np.flatnonzero(block.keep)[::SPARSE]
            if len(rows):
                q, dq, ddq = (x[rows] for x in (block.motion.q, block.motion.dq, block.motion.ddq))
                yield np.stack([q, np.abs(dq), np.abs(ddq)], axis=1)
