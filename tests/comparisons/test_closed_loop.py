"""The virtual robot under control: it obeys, it keeps the laws of motion, and it feels pushes and hands."""

from dataclasses import replace

import numpy as np
import pytest

from comparisons.virtual_robot.closed_loop import ClosedLoop, run_closed_loop
from comparisons.virtual_robot.contact import Hand, Push
from comparisons.virtual_robot.robot import VirtualRobot
from comparisons.virtual_robot.scenario import Scenario, load_scenario
from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import Sample
from ident.robot import Robot

START = np.array([0.0, 0.3, 1.0, 0.0, 0.4, 0.0])


@pytest.fixture(scope="module")
def virtual(vs060: Robot) -> VirtualRobot:
    return VirtualRobot(vs060, load_scenario("vs060").without("sensors"))


def hold(sample: Sample) -> FloatArray:
    return np.zeros(6)


def test_links_obey_the_equation_of_motion(vs060: Robot) -> None:
    bare = VirtualRobot(vs060, Scenario.model_validate({"motors": {"gain": 1.0, "inertia": 0.1}}))
    push = Push(link=4, point=(0.0, 0.0, 0.1), force=(10.0, 20.0, 5.0), start=0.2, duration=0.8)

    def swing(sample: Sample) -> FloatArray:
        return np.full(6, 0.5 * np.sin(6.0 * sample.t))

    log = run_closed_loop(bare, swing, 1.2, [push], START, rate=1000.0, derivatives=True)
    assert log.dq is not None
    assert log.ddq is not None
    assert log.tau_ext is not None
    # the torque of a step acts on the state before it
    q, dq, ddq = log.q[:-1], log.dq[:-1], log.ddq[1:]
    asked = bare.rigid_torque(q, dq, ddq) + 0.1 * ddq - log.tau_ext[1:]
    np.testing.assert_allclose(log.current[1:], asked, atol=1e-8)
    np.testing.assert_allclose(np.diff(log.q, axis=0), log.dq[1:] * 1e-3, atol=1e-12)
    assert np.abs(log.tau_ext).max() > 2.0


def test_velocity_and_position_commands_are_followed(virtual: VirtualRobot) -> None:
    speed = np.array([0.3, -0.2, 0.2, 0.5, 0.3, 1.0])
    log = run_closed_loop(virtual, lambda s: speed * (s.t < 1.0), 2.0, start=START, derivatives=True)
    assert log.dq is not None
    np.testing.assert_allclose(log.dq[60:95].mean(axis=0), speed, rtol=0.03)
    np.testing.assert_allclose(log.q[-1], START + speed, atol=0.005)
    goal = START + 0.1
    log = run_closed_loop(virtual, lambda s: START + 0.1 * min(s.t, 1.0), 2.0, start=START, mode="position")
    np.testing.assert_allclose(log.q[-1], goal, atol=1e-3)


def test_current_carries_a_push_that_a_still_joint_holds(virtual: VirtualRobot) -> None:
    push = Push(link=3, point=(0.0, 0.0, 0.1), force=(0.0, 20.0, 0.0), start=1.0, duration=1.5)
    log = run_closed_loop(virtual, hold, 2.4, [push], START)
    assert log.tau_ext is not None
    before, during = log.current[50:95].mean(axis=0), log.current[180:230].mean(axis=0)
    felt = (during - before) * virtual.laws.gain
    assert np.abs(log.tau_ext[200, 0]) > 3.0
    np.testing.assert_allclose(felt[0], -log.tau_ext[200, 0], atol=0.15)
    assert np.abs(log.q - START).max() < 2e-3


def test_arm_yields_to_a_hand_under_admittance(virtual: VirtualRobot) -> None:
    hand = Hand(times=(0.5, 2.0), offsets=((0.0, 0.0, 0.0), (0.0, 0.10, 0.0)), stop=4.0)
    loop = ClosedLoop(virtual, START, disturbances=[hand])
    _, before = virtual.kinematics.jacobian(loop.q, virtual.kinematics.last, virtual.kinematics.tool)
    log = loop.run(lambda sample: 0.05 * loop.tau_ext, 5.0)
    _, after = virtual.kinematics.jacobian(loop.q, virtual.kinematics.last, virtual.kinematics.tool)
    assert log.wrench is not None
    assert 0.06 < (after - before)[1] < 0.12
    assert np.abs(log.wrench[:, 1]).max() > 2.0
    np.testing.assert_array_equal(log.wrench[-1], np.zeros(6))


class Stroke:
    """Moves joint 4 for a second at a speed, then stops."""

    def __init__(self, speed: float) -> None:
        self.speed = speed

    def __call__(self, sample: Sample) -> FloatArray:
        return np.array([0.0, 0.0, 0.0, self.speed if sample.t < 1.0 else 0.0, 0.0, 0.0])


def test_friction_stays_behind_after_a_stop(virtual: VirtualRobot) -> None:
    left = []
    for sign in (1.0, -1.0):
        log = run_closed_loop(virtual, Stroke(0.2 * sign), 2.5, start=START)
        left.append(log.current[-30:, 3].mean())
    coulomb = virtual.laws.friction.coulomb[3] / virtual.laws.gain[3]
    assert 0.5 * coulomb < left[0] - left[1] < 2.6 * coulomb


def test_same_seed_same_run(vs060: Robot) -> None:
    noisy = VirtualRobot(vs060)
    one, two, other = (run_closed_loop(noisy, hold, 0.3, start=START, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.current, two.current)
    assert not np.array_equal(one.current, other.current)


def test_bad_commands_and_soft_joints_are_refused(vs060: Robot, virtual: VirtualRobot) -> None:
    with pytest.raises(InputError, match="give 6 finite values"):
        ClosedLoop(virtual).step(np.zeros(5))
    with pytest.raises(InputError, match="give 6 finite values"):
        ClosedLoop(virtual).step(np.full(6, np.nan))
    soft = VirtualRobot(vs060, load_scenario("quiet").with_effect("elasticity"))
    with pytest.raises(InputError, match="elasticity"):
        ClosedLoop(soft)


def test_coupled_motors_are_refused(vs060: Robot) -> None:
    drive = vs060.card.drive.model_copy(update={"coupling": (np.eye(6) - 0.5 * np.eye(6, k=-1)).tolist()})
    coupled = replace(vs060, card=vs060.card.model_copy(update={"drive": drive}))
    with pytest.raises(InputError, match="coupled motors"):
        ClosedLoop(VirtualRobot(coupled))
