"""The experiments of compliance: their data, their page, and a run in the small."""

import itertools
import json

import numpy as np
import pytest

from comparisons.experiments import compliance as experiment
from comparisons.experiments import compliance_work, task_compliance
from comparisons.experiments.compliance import compliance
from comparisons.experiments.compliance_page import compliance_page
from comparisons.experiments.compliant import POSE, PUSHES
from comparisons.experiments.wrench_data import BREAK, SHARE, STRONGEST, near_pose
from comparisons.virtual_robot import VirtualRobot
from comparisons.virtual_robot.contact import Hand, Push
from ident.robot import load_robot


def test_wrench_data_stay_near_the_pose_and_are_pushed_most_of_the_time():
    robot = load_robot("vs060")
    log = VirtualRobot(robot).record(near_pose(robot, np.array(POSE), 60.0, 3), 3)
    half = 0.5 * (robot.limits.upper - robot.limits.lower)
    assert np.all(np.abs(log.q - POSE) <= SHARE * half + 0.02)
    size = np.linalg.norm(log.wrench[:, :3], axis=1)
    assert 0.8 * STRONGEST < size.max() <= STRONGEST
    assert np.mean(size > 0.0) > 0.6
    free = np.flatnonzero(size == 0.0)
    runs = np.split(free, np.flatnonzero(np.diff(free) > 1) + 1)
    assert max(map(len, runs)) <= 100 * BREAK + 1
    # in all directions
    assert np.all(np.abs(np.sign(log.wrench[size > 10.0, :3]).mean(axis=0)) < 0.9)


def test_pushes_come_one_after_the_other_then_together():
    starts = [push.start for push in PUSHES]
    assert len({push.link for push in PUSHES[:-2]}) >= 5
    assert starts[-1] == starts[-2]
    for one, after in itertools.pairwise(PUSHES[:-1]):
        assert after.start - (one.start + one.duration) > 1.5


@pytest.fixture
def small(monkeypatch):
    """Logs of seconds and short rides."""
    push = Push(2, (0.0, 0.0, 0.3), (90.0, 0.0, 0.0), start=0.6, duration=0.4)
    monkeypatch.setattr(experiment, "FREE_SECONDS", 20.0)
    monkeypatch.setattr(experiment, "PUSHES", (push,))
    monkeypatch.setattr(compliance_work, "EXCITATION", 20.0)
    monkeypatch.setattr(task_compliance, "TOUCHED_SECONDS", 20.0)
    monkeypatch.setattr(task_compliance, "SECONDS", 2.8)
    monkeypatch.setattr(task_compliance, "READY", 0.5)
    monkeypatch.setattr(task_compliance, "HAND", Hand((0.0,), ((0.0, 0.0, 0.1),), stop=0.9))


def test_run_in_the_small_and_its_page(small, tmp_path, capsys):
    options = {"seconds": 60.0, "epochs": 1, "width": 8, "wrench_seconds": 40.0, "wrench_epochs": 1, "wrench_width": 8}
    compliance(out=tmp_path, **options)
    assert capsys.readouterr().out.strip() == str(tmp_path / "compliance.md")
    result = json.loads((tmp_path / "compliance.json").read_text())
    assert list(result["joint"]["deadzone"]) == ["HRDL-MD", "GMO", "GMO, Maxwell slip"]
    assert len(result["joint"]["rides"]) == 4
    for one in result["joint"]["rides"].values():
        assert [episode["links"] for episode in one["episodes"]] == [[2]]
    assert set(result["task"]["rmse_ride"]) == {"compound", "single"}
    assert result["task"]["parameters"]["compound"] == result["task"]["parameters"]["single"]
    page = (tmp_path / "compliance.md").read_text()
    assert page == compliance_page(result)
    for name in ("joint_compliance", "task_compliance"):
        assert f"{name}.png" in page
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
        assert (tmp_path / f"{name}.svg").is_file()
