import dataclasses
import os
import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from learned.dataset import FrameSpec, build
from learned.motion_discriminator import DiscriminatorSpec
from learned.options import TrainingOptions
from learned.predictor import LearnedModel
from learned.training import train

QUICK = TrainingOptions(epochs=4, batch=128, width=32, learning_rate=3e-3, cutoff=20.0)


@pytest.fixture(scope="module")
def logs(stop_and_go):
    return [stop_and_go(seed, seconds=120.0) for seed in range(3)]


@pytest.fixture(scope="module")
def test_log(stop_and_go):
    return stop_and_go(100, seconds=60.0)


def rmse(model, log):
    return np.sqrt(np.mean((log.current - model.predict(log, causal=True)) ** 2, axis=0))


@pytest.mark.parametrize("method", ["mlp", "rdl", "rdl-md", "hrdl", "hrdl-md", "lstm"])
def test_every_method_learns(method, arm, logs, test_log):
    recurrent = dataclasses.replace(QUICK, epochs=12, width=16, learning_rate=2e-2, batch=200)
    model = train(arm, logs, None, method, recurrent if method == "lstm" else QUICK)
    assert (rmse(model, test_log) < 0.6 * test_log.current.std(axis=0)).all()
    assert model.method == method


def test_what_the_discriminator_remembers_is_worth_having(arm, logs, test_log):
    options = dataclasses.replace(QUICK, hierarchies=1, signal="displacement", thresholds=(0.001, 0.003, 0.01))
    without, with_memory = (train(arm, logs, None, method, options) for method in ("hrdl", "hrdl-md"))
    assert (rmse(with_memory, test_log) < 0.6 * rmse(without, test_log)).all()


def test_more_hierarchies_fit_the_validation_log_no_worse(arm, logs):
    model = train(arm, logs[:2], logs[2:], "hrdl-md", QUICK)
    errors = [np.mean(rmse(model.truncated(k), logs[2]) ** 2) for k in (1, 2, 3)]
    assert errors[2] < errors[0]
    stages = model.trained.training["stages"]
    assert all(stage["history"][stage["best_epoch"]][1] <= stage["history"][0][1] for stage in stages)


class Gravity:
    """A physical model that knows gravity and nothing else."""

    unit, n = "%Use", 2

    def reset(self):
        pass

    def step(self, sample):
        return 10.0 * np.cos(sample.q) * np.arange(1, 3)

    def predict(self, log, causal=False):
        return 10.0 * np.cos(log.q) * np.arange(1, 3)


def test_a_hybrid_is_better_than_its_physics(arm, logs, test_log):
    physics = Gravity()
    model = train(arm, logs, None, "hybrid", QUICK, physics=physics)
    assert (rmse(model, test_log) < 0.6 * rmse(physics, test_log)).all()
    model.reset()
    stepped = np.array([model.step(sample) for sample in test_log[:200].samples()])
    np.testing.assert_allclose(stepped, model.predict(test_log[:200], causal=True), rtol=1e-12)
    with pytest.raises(InputError, match="hybrid needs a physical model"):
        train(arm, logs, None, "hybrid", QUICK)
    with pytest.raises(InputError, match="takes no physical model"):
        train(arm, logs, None, "mlp", QUICK, physics=physics)


def test_a_hybrids_networks_see_each_its_own_joint(arm, logs):
    options = dataclasses.replace(QUICK, epochs=1, signal="displacement-and-travel", thresholds=(0.001, 0.01))
    model = train(arm, logs, None, "hybrid", options, physics=Gravity())
    # no play of joint 1 crosses into joint 2, but for how far joint 1 has gone since joint 2 stopped
    log = logs[2][:400]
    q = log.q.copy()
    q[:, 0] = 0.3
    alone, both = (model.predict(log.replace(q=x)) - Gravity().predict(log.replace(q=x)) for x in (q, log.q))
    settled = both[:, 1] != alone[:, 1]
    assert not settled.all()
    assert (both[:, 0] != alone[:, 0]).all()
    frames = model.trained.architecture.frames
    first = model.trained.weights[: (frames + 8) * 32].reshape(-1, 32)
    assert (first[0::2, 1::2] == 0.0).all()
    assert (first[1::2, 0::2] == 0.0).all()
    assert (first[0::2, 0::2] != 0.0).any()


def test_frames_on_disk_give_the_same_model(arm, logs, tmp_path):
    options = dataclasses.replace(QUICK, epochs=1, hierarchies=2)
    memory = train(arm, logs, None, "hrdl-md", options)
    disk = train(arm, logs, None, "hrdl-md", dataclasses.replace(options, on_disk=True), tmp_path / "model")
    np.testing.assert_array_equal(memory.trained.weights, disk.trained.weights)
    assert sorted(p.name for p in (tmp_path / "model").iterdir()) == ["model.json", "weights.npz"]
    loaded = LearnedModel.load(tmp_path / "model", arm)
    np.testing.assert_array_equal(loaded.predict(logs[0]), memory.predict(logs[0]))


def test_cross_fitted_hierarchies_train_on_what_unseen_frames_leave(arm, logs, test_log):
    seen = []
    options = dataclasses.replace(QUICK, epochs=2, hierarchies=2, cross_fit=2)
    model = train(arm, logs, None, "hrdl-md", options, progress=seen.append)
    assert {p.stage for p in seen} == {1, 2, 3, 4}
    assert {p.stages for p in seen} == {4}
    plain = train(arm, logs, None, "hrdl-md", dataclasses.replace(options, cross_fit=0))
    assert (rmse(model, test_log) < 0.6 * test_log.current.std(axis=0)).all()
    assert not np.array_equal(model.trained.output_gain[1], plain.trained.output_gain[1])


