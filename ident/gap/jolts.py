"""What noise of the accelerations makes of the force that links and rotors need.

A spring, a delay and a filter take from fast changes of that force, and so from its noise: they explain that where
there is none of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.gap.sensor_noise import removed_square, velocities_used
from ident.model import CurrentModel
from ident.signals import Motion, zero_phase_gain
from ident.walk import Block

POSES = 200
"""Rows of a block at which the inertia is looked at."""

FREQUENCIES = 512
"""Frequencies at which noise is summed."""


def jolts(model: CurrentModel, blocks: Sequence[Block], rows: Sequence[IntArray]) -> FloatArray:
    """Standard deviation (n,) of each joint's force by noise of all joints' accelerations, in the model's force unit.

    Args:
        model: the model, with its links and rotors.
        blocks: stretches of the logs.
        rows: the rows of each that are looked at.
    """
    square, count = np.zeros(model.n), 0
    for block, looked_at in zip(blocks, rows, strict=True):
        if len(looked_at) == 0:
            continue
        few = looked_at[:: max(1, len(looked_at) // POSES)]
        motion = Motion(*(x[few] for x in (block.motion.t, block.motion.q, block.motion.dq, block.motion.ddq)))
        inertia = model.robot.by_joints(model.context(motion).inertia + np.diag(model.rotor_inertia))
        noise = _noise(model, block, looked_at)
        square += len(looked_at) * np.mean((inertia * noise) ** 2, axis=0).sum(axis=1)
        count += len(looked_at)
    return np.asarray(np.sqrt(square / max(count, 1)))


def _noise(model: CurrentModel, block: Block, rows: IntArray) -> FloatArray:
    """Standard deviation (n,) of the accelerations' noise, by what the filter took away, taken for white.

    In motion that is usual: sharp turns are no noise.
    """
    rate = block.log.rate
    usual = np.median(removed_square(model, block)[rows], axis=0)
    hertz = np.linspace(0.0, 0.49 * rate, FREQUENCIES)
    gain = zero_phase_gain(hertz, rate, model.cutoff)
    slope = (2.0 * np.pi * hertz) ** (2 if velocities_used(model, block) is None else 1)
    per_square = np.mean((slope * gain) ** 2) / np.mean((1.0 - gain) ** 2)
    return np.asarray(np.sqrt(usual * per_square))
