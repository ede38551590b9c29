"""Noise of the accelerations, which a spring that is not there would explain."""

from dataclasses import replace

import numpy as np
import pytest
from planar_arm import logs, motion, record

from ident.gap import baseline_model, find_gap
from ident.gap.rows import panel_of

NOISY = 3e-5


def shaken(log, seed):
    """A log with noise of its positions."""
    return replace(log, q=log.q + NOISY * np.random.default_rng(seed).standard_normal(log.q.shape))


def test_jolts_are_the_error_that_noise_of_positions_makes_of_the_force(arm):
    model = replace(baseline_model(arm, logs(arm, 1)), cutoff=20.0)
    panel = panel_of(model, [shaken(record(arm, 1), 7)])
    (block,), (rows,) = panel.blocks, panel.rows
    true = motion(1)[3]
    inertia = model.context(block.motion).inertia[rows] + np.diag(model.rotor_inertia)
    error = np.einsum("tjk,tk->tj", inertia, (block.motion.ddq - true)[rows])
    assert panel.jolts == pytest.approx(np.sqrt(np.mean(error**2, axis=0)), rel=0.15)


def test_noise_of_the_accelerations_is_no_spring(arm):
    train = [shaken(log, k) for k, log in enumerate(logs(arm, 1))]
    model = replace(baseline_model(arm, train), cutoff=30.0)
    assert find_gap(model, train).findings == ()
