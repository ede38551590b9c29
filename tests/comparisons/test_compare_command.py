"""``sensorless compare`` on a robot of one's own and on a little of the virtual VS060."""

import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest

from comparisons import cli
from comparisons.comparison.entrants import Request
from comparisons.comparison.held_out import low_pass
from comparisons.comparison.methods import GROUPS, parse_methods, training_options
from comparisons.comparison.run import summary
from comparisons.protocols import named
from comparisons.virtual_robot import VirtualRobot
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Viscous
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links
from ident.errors import InputError
from ident.fit import Drives, fit
from ident.log_writer import write_log
from ident.model_file import save_model
from ident.readers import open_log
from ident.robot import load_robot

TWO_LINKS = """
<robot name="two_link">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
    <inertia ixx="0.005" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="60"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="30"/></joint>
</robot>
"""
OWN = """
name = "own"
urdf = "own.urdf"
current_unit = "A"
[drive]
gain = [10.0, 5.0]
[log]
time = "stamp"
position = ["a", "b"]
current = ["ia", "ib"]
"""
FIGURES = (
    "rmse", "rmse_moving", "rmse_static", "rmse_transition", "static_bias", "static_drift_per_minute", "peak",
)  # fmt: skip


def run(*words):
    with pytest.raises(SystemExit) as exit_:
        cli.main([str(word) for word in words])
    return int(exit_.value.code or 0)


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """A folder with a card that knows its gains, and foreign CSV logs."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "own.urdf").write_text(TWO_LINKS)
    (folder / "robot.toml").write_text(OWN)
    robot = load_robot(folder / "robot.toml")
    virtual = VirtualRobot(robot)
    for name, seconds, seed in (("train", 40.0, 1), ("test", 30.0, 2)):
        log = virtual.record(named("stop_and_go")(robot, seconds=seconds, seed=seed), seed)
        table = np.column_stack([log.t, log.q, log.current])
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header="stamp,a,b,ia,ib", comments="")
    return folder


@pytest.fixture(scope="module")
def compared(own, tmp_path_factory):
    """What a comparison of that robot's estimators wrote."""
    out = tmp_path_factory.mktemp("compared") / "out"
    words = ["--methods", "physics,coulomb-viscous", "gmo", "--cutoff", 10]
    assert run("compare", own / "robot.toml", "--train", own / "train.csv", "--test", own / "test.csv", "--out", out,
               *words) == 0  # fmt: skip
    return out


def test_result_holds_what_the_contract_says(compared):
    result = json.loads((compared / "result.json").read_text())
    assert result["unit"] == "A"
    assert list(result["methods"]) == ["physics", "coulomb-viscous", "gmo"]
    for figures in result["methods"].values():
        for name in FIGURES:
            assert len(figures[name]) == 2
            assert np.all(np.isfinite(figures[name]))
            assert len(figures["smoothed"][name]) == 2
        assert ("rmse_without_lag" in figures) == (figures["kind"] == "direct")
        assert 0.0 < figures["step_us_p50"] <= figures["step_us_p99"]
        assert figures["parameters"] > 0
        assert figures["training_seconds"] > 0.0
        # the gains are known: torques are currents times gains
        for name in FIGURES:
            np.testing.assert_allclose(figures["torque"][name], np.array(figures[name]) * [10.0, 5.0])
        np.testing.assert_allclose(figures["detectable_torque"], np.array(figures["detectable_current"]) * [10.0, 5.0])
    assert result["methods"]["gmo"]["kind"] == "observer"
    # stop and go on a robot with hysteresis: who remembers errs less at rest
    physics, plain = (np.sum(result["methods"][m]["rmse_static"]) for m in ("physics", "coulomb-viscous"))
    assert physics < 0.8 * plain
    assert result["methods"]["physics"]["memory"]
    assert not result["methods"]["coulomb-viscous"]["memory"]
    assert sum(result["frames"]["moving"]) + sum(result["frames"]["static"]) == 2 * result["frames"]["all"]
    assert [p.name for p in compared.parent.iterdir()] == ["out"]


