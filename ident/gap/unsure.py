"""Rows whose sign of velocity the logs cannot tell: friction is large there, and so is the error of predicting it."""

from __future__ import annotations

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.effects.base import Survey
from ident.effects.friction import Coulomb
from ident.gap.panel import Panel
from ident.model import CurrentModel
from ident.signals import derivative_noise

TURNED = 3.0
"""Smoothings beyond which the sign has turned."""

WORST = 1.0
"""By how many times the residual the velocity's noise may shake dry friction while its sign turns."""


def unsure_rows(model: CurrentModel, panel: Panel, survey: Survey, residual: FloatArray) -> BoolArray:
    """Find rows (N, n) in which noise of the velocity, and not the joint, says which way friction points.

    They are left out of a joint only where that noise shakes its dry friction by more than the residual in motion is:
    where the sign turns a force F over the speed s, noise of standard deviation v leaves an error of F v / s.

    Args:
        model: the baseline, with its dry friction.
        panel: the rows.
        survey: facts about the logs.
        residual: what the baseline leaves in the rows, (N, n), in force units.
    """
    slow = np.abs(panel.velocity) < TURNED * survey.smoothing
    found = np.zeros(slow.shape, dtype=bool)
    noise = velocity_noise(model, panel)
    for term in model.terms:
        if isinstance(term.effect, Coulomb):
            j = term.effect.at
            moving = residual[~slow[:, j], j]
            shaken = abs(float(term.coefficients[0])) * noise[j] / survey.smoothing[j]
            if len(moving) > 0 and shaken > WORST * np.sqrt(np.mean(moving**2)):
                found[:, j] = slow[:, j]
    return found


def velocity_noise(model: CurrentModel, panel: Panel) -> FloatArray:
    """Standard deviation (n,) of the noise in the velocities used, from what the filter took away.

    That is taken for white; its share below the cut-off, or of positions its derivative's, follows.
    """
    cutoff, rate = model.cutoff, panel.blocks[0].log.rate
    logged = not model.positions_only and all(block.log.dq is not None for block in panel.blocks)
    if logged:
        removed = np.concatenate([(b.log.dq - b.motion.dq)[b.keep] for b in panel.blocks])  # type: ignore[operator]
        share = min(2.0 * cutoff / rate, 0.9)
        return np.asarray(_spread(removed) * np.sqrt(share / (1.0 - share)))
    return derivative_noise(_spread(np.concatenate([b.removed for b in panel.blocks])), cutoff, rate)


def _spread(values: FloatArray) -> FloatArray:
    """Standard deviation (n,) of most of the values (N, n): quick motion is no noise."""
    return np.asarray(1.4826 * np.median(np.abs(values), axis=0))
