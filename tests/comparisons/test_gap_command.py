"""``sensorless gap``: results as the contract has them, predictions before and after, bad input in one line."""

import json
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet
import pytest

from comparisons import cli
from comparisons.commands.gap import write_experiments
from comparisons.protocols.experiments import Experiments
from ident.gap.experiment import Experiment
from ident.gap.report import Finding
from ident.log import JointLog
from ident.log_writer import write_log
from ident.model_file import load_model
from ident.readers import open_log
from ident.robot import load_robot

CRANK = """<robot name="crank"><link name="base"/><link name="arm"><inertial><origin xyz=".3 0 .05"/><mass value="3"/>
<inertia ixx=".02" iyy=".08" izz=".08" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="90"/></joint></robot>"""


@pytest.fixture(scope="module")
def robot(write_card):
    return write_card("crank", CRANK, 'current_unit = "A"')


@pytest.fixture(scope="module")
def logs(robot, tmp_path_factory):
    """A one-joint arm whose friction is higher at low speed, which the baseline does not know."""
    folder, crank = tmp_path_factory.mktemp("logs"), load_robot(robot)
    for name, seed in (("train_1", 1), ("train_2", 2), ("test", 3)):
        rng = np.random.default_rng(seed)
        t = np.arange(5000) / 100.0
        q, dq, ddq = np.zeros((3, 5000, 1))
        for hertz, size in ((0.05, 0.5), (0.12, 0.3), (0.37, 0.03)):
            w, phase = 2 * np.pi * hertz, rng.uniform(0, 6)
            q[:, 0] += size * np.sin(w * t + phase)
            dq[:, 0] += size * w * np.cos(w * t + phase)
            ddq[:, 0] -= size * w**2 * np.sin(w * t + phase)
        force = crank.rigid_body.inverse_dynamics(q, dq, ddq, crank.multibody.parameters[None])
        force += 1.5 * np.tanh(dq / 2e-3) + 0.8 * dq + 0.5 * np.sign(dq) * np.exp(-((dq / 0.05) ** 2))
        current = (force + 0.1 * rng.standard_normal(q.shape)) / 4.0
        write_log(JointLog(t=t, q=q, current=current, name=name), folder / f"{name}.csv")
    return folder


def call(capsys, *words):
    with pytest.raises(SystemExit) as exit_:
        cli.main(["gap", *(str(word) for word in words)])
    captured = capsys.readouterr()
    return int(exit_.value.code or 0), captured.out, captured.err