def test_figures_are_those_of_the_predictions_row_for_row(compared, own):
    result = json.loads((compared / "result.json").read_text())
    log = open_log(own / "test.csv", load_robot(own / "robot.toml")).read()
    table = pq.read_table(compared / "predictions" / "test.parquet")
    np.testing.assert_array_equal(table["t"].to_numpy(), log.t)

    def columns(prefix):
        return np.column_stack([table[f"{prefix}{j}"].to_numpy() for j in (1, 2)])

    np.testing.assert_array_equal(columns("i"), log.current)
    for method in ("physics", "coulomb-viscous"):
        error = columns(f"{method}.p") - log.current
        known = np.isfinite(error).all(axis=1)
        assert result["methods"][method]["skipped"] == {"test": int(np.sum(~known))}
        np.testing.assert_allclose(np.sqrt(np.mean(error[known] ** 2, axis=0)), result["methods"][method]["rmse"])
    for method in result["methods"]:
        residual = columns(f"{method}.r")
        rms = np.sqrt(np.nanmean(residual**2, axis=0))
        np.testing.assert_allclose(rms, result["methods"][method]["smoothed"]["rmse"])
    assert "gmo.p1" not in table.schema.names


def test_report_shows_all_methods_and_stands_alone(compared):
    page = (compared / "report.html").read_text()
    for text in ("gmo", "coulomb-viscous", "Smallest detectable [N m]", "Where it is worst", "<b>"):
        assert text in page
    assert page.count("<svg") == 3
    assert re.findall(r'(?:src|href)="(?!#|data:)', page) == []


def test_what_a_finished_run_fitted_is_taken_over_when_asked(compared, own, tmp_path):
    given = [own / "robot.toml", "--train", own / "train.csv", "--test", own / "test.csv", "--out", compared]
    before = json.loads((compared / "models" / "physics" / "fit.json").read_text())
    words = ["--methods", "physics,coulomb-viscous,gmo,disturbance", "--cutoff", 10, "--resume"]
    assert run("compare", *given, *words) == 0
    result = json.loads((compared / "result.json").read_text())
    assert json.loads((compared / "models" / "physics" / "fit.json").read_text()) == before
    assert result["methods"]["physics"]["training_seconds"] == before["seconds"]
    assert "disturbance" in result["methods"]


@pytest.fixture(scope="module")
def virtual(tmp_path_factory):
    """A folder with logs of the VS060, one with contacts, and an identified model."""
    folder = tmp_path_factory.mktemp("virtual")
    robot = VirtualRobot(load_robot("vs060"))
    logs = {
        name: robot.record(named(protocol)(robot.robot, seconds=seconds, seed=seed), seed)
        for name, protocol, seconds, seed in (
            ("whole", "stop_and_go", 120.0, 1), ("free", "stop_and_go", 30.0, 2), ("push", "contact_episodes", 60.0, 3),
        )
    }  # fmt: skip
    logs["train"] = logs["whole"][:4000]
    for name in ("train", "free", "push"):
        write_log(logs[name], folder / f"{name}.parquet")
    effects = [kind(j) for j in range(6) for kind in (Links, MaxwellSlip, Viscous, CurrentOffset)]
    (folder / "known").mkdir()
    save_model(fit(robot.robot, effects, [logs["whole"]], 10.0, Drives(np.ones(6), "%Use")).model, folder / "known")
    return folder


def test_networks_contacts_and_a_model_made_before(virtual, tmp_path):
    given = ["--train", virtual / "train.parquet", "--test", virtual / "free.parquet", virtual / "push.parquet"]
    words = ["--methods", "gmo,rdl-md", "--model", virtual / "known", "--epochs", 1, "--seeds", 2]
    out = tmp_path / "out"
    assert run("compare", "vs060", *given, *words, "--out", out) == 0
    result = json.loads((out / "result.json").read_text())
    assert list(result["methods"]) == ["gmo", "rdl-md", "physics"]
    trained = result["methods"]["rdl-md"]
    both = [one["rmse"] for one in trained["runs"].values()]
    np.testing.assert_allclose(trained["rmse"], np.mean(both, axis=0))
    np.testing.assert_allclose(trained["rmse_spread"], np.std(both, axis=0, ddof=1))
    contact = result["methods"]["gmo"]["contact"]
    assert contact["contacts"] > 0
    assert 0.7 < contact["auroc"] <= 1.0
    assert result["methods"]["gmo"]["threshold_from"] == "logs without contact"
    assert "torque" not in result["methods"]["gmo"]
    names = pq.read_schema(out / "predictions" / "push.parquet").names
    assert {"rdl-md-seed0.p1", "rdl-md-seed1.r6", "physics.p1", "gmo.r1"} <= set(names)
    assert sorted(p.name for p in (out / "models").iterdir()) == ["rdl-md-seed0", "rdl-md-seed1"]
    # errors are of rows that nobody touches
    assert result["frames"]["without_contact"] < result["frames"]["all"]


