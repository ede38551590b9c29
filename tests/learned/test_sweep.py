import dataclasses
import shutil

import numpy as np
import pytest
import torch

from ident.errors import InputError
from learned.model_file import TrainedModel
from learned.options import TrainingOptions
from learned.sweep import Run, cross_validate, sweep
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


def squares(model, logs):
    """Names of the logs a model is judged on, and its error there."""
    errors = [float(np.nanmean((model.predict(log) - log.current) ** 2)) for log in logs]
    return [log.name for log in logs], errors


def test_each_fold_is_judged_by_a_model_that_has_not_seen_it(arm_card, stop_and_go, tmp_path):
    logs = [stop_and_go(seed, seconds=20.0).replace(name=f"log{seed}") for seed in range(4)]
    folds = [logs[:1], logs[1:3], logs[3:]]
    runs = [Run("mlp", "mlp", QUICK), Run("hrdl-md", "hrdl-md", QUICK)]
    told = []
    found = cross_validate(arm_card, folds, runs, squares, out=tmp_path, done=told.append)
    assert list(found) == ["mlp", "hrdl-md"]
    assert told == pytest.approx([k / 6 for k in range(1, 7)])
    for run in runs:
        assert [names for names, _ in found[run.name]] == [["log0"], ["log1", "log2"], ["log3"]]
        alone = train(arm_card, [logs[0], logs[3]], None, run.method, run.options)
        assert found[run.name][1] == squares(alone, folds[1])
        np.testing.assert_array_equal(TrainedModel.load(tmp_path / run.name / "fold-2").weights, alone.trained.weights)


def test_a_cross_validation_goes_on_with_the_folds_that_are_done(arm_card, stop_and_go, tmp_path, monkeypatch):
    logs = [stop_and_go(seed, seconds=20.0) for seed in range(2)]
    runs = [Run("mlp", "mlp", QUICK)]
    first = cross_validate(arm_card, [logs[:1], logs[1:]], runs, squares, out=tmp_path)
    shutil.rmtree(tmp_path / "mlp" / "fold-2")
    trained = []

    def counted(*arguments, **options):
        trained.append(arguments[1])
        return train(*arguments, **options)

    monkeypatch.setattr("learned.training.train", counted)
    assert cross_validate(arm_card, [logs[:1], logs[1:]], runs, squares, out=tmp_path) == first
    assert trained == [logs[:1]]


def test_one_fold_is_refused(arm_card, stop_and_go):
    with pytest.raises(InputError, match="1 fold"):
        cross_validate(arm_card, [[stop_and_go(0, seconds=20.0)]], [Run("mlp", "mlp", QUICK)], squares)
