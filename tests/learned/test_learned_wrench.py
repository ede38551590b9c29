import numpy as np
import pytest

from ident.errors import InputError
from learned.options import TrainingOptions
from learned.predictor import LearnedModel
from learned.training import train
from learned.wrench import WrenchModel, train_wrench

OPTIONS = TrainingOptions(epochs=6, batch=128, width=32, learning_rate=3e-3, cutoff=20.0)
DISCRIMINATED = TrainingOptions(
    epochs=8, batch=128, width=32, learning_rate=3e-3, cutoff=20.0, hierarchies=1, signal="displacement",
    thresholds=(0.001, 0.003, 0.01),
)  # fmt: skip


def pushed(log, seed):
    """The log of the same motion with pushes at the tool, which the joints feel through a pose-dependent Jacobian."""
    rng = np.random.default_rng(seed)
    rows = len(log)
    push = np.repeat(rng.normal(size=(rows // 50 + 1, 6)), 50, axis=0)[:rows]
    push = push * np.repeat(rng.random(rows // 200 + 1) < 0.6, 200)[:rows, None] * 3.0
    push[:, 2:] = 0.0
    lever = np.stack([1.0 + 0.3 * np.cos(log.q[:, 1]), 1.0 + 0.3 * np.sin(log.q[:, 0])], axis=1)
    return log.replace(current=log.current - push[:, :2] * lever, wrench=push)


@pytest.fixture(scope="module")
def models(arm_card, stop_and_go):
    free = [stop_and_go(seed, seconds=90.0) for seed in range(3)]
    current = train(arm_card, free, None, "hrdl-md", DISCRIMINATED)
    logs = [pushed(stop_and_go(10 + seed, seconds=60.0), seed) for seed in range(3)]
    both = [train_wrench(arm_card, logs[:2], logs[2:], predictor, OPTIONS) for predictor in (current, None)]
    return both, pushed(stop_and_go(20, seconds=60.0), 20)


def test_the_compound_scheme_is_better_at_the_same_number_of_parameters(models):
    (compound, single), log = models
    assert compound.parameters == single.parameters
    assert (compound.scheme, single.scheme) == ("compound", "single")
    errors = [np.sqrt(np.mean((log.wrench - m.predict(log))[:, :2] ** 2)) for m in (compound, single)]
    assert errors[0] < 0.9 * errors[1]
    assert errors[0] < 0.7 * log.wrench[:, :2].std()


def test_step_equals_predict_and_a_saved_model_the_same(models, tmp_path, arm_card):
    both, log = models
    log = log[:300]
    for model in both:
        predicted = model.predict(log)
        model.reset()
        np.testing.assert_array_equal([model.step(sample) for sample in log.samples()], predicted)
        model.save(tmp_path / model.scheme)
        loaded = WrenchModel.load(tmp_path / model.scheme, arm_card)
        assert loaded.scheme == model.scheme
        np.testing.assert_array_equal(loaded.predict(log), predicted)


def test_logs_without_a_wrench_or_of_another_robot_are_refused(models, stop_and_go, arm_card, random_model):
    log = stop_and_go(0, seconds=5.0)
    with pytest.raises(InputError, match="no wrench, log log0"):
        train_wrench(arm_card, [log], [log], LearnedModel(random_model("mlp")), OPTIONS)
    with pytest.raises(InputError, match="3 joints at 100 Hz"):
        models[0][1].predict(stop_and_go(0, seconds=2.0, n=3))
