"""Rows whose sign of velocity the logs cannot tell: friction is large there, and so is the error of predicting it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from ident.arrays import BoolArray, FloatArray
from ident.effects.friction import Coulomb
from ident.effects.survey import Survey
from ident.gap.counts import encoder_counts
from ident.gap.panel import Panel
from ident.gap.sensor_noise import around_square, removed_square, velocities_used
from ident.model import CurrentModel
from ident.signals import derivative_noise
from ident.walk import Block

TURNED = 3.0
"""Smoothings beyond which the sign has turned."""

WORST = 0.5
"""By how many times the residual the velocity's noise may shake dry friction while its sign turns."""

BEYOND = 1.6
"""By how many times what the noise makes, RMS, these rows may err before that is no longer noise (.7 to 1.4 in logs
without an effect, 2.4 with a delay of the current's noise)."""


def unsure_rows(model: CurrentModel, panel: Panel, survey: Survey, residual: FloatArray) -> BoolArray:
    """Find rows (N, n) in which noise of the velocity, and not the joint, says which way friction points.

    They are left out of a joint only where that noise shakes its dry friction by more than half of what is left in
    motion: where the sign turns a force F over the speed s, noise of standard deviation v leaves an error of F v / s.
    Where far more is left than that, something else is there, and they stay.

    Args:
        model: the baseline, with its dry friction.
        panel: the rows.
        survey: facts about the logs.
        residual: what the baseline leaves in the rows, (N, n), in force units.
    """
    slow = turning(panel, survey)
    found = np.zeros(slow.shape, dtype=bool)
    noise = shaken(model, panel, survey)
    for j in range(model.n):
        moving = residual[~slow[:, j], j]
        if len(moving) == 0:
            continue
        usual = float(np.mean(moving**2))
        rows = slow[:, j] & (noise[:, j] > WORST * np.sqrt(usual))
        beyond = float(np.sum(residual[rows, j] ** 2 - usual))
        if beyond <= BEYOND**2 * float(np.sum(noise[rows, j] ** 2)):
            found[:, j] = rows
    return found


def turning(panel: Panel, survey: Survey) -> BoolArray:
    """Rows (N, n) in which the sign of a joint's velocity turns, or that are at rest."""
    return np.asarray(np.abs(panel.velocity) < TURNED * survey.smoothing)


def shaken(model: CurrentModel, panel: Panel, survey: Survey) -> FloatArray:
    """Error (N, n) that noise of the velocity makes of dry friction where its sign turns, by standard deviation.

    Of friction that builds up over a displacement instead, noise of the position.
    """
    return _bent(model, panel, survey, lambda b: velocity_noise(model, b), lambda b: position_noise(model, b))


def mistimed(model: CurrentModel, panel: Panel, survey: Survey) -> FloatArray:
    """The same (N, n) with what the filter smears: where a joint starts at once it seems to start before."""

    def smeared(block: Block, which: str) -> FloatArray:
        return smear(model, block, getattr(block.motion, which) - getattr(panel.filtered_again(block), which))

    bent = _bent(model, panel, survey, lambda b: smeared(b, "dq"), lambda b: smeared(b, "q"))
    return np.where(turning(panel, survey), np.hypot(shaken(model, panel, survey), bent), 0.0)


def _bent(
    model: CurrentModel,
    panel: Panel,
    survey: Survey,
    of_velocity: Callable[[Block], FloatArray],
    of_position: Callable[[Block], FloatArray],
) -> FloatArray:
    """What errors (N, n) of the velocity, or of the position where it decides, make of dry friction as it turns."""
    dry, by_place = np.zeros(model.n), survey.presliding > 0.0
    for term in model.terms:
        if isinstance(term.effect, Coulomb):
            dry[term.effect.at] = abs(float(term.coefficients[0]))
    turned = panel.gather(of_velocity) / survey.smoothing
    if by_place.any():
        turned[:, by_place] = panel.gather(of_position)[:, by_place] / survey.presliding[by_place]
    return dry * turned


def smear(model: CurrentModel, block: Block, taken: FloatArray) -> FloatArray:
    """About what the filter takes of a signal (N, n), RMS over a period, by what it takes (N, n) of it once more."""
    period = max(1, round(block.log.rate / model.cutoff))
    square = uniform_filter1d(np.nan_to_num(taken) ** 2, period, axis=0, mode="nearest")
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


def position_noise(model: CurrentModel, block: Block) -> FloatArray:
    """Standard deviation (N, n) of the noise that the filter leaves in the positions, taken for white."""
    share = _share(model, block)
    return np.asarray(np.sqrt(around_square(block, block.removed) / (1.0 - share)) * np.sqrt(share))


def _share(model: CurrentModel, block: Block) -> float:
    """Share of white noise's square that is below the cut-off."""
    return min(2.0 * model.cutoff / block.log.rate, 0.9)


def velocity_noise(model: CurrentModel, block: Block) -> FloatArray:
    """Standard deviation (N, n) of the noise in the velocities used, from what the filter took away around each row.

    That is taken for white; its share below the cut-off, or of positions its derivative's, follows. Counts that come
    more slowly than the cut-off pass it, and are no less noise.
    """
    cutoff, rate = model.cutoff, block.log.rate
    share = _share(model, block)
    noise = np.sqrt(removed_square(model, block) / (1.0 - share))
    if velocities_used(model, block) is not None:
        return np.asarray(noise * np.sqrt(share))
    return np.asarray(np.hypot(derivative_noise(noise, cutoff, rate), _counted(block, cutoff)))


def _counted(block: Block, cutoff: float) -> FloatArray:
    """Standard deviation (N, n) of velocities of which the encoder's counts come more slowly than the cut-off."""
    steps = np.abs(np.diff(block.log.q, axis=0, prepend=block.log.q[:1]))
    # A count and none are as likely at half a count a period.
    speed = 0.5 * encoder_counts(block.log.q) * cutoff
    near = maximum_filter1d(steps, 2 * max(1, round(block.log.rate / cutoff)) + 1, axis=0) > 0.0
    return np.asarray(np.where(near & (np.abs(block.motion.dq) < 2.0 * speed), speed, 0.0))
