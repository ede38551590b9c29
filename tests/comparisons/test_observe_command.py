"""``sensorless observe`` on a little of the virtual robot."""

import json

import numpy as np
import pytest

from comparisons import cli
from comparisons.protocols import named
from comparisons.virtual_robot import VirtualRobot
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Viscous
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links
from ident.fit import Drives, fit
from ident.log_writer import write_log
from ident.model_file import save_model
from ident.robot import load_robot
from observers.cusum import Cusum
from observers.residual import Residual


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with an identified model, a log without contact, and one with pushes."""
    folder = tmp_path_factory.mktemp("observe")
    virtual = VirtualRobot(load_robot("vs060"))
    train = virtual.record(named("stop_and_go")(virtual.robot, seconds=120.0, seed=1), 1)
    kinds = (Links, MaxwellSlip, Viscous, CurrentOffset)
    effects = [kind(j) for j in range(6) for kind in kinds]
    model = fit(virtual.robot, effects, [train], 10.0, Drives(np.ones(6), "%Use")).model
    (folder / "model").mkdir()
    save_model(model, folder / "model")
    free = virtual.record(named("stop_and_go")(virtual.robot, seconds=120.0, seed=2), 2)
    write_log(free, folder / "free.parquet")
    write_log(
        virtual.record(named("contact_episodes")(virtual.robot, seconds=60.0, seed=3), 3), folder / "push.parquet"
    )
    return folder


def run(*words):
    with pytest.raises(SystemExit) as exit_:
        cli.main([str(word) for word in words])
    return int(exit_.value.code or 0)


@pytest.mark.parametrize("method", ["direct", "gmo", "kalman", "disturbance", "sliding-mode", "filtered-dynamics"])
def test_observe_writes_residual_result_and_report(method, made, tmp_path, capsys):
    out = tmp_path / "out"
    given = ["--model", made / "model", "--log", made / "push.parquet", "--contact-free", made / "free.parquet"]
    assert run("observe", "vs060", *given, "--out", out, "--method", method) == 0
    result = json.loads((out / "result.json").read_text())
    residual = Residual.load(out / "residual.parquet")
    own = residual.current[residual.good]
    (figures,) = result["logs"]
    np.testing.assert_allclose(figures["rms"], np.sqrt(np.mean(own**2, axis=0)))
    assert residual.unit == result["unit"] == "%Use"
    assert residual.torque is None
    assert figures["flagged"]["missing"] == 0
    assert len(figures["contacts"]) >= 1
    assert all(c["links"] == list(range(c["link"], 7)) for c in figures["contacts"])
    assert "cusum" not in result
    assert np.all(np.array(result["threshold"]["constant"]) < 60.0)
    page = (out / "report.html").read_text()
    assert "Contacts" in page
    assert capsys.readouterr().err == ""


def test_several_logs_moving_thresholds_and_none(made, tmp_path):
    logs = ["--log", made / "push.parquet", made / "free.parquet"]
    given = ["--model", made / "model", *logs, "--contact-free", made / "free.parquet", "--moving"]
    assert run("observe", "vs060", *given, "--out", tmp_path / "a") == 0
    result = json.loads((tmp_path / "a" / "result.json").read_text())
    assert max(result["threshold"]["by_speed"]) > 0.0
    assert sorted(p.name for p in (tmp_path / "a" / "residuals").iterdir()) == ["free.parquet", "push.parquet"]
    words = ["--model", made / "model", "--log", made / "free.parquet", "--out", tmp_path / "b"]
    assert run("observe", "vs060", *words) == 0
    assert "contacts" not in json.loads((tmp_path / "b" / "result.json").read_text())["logs"][0]


def test_cumulative_sums_tell_alarms(made, tmp_path, capsys):
    given = ["--model", made / "model", "--contact-free", made / "free.parquet", "--log", made / "push.parquet"]
    assert run("observe", "vs060", *given, "--out", tmp_path / "out", "--cusum") == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    residual = Residual.load(tmp_path / "out" / "residual.parquet")
    sums = Cusum(*(np.array(result["cusum"][key]) for key in ("allowance", "limit"))).run(residual)
    found = result["logs"][0]["cusum_alarms"]
    assert len(found) >= 1
    for alarm in found:
        rows = (residual.t >= alarm["start"]) & (residual.t <= alarm["end"])
        assert sums[rows].max() > 1.0
        assert alarm["joints"] == (np.flatnonzero((sums[rows] > 1.0).any(axis=0)) + 1).tolist()
    assert f"{len(found)} alarms of the cumulative sums" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("alarm of the cumulative sum<") == 1  # the legend of the plot
    assert "Alarms of the cumulative sums" in page


def test_mistakes_are_named(made, tmp_path, capsys):
    log = ["--log", made / "free.parquet", "--out", tmp_path / "out"]
    assert run("observe", "vs060", "--model", tmp_path / "none", *log) == 2
    assert "no model" in capsys.readouterr().err
    assert run("observe", "vs060", "--model", made / "model", *log, "--bandwidth", "-1") == 2
    assert "bandwidth" in capsys.readouterr().err
    assert run("observe", "vs060", "--model", made / "model", *log, "--method", "magic") == 2
    assert run("observe", "vs060", "--model", made / "model", *log, "--cusum") == 2
    assert "--contact-free" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