def test_a_killed_run_goes_on_with_what_it_had_fitted(virtual, tmp_path, monkeypatch):
    from comparisons.comparison import run as running

    given = ["vs060", "--train", virtual / "train.parquet", "--test", virtual / "free.parquet"]
    words = ["--methods", "coulomb-viscous,sigmoid", "--out", tmp_path / "out"]
    scored, real = [], running.score

    def killed(contestant, tests, bandwidth):
        scored.append(contestant.name)
        if contestant.name == "sigmoid" and len(scored) == 2:
            raise KeyboardInterrupt
        return real(contestant, tests, bandwidth)

    monkeypatch.setattr(running, "score", killed)
    assert run("compare", *given, *words) == 130
    assert not (tmp_path / "out").exists()
    (work,) = tmp_path.iterdir()
    fitted = {path: path.stat().st_mtime_ns for path in work.glob("*/model.json")}
    assert len(fitted) == 2
    monkeypatch.setattr("ident.identification.identify", lambda *a, **k: pytest.fail("identified again"))
    assert run("compare", *given, *words) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert set(json.loads((tmp_path / "out" / "result.json").read_text())["methods"]) == {"coulomb-viscous", "sigmoid"}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--methods", "gmo,gm0"], "no method 'gm0', --methods, did you mean gmo?"),
        (["--methods", "coulomb+magic"], "no method 'coulomb+magic'"),
        (["--methods", ","], "no method, --methods"),
        (["--seeds", 0], "seeds of 0, --seeds"),
        (["--bandwidth", -1], "bandwidth of -1"),
        (["--model", "nowhere"], "no model"),
        (["--test", "nowhere.csv"], "no log matches"),
    ],
)
def test_mistakes_are_named_and_leave_nothing(words, told, virtual, tmp_path, capsys):
    given = ["--train", virtual / "train.parquet"]
    if "--test" not in words:
        given += ["--test", virtual / "free.parquet"]
    assert run("compare", "vs060", *given, *words, "--out", tmp_path / "out") == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_methods_by_name_list_and_group():
    assert parse_methods(["gmo,kalman", "gmo"]) == ["gmo", "kalman"]
    assert parse_methods(["all"]) == list(GROUPS["all"])
    assert parse_methods(["coulomb+viscous+load-friction"]) == ["coulomb+viscous+load-friction"]
    assert "hybrid" in GROUPS["all"]
    assert not set(GROUPS["default"]) & set(GROUPS["learned"])


def test_presets_change_what_a_method_suggests():
    assert training_options("hrdl-md", "paper", None, 3, None).seed == 3
    assert training_options("hrdl-md", "paper", None, 0, None).width is None
    quick = training_options("hybrid", "quick", 7, 0, None)
    assert (quick.epochs, quick.width, quick.signal) == (7, 64, "displacement-and-travel")
    with pytest.raises(InputError, match="epochs of 0"):
        Request(("mlp",), epochs=0)


def test_low_pass_is_of_first_order_begins_at_rest_and_holds_over_gaps(virtual):
    log = open_log(virtual / "free.parquet", load_robot("vs060")).read()[:400]
    step = np.zeros((400, 1))
    step[100:] = 1.0
    step[200:210] = np.nan
    passed = low_pass(step, log, 5.0)
    np.testing.assert_array_equal(np.isnan(passed), np.isnan(step))
    np.testing.assert_allclose(passed[100:200, 0], 1.0 - np.exp(-2 * np.pi * 5.0 * np.arange(1, 101) / log.rate))
    assert passed[210, 0] > passed[199, 0]
    np.testing.assert_allclose(low_pass(np.ones((400, 1)), log, 5.0), 1.0)


def test_summary_of_runs():
    runs = {
        "a": {"rmse": np.array([1.0, 2.0]), "n": 3, "missed": 1, "deep": {"late": None}, "kind": "direct"},
        "b": {"rmse": np.array([3.0, 2.0]), "n": 3, "missed": 2, "deep": {"late": 0.5}, "kind": "direct"},
    }
    whole = summary(runs)
    np.testing.assert_allclose(whole["rmse"], [2.0, 2.0])
    np.testing.assert_allclose(whole["rmse_spread"], [np.sqrt(2.0), 0.0])
    assert (whole["n"], whole["missed"], whole["deep"]["late"], whole["kind"]) == (3, 1.5, 0.5, "direct")
    assert summary({"a": runs["a"]}) == runs["a"]
