"""An encoder's counts, and what they feign where they pass the filter of the derivatives.

At the speeds that cross nearly whole counts from sample to sample, the staircase of counts is aliased to frequencies
below the cut-off. Its first harmonic is a count over pi: a model that sees it predicts a force that is not there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray

if TYPE_CHECKING:
    from ident.effects.survey import Survey
    from ident.gap.panel import Panel

ROUNDING = 1e-9
"""Positions [rad or m] that differ by less are the same."""

STEPS, WHOLE, MOSTLY = 10, 0.1, 0.9
"""Steps between positions that are asked for, how far they may be off a multiple, and share of them that must not be.
"""


def encoder_counts(q: FloatArray) -> FloatArray:
    """Return the step (n,) of which all between positions (N, n) are multiples; nought where there is none."""
    counts = np.zeros(q.shape[1])
    for joint, positions in enumerate(q.T):
        steps = np.diff(np.unique(positions))
        steps = steps[steps > ROUNDING]
        least = np.min(steps, initial=np.inf)
        multiples = steps / least
        if len(steps) >= STEPS and np.mean(np.abs(multiples - np.round(multiples)) < WHOLE) >= MOSTLY:
            counts[joint] = least
    return counts


def counted_acceleration(panel: Panel, survey: Survey, joint: int) -> float:
    """Largest acceleration [rad/s^2 or m/s^2] that a joint's counts feign; of positions without any, about nought."""
    return (2.0 * np.pi * survey.cutoff) ** 2 * float(panel.counts[joint]) / np.pi


def counted_force(panel: Panel, survey: Survey, joint: int) -> float:
    """Force that a joint's links would need for that acceleration, in the model's force unit."""
    inertia = np.median(np.concatenate([context.inertia[:, joint, joint] for context in panel.contexts]))
    return abs(float(inertia)) * counted_acceleration(panel, survey, joint)
