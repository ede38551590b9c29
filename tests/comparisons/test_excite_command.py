"""``sensorless excite``: what it writes, what it takes into account, and how it refuses."""

import json
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import yaml

from comparisons import cli
from ident.log import JointLog
from ident.log_writer import write_log

URDF = """<robot name="arm"><link name="l0"><collision><origin xyz="0 0 0.05"/>
<geometry><cylinder radius="0.1" length="0.1"/></geometry></collision></link>
<link name="l1"><inertial><origin xyz="0.01 0 0.1"/><mass value="4"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.01"/></inertial>
<collision><origin xyz="0 0 0.1"/><geometry><box size="0.1 0.1 0.2"/></geometry></collision></link>
<link name="l2"><inertial><origin xyz="0 0.02 0.2"/><mass value="2"/>
<inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial>
<collision><origin xyz="0 0 0.25"/><geometry><box size="0.06 0.06 0.4"/></geometry></collision></link>
<joint name="pan" type="revolute"><parent link="l0"/><child link="l1"/><axis xyz="0 0 1"/><origin xyz="0 0 0.11"/>
<limit lower="-2" upper="2" velocity="2" effort="50"/></joint>
<joint name="lift" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/><origin xyz="0 0 0.25"/>
<limit lower="-2.5" upper="2.5" velocity="2" effort="50"/></joint></robot>"""
QUICK = ("--period", "4", "--harmonics", "3", "--restarts", "1")


@pytest.fixture(scope="module")
def card(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(URDF)
    (folder / "robot.toml").write_text('name = "arm <1>"\nurdf = "arm.urdf"\n[limits]\nacceleration = [12.0, 12.0]\n')
    return folder / "robot.toml"


def excite(capsys: pytest.CaptureFixture[str], card: Path, out: Path, *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_:
        cli.main(["excite", str(card), "--out", str(out), *QUICK, *words])
    captured = capsys.readouterr()
    return int(exit_.value.code or 0), captured.out, captured.err


def test_writes_waypoints_report_and_view(capsys: pytest.CaptureFixture[str], card: Path, tmp_path: Path) -> None:
    status, out, err = excite(capsys, card, tmp_path / "out", "--rate", "50", "--waypoints", "parquet")
    assert (status, err) == (0, "")
    assert "condition number" in out
    result = json.loads((tmp_path / "out/result.json").read_text())
    assert result["files"] == ["motion.html", "report.html", "result.json", "trajectory.parquet", "trajectory.yaml"]
    assert result["joints"] == ["pan", "lift"]
    assert result["clearance"]["least"] >= 0.02
    assert 1 <= result["links_condition_number"] < result["condition_number"] < 50
    assert all(0 < share <= 1 for shares in result["use"].values() for share in shares)
    table = pyarrow.parquet.read_table(tmp_path / "out/trajectory.parquet")
    t = table["t"].to_numpy()
    angle = 2 * np.pi / result["period"] * np.outer(t, np.arange(1, 4))
    for joint in range(2):
        series = np.sin(angle) @ result["sine"][joint] + np.cos(angle) @ result["cosine"][joint]
        np.testing.assert_allclose(table[f"q{joint + 1}"].to_numpy(), result["mean"][joint] + series, atol=1e-9)
    message = yaml.safe_load((tmp_path / "out/trajectory.yaml").read_text())
    assert len(message["points"]) == len(t) == 201
    assert message["points"][-1]["velocities"] == pytest.approx([0.0, 0.0], abs=1e-8)


def test_pages_open_offline(capsys: pytest.CaptureFixture[str], card: Path, tmp_path: Path) -> None:
    excite(capsys, card, tmp_path / "out")
    view = (tmp_path / "out/motion.html").read_text()
    assert "<title>Excitation of arm &lt;1></title>" in view
    assert "http" not in view
    scene = json.loads(view.split('type="application/json" id="scene">')[1].split("</script>")[0])
    assert [body["joint"] for body in scene["bodies"]] == [-1, 0, 1]
    assert len(scene["poses"]) == len(scene["times"]) == len(scene["path"])
    box = np.array(scene["bodies"][1]["points"])
    faces = np.array(scene["bodies"][1]["faces"])
    normal = np.cross(box[faces[:, 1]] - box[faces[:, 0]], box[faces[:, 2]] - box[faces[:, 0]])
    assert np.all(np.einsum("ij,ij->i", normal, box[faces[:, 0]] - box.mean(axis=0)) > 0)
    report = (tmp_path / "out/report.html").read_text()
    assert report.count("<svg") == 5
    assert 'src="http' not in report


def test_given_logs_count(capsys: pytest.CaptureFixture[str], card: Path, tmp_path: Path) -> None:
    excite(capsys, card, tmp_path / "first")
    first = json.loads((tmp_path / "first/result.json").read_text())
    table = pyarrow.csv.read_csv(tmp_path / "first/trajectory.csv")
    q = np.column_stack([table["q1"].to_numpy(), table["q2"].to_numpy()])
    write_log(JointLog(table["t"].to_numpy(), q, np.zeros_like(q)), tmp_path / "taken.parquet")
    status, _, _ = excite(capsys, card, tmp_path / "second", "--given", str(tmp_path / "taken.parquet"))
    second = json.loads((tmp_path / "second/result.json").read_text())
    assert status == 0
    assert second["log_det"] > first["log_det"] + 1.0


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--rate", "3"), "give at least 7.5 Hz"),
        (("--waypoints", "xlsx"), "no format 'xlsx'"),
        (("--objective", "beauty"), "no objective 'beauty'"),
        (("--ground", "2"), "the ground are too close"),
        (("--box", "-1", "-1", "0", "1", "1", "-2"), "box from"),
        (("--torque-share", "1e-6"), "torque limit of joint 2"),
        (("--model", "nowhere"), "no model"),
    ],
)
def test_refuses_in_one_line(
    capsys: pytest.CaptureFixture[str], card: Path, tmp_path: Path, words: tuple[str, ...], text: str
) -> None:
    status, _, err = excite(capsys, card, tmp_path / "out", *words)
    assert status == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert text in err
    assert not (tmp_path / "out").exists()
