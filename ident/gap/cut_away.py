"""What the derivatives' filter cuts away of the force that links and rotors need.

Moves that start and stop at once have accelerations beyond the cut-off: the current has them and the model has not. A
spring that swings makes up for some of that.
"""

from __future__ import annotations

import itertools

import numpy as np

from ident.arrays import FloatArray
from ident.model import CurrentModel
from ident.signals import Motion, derive
from ident.walk import Block


def cut_away(model: CurrentModel, block: Block, twice: Motion) -> FloatArray:
    """Columns (N, n, 4), in a block's rows, by which each joint's force may differ for what the filter cuts away.

    What it cuts away is a series in what it takes of its own result (van Cittert 1931): once and once more, of the
    links' force and of the motor's acceleration.

    Args:
        model: the model, with its links.
        block: a stretch of the logs.
        twice: its motion, filtered once more.
    """
    motions = (block.motion, twice, filtered_again(model, block, twice))
    seen = [np.stack([model.load(motion), model.robot.motors(motion).ddq], axis=2) for motion in motions]
    return np.concatenate([one - other for one, other in itertools.pairwise(seen)], axis=2)


def filtered_again(model: CurrentModel, block: Block, motion: Motion) -> Motion:
    """A block's motion filtered once more, its derivatives those of the positions."""
    return derive(block.log.replace(q=motion.q, dq=None, ddq=None), model.cutoff)
