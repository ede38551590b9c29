"""The virtual robot: its links against MuJoCo, its friction's memory, its determinism."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from comparisons.protocols import named
from comparisons.protocols.excitation import fourier, sinusoid
from comparisons.virtual_robot.closed_loop import run_closed_loop
from comparisons.virtual_robot.kinematics import Kinematics
from comparisons.virtual_robot.motion import ReferenceBlock
from comparisons.virtual_robot.robot import VirtualRobot, simulate
from comparisons.virtual_robot.scenario import Friction, Scenario, load_scenario
from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import JointLog, concatenate
from ident.robot import Robot, load_robot

BARE = Scenario.model_validate({"links": {"spread": 0.0}, "motors": {"gain": 1.0, "inertia": 0.0}})


def run(virtual: VirtualRobot, q: FloatArray, rows: int = 2048, seed: int = 0) -> JointLog:
    return concatenate(list(virtual.simulate([ReferenceBlock(q)], seed=seed, rows=rows)))


def test_links_are_those_of_mujoco(vs060: Robot) -> None:
    urdf = Path(__file__).parents[2] / "ident" / "robots" / "vs060" / "vs060.urdf"
    model = mujoco.MjModel.from_xml_path(str(urdf))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.dof_armature[:] = 0.0
    data = mujoco.MjData(model)
    log = VirtualRobot(vs060, BARE).record(fourier(vs060, seconds=10.0, seed=3), derivatives=True)
    assert log.dq is not None
    assert log.ddq is not None
    for row in range(100, len(log), 97):
        data.qpos[:], data.qvel[:], data.qacc[:] = log.q[row], log.dq[row], log.ddq[row]
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(log.current[row], data.qfrc_inverse, rtol=1e-6, atol=1e-6)


@pytest.fixture
def coupled(vs060: Robot) -> Robot:
    """The robot with motors 5 and 6 coupled."""
    wrist = np.eye(6)
    wrist[5, 4] = -0.7
    drive = vs060.card.drive.model_copy(update={"coupling": wrist.tolist()})
    return replace(vs060, card=vs060.card.model_copy(update={"drive": drive}))


def test_coupled_motors_give_the_joints_power(vs060: Robot, coupled: Robot) -> None:
    plain, wrist = (
        VirtualRobot(r, BARE).record(fourier(r, seconds=4.0, seed=3), derivatives=True) for r in (vs060, coupled)
    )
    assert wrist.dq is not None
    speeds = wrist.dq.copy()
    speeds[:, 5] -= 0.7 * wrist.dq[:, 4]
    np.testing.assert_allclose(
        np.sum(wrist.current * speeds, axis=1), np.sum(plain.current * wrist.dq, axis=1), atol=1e-9
    )
    assert np.abs(wrist.current - plain.current)[:, 4].max() > 1e-3  # the last link alone


def test_friction_of_coupled_motors_follows_their_own_motion(coupled: Robot) -> None:
    rubbed = BARE.model_copy(update={"friction": Friction(coulomb=1.0, viscous=0.0)})
    q = np.zeros((400, 6))
    q[:, 4] = 0.2 * np.sin(np.linspace(0.0, 6.0, 400))
    with_friction, without = (run(VirtualRobot(coupled, s), q) for s in (rubbed, BARE))
    lost = (with_friction.current - without.current)[100:]
    assert np.abs(lost[:, 5]).max() > 0.5
    assert np.corrcoef(lost[:, 5], lost[:, 4])[0, 1] < -0.9


def test_same_seed_same_log_whatever_the_blocks(vs060: Robot) -> None:
    q = np.concatenate([block.q for block in sinusoid(vs060, seconds=12.0, seed=2).blocks()])
    virtual = VirtualRobot(vs060)
    whole, pieces, other = run(virtual, q), run(virtual, q, rows=77), run(virtual, q, seed=1)
    np.testing.assert_array_equal(whole.q, pieces.q)
    np.testing.assert_array_equal(whole.current, pieces.current)
    np.testing.assert_array_equal(whole.t, pieces.t)
    assert not np.array_equal(whole.current, other.current)


def stop_after(vs060: Robot, joint: int, direction: float) -> FloatArray:
    """Move one joint by 0.2 rad in one direction to a common place, and rest for 2 s."""
    q = np.tile([0.0, 0.3, 1.0, 0.0, 0.0, 0.0], (400, 1))
    q[:200, joint] += direction * 0.2 * (np.linspace(0.0, 1.0, 200) - 1.0)
    return q


@pytest.mark.parametrize("joint", range(6))
def test_current_at_rest_remembers_the_last_direction(vs060: Robot, joint: int) -> None:
    virtual = VirtualRobot(vs060)
    after = {d: run(virtual, stop_after(vs060, joint, d)).current[-100:, joint].mean() for d in (1.0, -1.0)}
    coulomb = virtual.laws.friction.coulomb[joint] / virtual.laws.gain[joint]
    assert 0.4 * coulomb < after[1.0] - after[-1.0] < 2.6 * coulomb


def test_joint_4_loses_stored_friction_when_joints_2_and_3_move(vs060: Robot) -> None:
    still = np.tile(stop_after(vs060, 3, 1.0)[-1], (600, 1))
    swing = still.copy()
    wave = 0.4 * np.sin(np.linspace(0.0, np.pi, 400)) ** 2
    swing[:400, 1] += wave
    swing[:400, 2] -= wave

    def stored(virtual: VirtualRobot, tail: FloatArray) -> float:
        """Difference of the current at rest between the two directions of the last motion."""
        motions = [np.concatenate([stop_after(vs060, 3, d), tail]) for d in (1.0, -1.0)]
        up, down = (run(virtual, q).current[-100:, 3].mean() for q in motions)
        return float(up - down)

    before, after = stored(VirtualRobot(vs060), still), stored(VirtualRobot(vs060), swing)
    assert before > 10.0
    assert abs(after) < 0.4 * before
    without = VirtualRobot(vs060, load_scenario("vs060").without("cross-joint-hysteresis"))
    assert stored(without, swing) > 0.8 * before


def test_velocity_rings_when_a_joint_stops(vs060: Robot) -> None:
    virtual = VirtualRobot(vs060, load_scenario("vs060").without("sensors"))
    log = run(virtual, stop_after(vs060, 0, 1.0))
    speed = np.diff(log.q[:, 0]) * 100.0
    stop = 203
    assert -0.05 < speed[stop:].min() < -0.003
    assert np.abs(speed[-50:]).max() < 1e-4


def test_simulate_in_one_line_tells_the_truth(vs060: Robot) -> None:
    log, truth = simulate(vs060, protocol="sinusoid", seconds=5.0, seed=1)
    assert log.q.shape == (500, 6)
    assert log.dq is None
    assert log.tau_ext is None
    assert truth["link_parameters"].shape == (60,)
    assert np.abs(truth["link_parameters"][::10] / vs060.multibody.parameters[::10] - 1.0).max() > 0.01
    np.testing.assert_array_equal(truth["effects"]["gear-ripple"]["per_turn"], np.full(6, 2.0))
    np.testing.assert_allclose(truth["effects"]["maxwell-slip"]["slip"], np.full(6, 0.003))
    np.testing.assert_allclose(truth["gain"], [0.71, 0.81, 0.403, 0.112, 0.144, 0.076])


def test_unknown_keys_and_wrong_lengths_are_refused(vs060: Robot, tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[friction]\ncolumb = 1.0\n")
    with pytest.raises(InputError, match="columb"):
        load_scenario(bad)
    with pytest.raises(InputError, match="unknown key 'gear_rattle'"):
        load_scenario("quiet").with_effect("gear-rattle")
    with pytest.raises(InputError, match=r"friction\.stribeck_speed: Input should be greater than 0"):
        load_scenario("quiet").with_effect("friction", stribeck_speed=0.0)
    with pytest.raises(InputError, match="2 values where the robot has 6 joints"):
        VirtualRobot(vs060, load_scenario("quiet").with_effect("friction", coulomb=(1.0, 2.0)))
    with pytest.raises(InputError, match="count joints from 1 to 6"):
        VirtualRobot(vs060, load_scenario("quiet").with_effect("cogging", joints=(7,)))


def card(folder: Path, urdf: Path, joints: list[str] | None = None) -> Robot:
    listed = "" if joints is None else f"joints = {joints}\n".replace("'", '"')
    (folder / "robot.toml").write_text(f'name = "some"\nurdf = "{urdf}"\n{listed}')
    return load_robot(folder / "robot.toml")


@pytest.fixture(params=["panda", "ur10", "gantry"])
def some_robot(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    urdf_path: Callable[[str], Path],
    arm_joints: Callable[[str], list[str] | None],
) -> Robot:
    if request.param != "gantry":
        return card(tmp_path, urdf_path(request.param), arm_joints(request.param))
    body = '<inertial><mass value="4"/><inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>'
    limit = '<limit lower="-0.4" upper="0.4" velocity="1" effort="300"/>'
    joints = [
        f'<joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/><child link="l{k}"/><axis xyz="{axis}"/>'
        f'{limit}</joint><link name="l{k}">{body}</link>'
        for k, kind, axis in ((1, "prismatic", "1 0 0"), (2, "prismatic", "0 0 1"), (3, "revolute", "0 1 0"))
    ]
    urdf = tmp_path / "gantry.urdf"
    urdf.write_text(f'<robot name="gantry"><link name="l0"/>{"".join(joints)}</robot>')
    return card(tmp_path, urdf)


def test_any_robot_runs_both_ways(some_robot: Robot) -> None:
    virtual = VirtualRobot(some_robot)
    log = virtual.record(named("stop_and_go")(some_robot, seconds=20.0, seed=1), seed=1)
    assert np.all(np.isfinite(log.current))
    assert np.all(np.abs(log.current).max(axis=0) < 30.0)
    assert np.all(log.current.std(axis=0) > 0.05)
    start = log.q[0]
    loop = run_closed_loop(virtual, lambda sample: np.full(some_robot.n, 0.05), 1.0, start=start)
    np.testing.assert_allclose(loop.q[-1] - start, 0.05, atol=0.01)


def test_jacobians_are_those_of_pinocchio(some_robot: Robot, rng: np.random.Generator) -> None:
    kinematics = Kinematics(some_robot.multibody)
    for _ in range(5):
        q = rng.uniform(-0.4, 0.4, some_robot.n)
        jacobian, place = kinematics.jacobian(q, kinematics.last, kinematics.tool)
        np.testing.assert_allclose(place, some_robot.multibody.frame_pose(q)[1], atol=1e-12)
        np.testing.assert_allclose(jacobian, some_robot.multibody.frame_jacobian(q), atol=1e-12)
