"""``sensorless train`` on a little of the virtual robot."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from comparisons import cli
from comparisons.protocols import stop_and_go
from comparisons.virtual_robot import VirtualRobot
from ident.log_writer import write_log
from ident.readers import open_log
from ident.robot import load_robot
from learned.predictor import LearnedModel


@pytest.fixture(scope="module")
def robot():
    return load_robot("vs060")


@pytest.fixture(scope="module")
def logs(robot, tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    virtual = VirtualRobot(robot)
    for seed in range(3):
        write_log(virtual.record(stop_and_go(robot, seconds=60.0, seed=seed), seed), folder / f"run{seed}.parquet")
    return folder


def run(*words):
    with pytest.raises(SystemExit) as exit_:
        cli.main([str(word) for word in words])
    return int(exit_.value.code or 0)


def test_train_writes_model_predictions_result_and_report(robot, logs, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["--epochs", 2, "--width", 16, "--hierarchies", 2, "--batch", 128, "--onnx"]
    given = ["--train", logs / "run0.parquet", logs / "run1.parquet", "--test", logs / "run2.parquet"]
    assert run("train", "vs060", *given, "--out", out, *words) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out"]
    result = json.loads((out / "result.json").read_text())
    table = pq.read_table(out / "predictions" / "run2.parquet").to_pydict()
    log = open_log(logs / "run2.parquet", robot).read()
    assert len(table["t"]) == len(log)
    error = np.array([np.array(table[f"i{j}"]) - np.array(table[f"p{j}"]) for j in range(1, 7)])
    np.testing.assert_allclose(np.sqrt(np.nanmean(error**2, axis=1)), result["test"]["rmse"], rtol=1e-9)
    relative = 100.0 * np.linalg.norm(error, axis=1) / np.linalg.norm(log.current, axis=0)
    np.testing.assert_allclose(relative, result["test"]["relative_error_percent"], rtol=1e-6)
    assert result["skipped"] == {"run2": 0}
    assert [len(stage["history"]) for stage in result["stages"]] == [3, 3]
    predicted = LearnedModel.load(out, robot).predict(log)
    np.testing.assert_array_equal(predicted[:, 0], table["p1"])
    assert (out / "model.onnx").is_file()
    page = (out / "report.html").read_text()
    assert "Network 2" in page
    assert "loss" in page.lower()
    assert capsys.readouterr().err == ""


def test_wrong_calls_are_refused_and_leave_nothing(logs, tmp_path, capsys):
    given = ["--train", logs / "run0.parquet", "--test", logs / "run2.parquet", "--out", tmp_path / "out"]
    assert run("train", "vs060", *given, "--model", tmp_path) == 2
    assert "error: hrdl-md stands on no model, --model" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert run("train", "vs060", *given, "--rate", 70) == 2
    assert "100 Hz where the model is for 70 Hz" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