@pytest.fixture(scope="module")
def done(robot, logs, tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "out"
    words = ["gap", robot, "--train", logs / "train_1.csv", logs / "train_2.csv", "--test", logs / "test.csv"]
    with pytest.raises(SystemExit) as exit_:
        cli.main([str(word) for word in [*words, "--out", out]])
    assert not exit_.value.code
    return out


def test_result_is_as_the_contract_says(done):
    result = json.loads((done / "result.json").read_text())
    assert result["command"] == "gap"
    assert result["unit"] == "A"
    first = result["findings"][0]
    assert first["effect"] == "stribeck"
    assert first["family"] == "friction"
    assert first["joints"] == [1]
    assert {"force", "speed"} <= set(first["parameters"])
    assert first["parameters"]["speed"] == pytest.approx(0.05, rel=0.1)
    assert first["parameters"]["force"] == pytest.approx(0.5 / 4.0, rel=0.15)
    assert 0 < first["p_value"] <= 0.01
    assert first["rmse_before"] == result["rmse"]["before"]
    assert first["rmse_after"][0] < 0.8 * first["rmse_before"][0]
    assert (first["next_experiment"] is None) == (first["alternatives"] == [])
    assert all({"effect", "reason"} <= set(one) for one in result["untestable"])
    assert result["warnings"] == []


def test_logs_that_go_further_and_flipped_signs_are_warned_of(robot, logs, tmp_path, capsys):
    crank = load_robot(robot)
    for name, size in (("train_1", 0.4), ("train_2", 0.4), ("test", 1.0)):
        log = open_log(logs / f"{name}.csv", crank).read()
        write_log(log.replace(q=log.q * size, current=-log.current), tmp_path / f"{name}.csv")
    train, test = [tmp_path / f"train_{k}.csv" for k in (1, 2)], tmp_path / "test.csv"
    status, out, _ = call(capsys, robot, "--train", *train, "--test", test, "--out", tmp_path / "out")
    assert status == 0
    assert "warning: Joint 1 (a): friction would drive the motion" in out
    assert "warning: The test logs go further than the train logs" in out
    assert "times as much on the test logs as on the train logs" in out
    assert len(json.loads((tmp_path / "out" / "result.json").read_text())["warnings"]) == 3
    assert "go further than the train logs" in (tmp_path / "out" / "report.html").read_text()


def test_figures_are_those_of_the_predictions(done, robot, logs):
    result = json.loads((done / "result.json").read_text())
    table = pyarrow.parquet.read_table(done / "predictions" / "test.parquet").to_pydict()
    log = open_log(logs / "test.csv", load_robot(robot)).read()
    np.testing.assert_array_equal(table["t"], log.t)
    for letter, part in (("b", "before"), ("p", "after")):
        left = np.array(table["i1"]) - np.array(table[f"{letter}1"])
        assert np.sqrt(np.mean(left**2)) == pytest.approx(result["rmse"][part][0])
    model = load_model(done, load_robot(robot))
    np.testing.assert_allclose(model.predict(log)[:, 0], table["p1"])


def test_the_page_shows_the_finding_and_opens_offline(done):
    page = (done / "report.html").read_text()
    assert "friction is higher at low speed" in page
    assert "What could not be tested" in page
    assert all(f'{use}="http' not in page for use in ("src", "href"))


def test_the_extended_model_is_held_fixed_when_given(done, robot, logs, tmp_path, capsys):
    words = (
        robot,
        "--train",
        logs / "train_2.csv",
        "--test",
        logs / "test.csv",
        "--model",
        done,
        "--out",
        tmp_path / "x",
    )
    status, out, _ = call(capsys, *words)
    assert status == 0
    assert "Nothing is named" in out


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("--test", "missing.csv"), "missing.csv"),
        (("--test", "TEST", "--model", "nowhere"), "no model"),
        (("--test", "TEST", "--model", "DONE", "--cutoff", "5"), "a model has its own cut-off"),
    ],
)
def test_bad_input_is_one_line_and_leaves_the_directory(words, what, done, robot, logs, tmp_path, capsys):
    known = {"TEST": logs / "test.csv", "DONE": done}
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("kept")
    given = [known.get(word, word) for word in words]
    status, _, err = call(capsys, robot, "--train", logs / "train_1.csv", *given, "--out", tmp_path / "out")
    assert status == 2
    assert err.startswith("error: ")
    assert what in err
    assert err.count("\n") == 1
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["mine.txt"]


def test_the_motion_that_would_tell_most_of_a_name_is_written_beside_the_report(tmp_path):
    vs060 = load_robot("vs060")
    motions = Experiments(vs060, seconds=20.0)
    none = Finding("viscous-friction", "friction", (1,), {}, 1e-6, (), None, (), 0.4)
    pairs = combinations(("viscous-friction", "stribeck", "load-friction"), 2)
    open_yet = {pair: Experiment("static_poses", 0.3, settles=False) for pair in pairs}
    asked = SimpleNamespace(findings=[replace(none, experiments=open_yet), none])
    write_experiments(asked, motions, tmp_path / "experiments")
    (written,) = (tmp_path / "experiments").iterdir()
    table = np.genfromtxt(written, delimiter=",", names=True)
    assert written.name == "static_poses.csv"
    assert table.dtype.names == ("t", *(f"q{j}" for j in range(1, 7)))
    np.testing.assert_allclose(table["q2"], motions["static_poses"].q[:, 1], atol=1e-6)
    assert np.all(np.abs(np.diff(table["q1"])) * motions.rate <= vs060.limits.velocity[0])
