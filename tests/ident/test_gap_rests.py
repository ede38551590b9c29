"""Joints that stick: what dry friction holds while they stand bends no fit, hides no effect and is none."""

import numpy as np
import pytest

from ident.gap import baseline_model, find_gap
from ident.gap.rests import no_rests
from ident.gap.rows import panel_of
from ident.log import JointLog
from ident.robot import load_robot

ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz=".25 0 0"/><mass value="4"/>
<inertia ixx=".02" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz=".2 0 0"/><mass value="2"/>
<inertia ixx=".01" iyy=".05" izz=".05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="90"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz=".5 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="50"/></joint></robot>"""
RATE, NOISE, DRY = 100.0, 0.08, np.array([1.5, 0.8])
MOVE, STOP = 1.6, 0.8  # seconds


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(ARM)
    (folder / "robot.toml").write_text('name = "arm"\nurdf = "arm.urdf"\ncurrent_unit = "A"\n')
    return load_robot(folder / "robot.toml")


def record(arm, seed, hidden=None, held=1.0, hum=0.0, moves=28):
    """Point-to-point moves; while the arm stands its friction holds a level drawn anew (times ``held``), or hums."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(moves * (MOVE + STOP) * RATE)) / RATE
    number, phase = np.divmod(t, MOVE + STOP)
    x = np.clip(phase / MOVE, 0.0, 1.0)
    points = np.cumsum(rng.choice([-1.0, 1.0], (moves + 1, 2)) * rng.uniform(0.2, 0.9, (moves + 1, 2)), axis=0)
    points = 1.6 * np.sin(points)
    first, step = points[number.astype(int)], np.diff(points, axis=0)[number.astype(int)]
    q = first + step * (x**3 * (10 - 15 * x + 6 * x**2))[:, None]
    dq = step * (30 * x**2 * (1 - x) ** 2 / MOVE)[:, None]
    ddq = step * (60 * x * (1 - x) * (1 - 2 * x) / MOVE**2)[:, None]
    stands = (phase >= MOVE)[:, None]
    levels = rng.uniform(-1.0, 1.0, (moves, 2))[number.astype(int)]
    friction = np.where(stands, held * levels * DRY, DRY * np.tanh(dq / 2e-3))
    torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
    torque += friction + np.array([1.0, 0.5]) * dq + NOISE * rng.standard_normal(q.shape)
    torque += stands * hum * np.sin(2 * np.pi * 3.3 * t)[:, None]
    if hidden is not None:
        torque[:, 1] += hidden(q, dq, stands[:, 0])
    return JointLog(t=t, q=q, current=torque, name=f"log{seed}")


def logs(arm, **options):
    return [record(arm, seed, **options) for seed in (1, 2, 3)]


def found_in(arm, **options):
    train = logs(arm, **options)
    return find_gap(baseline_model(arm, train), train, [record(arm, 9, **options)])


def test_what_friction_holds_at_rest_is_left_out_and_bends_nothing(arm):
    found = found_in(arm)
    assert found.rests == (0, 1)
    assert found.findings == ()
    assert found.unexplained == ()
    assert np.all(found.evidence.after > 2.0 * NOISE)
    np.testing.assert_allclose(found.evidence.moving[-1], NOISE, rtol=0.1)


def test_an_effect_is_named_beside_rests_eight_times_the_noise(arm):
    found = found_in(arm, hidden=lambda q, dq, stands: 0.25 * np.sign(dq[:, 1]) * np.exp(-np.abs(dq[:, 1]) / 0.06))
    assert [(one.effect, one.joints) for one in found.findings] == [("stribeck", (1,))]


def test_rests_that_nothing_holds_count(arm):
    found = found_in(arm, held=0.0)
    assert found.rests == ()
    assert found.findings == ()


def test_a_drive_that_hunts_at_rest_is_unexplained_and_not_left_out(arm):
    found = found_in(arm, held=0.0, hum=0.5)
    assert found.rests == ()
    assert {one.joints for one in found.unexplained} == {(0,), (1,)}


def test_rests_that_remember_where_the_joint_came_from_count(arm):
    def kept(q, dq, stands):
        # Dahl's law instead of the sign of velocity: at rest it stays.
        z = np.zeros(len(q))
        for k, step in enumerate(np.diff(q[:, 1]) / 1e-3, start=1):
            z[k] = np.sign(step) + (z[k - 1] - np.sign(step)) * np.exp(-abs(step))
        return DRY[1] * (z - np.where(stands, 0.0, np.tanh(dq[:, 1] / 2e-3)))

    found = found_in(arm, held=0.0, hidden=kept)
    assert found.rests == ()
    assert [(one.effect, one.joints) for one in found.findings] == [("maxwell-slip", (1,))]


def test_no_rests_leave_every_row(arm):
    panel = panel_of(baseline_model(arm, logs(arm)), logs(arm))
    assert panel.gather(no_rests(2).counts).all()
