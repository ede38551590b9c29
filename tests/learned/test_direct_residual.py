"""A network behind the interface of the observers: measured minus predicted current."""

import dataclasses

import numpy as np
import pytest

from learned.options import TrainingOptions
from learned.predictor import LearnedModel
from learned.training import train
from observers.direct import DirectEstimator
from observers.residual import ResidualEstimator


@pytest.mark.parametrize("method", ["hrdl-md", "lstm"])
def test_step_by_step_equals_the_whole_log(method, stop_and_go, random_model):
    log = stop_and_go(1, seconds=6.0, segments=2)
    estimator = DirectEstimator(LearnedModel(random_model(method)), 100.0)
    assert isinstance(estimator, ResidualEstimator)
    whole = estimator.run(log).current
    for rows in log.segments():
        estimator.reset()
        stepped = [estimator.step(sample) for sample in log[rows].samples()]
        np.testing.assert_allclose(stepped, whole[rows], rtol=0.0, atol=1e-9)


def test_a_push_shows_on_the_joint_it_acts_on(arm_card, stop_and_go):
    options = TrainingOptions(
        epochs=5, batch=128, width=32, learning_rate=3e-3, cutoff=20.0, hierarchies=1, signal="displacement",
        thresholds=(0.001, 0.003, 0.01),
    )  # fmt: skip
    model = train(arm_card, [stop_and_go(seed, seconds=120.0) for seed in range(3)], None, "hrdl-md", options)
    estimator = DirectEstimator(model, 100.0)
    free = stop_and_go(50, seconds=30.0)
    push = np.zeros_like(free.current)
    push[1000:1500, 1] = 8.0
    quiet = estimator.run(free).current
    pushed = estimator.run(dataclasses.replace(free, current=free.current - push)).current
    np.testing.assert_allclose(pushed - quiet, push, atol=1e-9)
    assert np.sqrt(np.mean(quiet[100:] ** 2)) < 0.25 * push.max()