def test_unknown_history_is_weighed_and_scored_apart(arm, stop_and_go):
    log = stop_and_go(5, seconds=20.0)
    q = log.q.copy()
    q[:500, 1] = q[500, 1]
    log = log.replace(q=q)
    spec = FrameSpec(2, 100.0, 20.0, 5, DiscriminatorSpec((0.01,)), 0.25, None, 0)
    data, _ = build([log], spec)
    weight = data.weight[data.rows]
    assert (weight[:490, 1] == 0.25).all()
    moved = np.flatnonzero(np.abs(log.q[:, 1] - log.q[0, 1]) > 0.006)[0]
    assert (weight[moved + 20 :, 1] == 1.0).all()
    model = train(arm, [log], [log], "hrdl-md", dataclasses.replace(QUICK, epochs=1))
    figures = model.trained.training["validation"]
    assert figures["rmse_known"][1] != figures["rmse_unknown"][1]
    masked, _ = build([log], dataclasses.replace(spec, unknown_history_weight=0.0))
    assert (masked.weight[masked.rows][:490, 1] == 0.0).all()


def test_zero_starts_forget_at_random_moments(stop_and_go):
    log = stop_and_go(6, seconds=120.0)
    spec = FrameSpec(2, 100.0, 20.0, 5, DiscriminatorSpec((0.01,)), 1.0, None, 0)
    never, scaling = build([log], spec)
    often, _ = build([log], dataclasses.replace(spec, zero_start_every=5.0), scalings=scaling)
    zero = scaling[1].apply(np.zeros((1, 2)))
    forgotten = [(data.held[data.rows] == zero).mean() for data in (never, often)]
    assert forgotten[0] < 0.02 < 0.05 < forgotten[1]


def test_every_eighth_log_is_held_out_and_of_few_logs_the_end(arm, stop_and_go):
    options = dataclasses.replace(QUICK, epochs=1, width=4, hierarchies=1)
    short = [stop_and_go(seed, seconds=10.0) for seed in range(9)]
    frames = train(arm, short, None, "mlp", options).trained.training["frames"]
    assert frames == {"train": 8000, "validation": 1000}
    frames = train(arm, short[:2], None, "mlp", options).trained.training["frames"]
    assert frames == {"train": 1700, "validation": 300}


def test_logs_that_do_not_fit_are_refused(arm, stop_and_go):
    with pytest.raises(InputError, match="no training logs"):
        train(arm, [], None, "mlp", QUICK)
    with pytest.raises(InputError, match="unknown method"):
        train(arm, [stop_and_go(0, seconds=5.0)], None, "cnn", QUICK)
    with pytest.raises(InputError, match="3 joints where the robot has 2"):
        train(arm, [stop_and_go(0, seconds=5.0, n=3)], None, "mlp", QUICK)
    mixed = [stop_and_go(0, seconds=5.0), stop_and_go(1, seconds=5.0, rate=130.0), stop_and_go(2, seconds=5.0)]
    with pytest.raises(InputError, match="130 Hz where the model is for 100 Hz"):
        train(arm, mixed, None, "mlp", QUICK)
    with pytest.raises(InputError, match="epochs is 0"):
        TrainingOptions(epochs=0)


SCRIPT = """
import sys
from types import SimpleNamespace
from pathlib import Path
import numpy as np, torch
torch.set_num_threads(1)
from ident.log import JointLog
from learned.options import TrainingOptions
from learned.training import train
rng = np.random.default_rng(0)
q = np.cumsum(rng.normal(scale=0.02, size=(4000, 2)), axis=0)
log = JointLog(np.arange(4000) / 100.0, q, 10.0 * np.cos(q))
arm = SimpleNamespace(name="arm", joints=("joint_1", "joint_2"), n=2, unit="A")
options = TrainingOptions(
    epochs=2, batch=128, width=16, cutoff=20.0, hierarchies=2, cross_fit=2, checkpoint_seconds=0.0
)
print("begin", flush=True)
train(arm, [log], None, "hrdl-md", options, Path(sys.argv[1]))
"""


def run_and_kill(out, rng):
    """Kill a training at a random moment after it began; True when it had ended before."""
    root = Path(__file__).parents[2]
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(out)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(root)},
    )
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(rng.uniform(0.05, 1.5))
    process.kill()
    return process.wait() == 0


@pytest.mark.parametrize("kills", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_killed_training_ends_as_if_nothing_had_happened(kills, tmp_path):
    rng = random.Random(kills)
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    subprocess.run([sys.executable, "-c", SCRIPT, str(tmp_path / "whole")], check=True, env=environment)
    ended = sum(run_and_kill(tmp_path / "killed", rng) for _ in range(kills))
    assert ended < kills
    subprocess.run([sys.executable, "-c", SCRIPT, str(tmp_path / "killed")], check=True, env=environment)
    whole, killed = (np.load(tmp_path / name / "weights.npz") for name in ("whole", "killed"))
    for name in whole.files:
        np.testing.assert_array_equal(killed[name], whole[name])
