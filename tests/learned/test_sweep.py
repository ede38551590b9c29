import dataclasses

import numpy as np
import torch

from learned.model_file import TrainedModel
from learned.options import TrainingOptions
from learned.sweep import Run, sweep
from learned.training import train

QUICK = TrainingOptions(epochs=1, batch=256, width=8, hierarchies=1, cutoff=20.0)


def test_a_sweep_gives_what_single_trainings_give(arm_card, stop_and_go, tmp_path):
    logs = [stop_and_go(seed, seconds=20.0) for seed in range(2)]
    runs = [Run(f"{m}-{s}", m, dataclasses.replace(QUICK, seed=s)) for m in ("mlp", "hrdl-md") for s in (0, 1)]
    models = sweep(arm_card, logs[:1], logs[1:], runs, out=tmp_path)
    assert list(models) == [run.name for run in runs]
    assert torch.get_num_threads() == 1
    for run in runs:
        alone = train(arm_card, logs[:1], logs[1:], run.method, run.options)
        np.testing.assert_array_equal(models[run.name].trained.weights, alone.trained.weights)
        np.testing.assert_array_equal(TrainedModel.load(tmp_path / run.name).weights, alone.trained.weights)
    assert not np.array_equal(models["mlp-0"].trained.weights, models["mlp-1"].trained.weights)


def test_what_is_done_is_not_trained_again(arm_card, stop_and_go, tmp_path):
    logs = [stop_and_go(seed, seconds=20.0) for seed in range(2)]
    runs = [Run("mlp-0", "mlp", QUICK)]
    first = sweep(arm_card, logs[:1], logs[1:], runs, out=tmp_path)
    changed = [log.replace(current=-log.current) for log in logs]
    again = sweep(arm_card, changed[:1], changed[1:], runs, out=tmp_path)
    np.testing.assert_array_equal(again["mlp-0"].trained.weights, first["mlp-0"].trained.weights)
