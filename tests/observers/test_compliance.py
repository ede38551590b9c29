"""Deadzone and admittance laws, and the virtual arm yielding to pushes on nothing but its currents."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comparisons.protocols import named
from comparisons.virtual_robot.closed_loop import run_closed_loop
from comparisons.virtual_robot.contact import Push
from comparisons.virtual_robot.robot import VirtualRobot
from comparisons.virtual_robot.scenario import load_scenario
from ident.arrays import FloatArray
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Viscous
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links
from ident.errors import InputError
from ident.fit import Drives, fit
from ident.log import Sample
from ident.model import CurrentModel
from ident.robot import Robot
from observers.compliance import JointAdmittance, TaskAdmittance
from observers.deadzone import VS060_CURRENT, Deadzone
from observers.momentum import MomentumObserver

POSE = np.array([0.0, 0.3, 1.0, 0.0, 0.4, 0.0])


def test_deadzone_of_the_paper() -> None:
    zone = Deadzone.vs060()
    np.testing.assert_array_equal(zone.boundary, VS060_CURRENT)
    inside, outside = zone.boundary - 0.5 * zone.band, zone.boundary + 0.5 * zone.band
    np.testing.assert_array_equal(zone.apply(inside), np.zeros(6))
    np.testing.assert_allclose(zone.apply(-outside), -outside)
    np.testing.assert_allclose(zone.apply(zone.boundary), 0.5 * outside)
    np.testing.assert_allclose(zone.apply(2.0 * outside), 2.0 * outside)


@given(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
def test_deadzone_is_odd_continuous_and_grows(x: float, y: float) -> None:
    zone = Deadzone.of((6.0,))
    low, high = zone.apply(np.array([min(x, y)])), zone.apply(np.array([max(x, y)]))
    assert low[0] <= high[0]
    assert high[0] - low[0] <= 2.5 * abs(x - y) + 1e-9
    np.testing.assert_allclose(zone.apply(np.array([-x])), -zone.apply(np.array([x])))


def test_deadzone_refuses_a_band_wider_than_itself() -> None:
    with pytest.raises(InputError, match="deadzone"):
        Deadzone(np.ones(2), np.full(2, 2.5))
    sharp = Deadzone(np.ones(2), np.zeros(2))
    np.testing.assert_array_equal(sharp.apply(np.array([0.99, 1.01])), [0.0, 1.01])


def test_admittance_yields_and_keeps_limits(vs060: Robot) -> None:
    law = JointAdmittance(0.02, Deadzone.vs060(), vs060.limits)
    push = np.array([20.0, -20.0, 3.0, 500.0, 0.0, 0.0])
    for _ in range(100):
        command = law.step(POSE, push)
    np.testing.assert_allclose(command[:3], [0.4, -0.4, 0.0], atol=1e-6)
    np.testing.assert_allclose(command[3], 0.2 * vs060.limits.velocity[3])
    at_end = POSE.copy()
    at_end[0] = vs060.limits.upper[0] - 0.05
    assert law.step(at_end, push)[0] <= 1e-12
    for _ in range(100):
        away = law.step(at_end, -push)
    np.testing.assert_allclose(away[:2], [-0.4, 0.4], atol=1e-6)
    assert np.all(law.step(POSE, np.full(6, np.nan)) == 0.0)
    with pytest.raises(InputError, match="built in"):
        JointAdmittance(-0.02, Deadzone.vs060(), vs060.limits)


def test_tool_yields_along_the_force_and_keeps_its_orientation(vs060: Robot) -> None:
    law = TaskAdmittance(vs060, 0.005, Deadzone.of((4.0, 4.0, 4.0)))
    pose = POSE + 0.1
    speed = law.step(pose, np.array([0.0, 20.0, -10.0, 1.0, 1.0, 1.0]))
    twist = vs060.multibody.frame_jacobian(pose) @ speed
    np.testing.assert_allclose(twist, [0.0, 0.1, -0.05, 0.0, 0.0, 0.0], atol=2e-3)
    np.testing.assert_array_equal(law.step(pose, np.array([2.0, 2.0, 2.0, 0.0, 0.0, 0.0])), np.zeros(6))
    strong = law.step(pose, np.array([0.0, 2000.0, -1000.0, 0.0, 0.0, 0.0]))
    moved = vs060.multibody.frame_jacobian(pose) @ strong
    assert np.linalg.norm(moved[:3]) <= 0.2501
    assert np.all(np.abs(strong) <= 0.2 * vs060.limits.velocity + 1e-12)
    np.testing.assert_allclose(moved[1] / moved[2], -2.0, rtol=0.05)


class Compliant:
    """Moves every joint to and fro for a second, so that the friction it starts with is known; then it yields."""

    def __init__(self, observer: MomentumObserver, law: JointAdmittance) -> None:
        self.observer, self.law = observer, law

    def __call__(self, sample: Sample) -> FloatArray:
        command = self.law.step(sample.q, self.observer.step(sample))
        return command if sample.t >= 1.0 else np.full(6, 0.3 * np.sin(2.0 * np.pi * sample.t))


@pytest.fixture(scope="module")
def virtual(vs060: Robot) -> VirtualRobot:
    return VirtualRobot(vs060, load_scenario("vs060"))


@pytest.fixture(scope="module")
def model(virtual: VirtualRobot) -> CurrentModel:
    """Identified in currents, drive gains unknown, from four minutes of stop-and-go motion."""
    log = virtual.record(named("stop_and_go")(virtual.robot, seconds=240.0, seed=1), 1)
    kinds = (Links, MaxwellSlip, Viscous, CurrentOffset)
    effects = [kind(j) for j in range(6) for kind in kinds]
    return fit(virtual.robot, effects, [log], 10.0, Drives(np.ones(6), virtual.robot.unit)).model


UPPER_ARM = Push(link=2, point=(0.0, 0.0, 0.3), force=(0.0, 80.0, 0.0), start=2.0, duration=2.0)
FOREARM = Push(link=3, point=(0.0, 0.0, 0.25), force=(60.0, 0.0, 0.0), start=2.0, duration=2.0)
WRIST = Push(link=5, point=(0.0, 0.0, 0.05), force=(30.0, 0.0, 0.0), start=2.0, duration=2.0)
HAND = Push(link=6, point=(0.0, 0.0, 0.05), force=(0.0, 40.0, 20.0), start=2.0, duration=2.0)


@pytest.mark.parametrize(
    "pushes",
    [[UPPER_ARM], [FOREARM], [WRIST], [HAND], [UPPER_ARM, HAND], []],
    ids=["upper arm", "forearm", "wrist", "hand", "two at once", "none"],
)
def test_arm_yields_to_pushes_and_stops_when_released(
    pushes: list[Push], virtual: VirtualRobot, model: CurrentModel
) -> None:
    observer = MomentumObserver(model, 3.0)
    law = JointAdmittance(0.02, Deadzone.of(1.3 * np.array(VS060_CURRENT)), virtual.robot.limits)
    log = run_closed_loop(virtual, Compliant(observer, law), 6.0, pushes, POSE)
    before, held, released, end = (log.q[row] for row in (198, 395, 480, 599))
    moved = 0.0
    for push in pushes:
        places = []
        for q in (before, held):
            turn, origin = virtual.robot.multibody.frame_pose(q, f"joint_{push.link}")
            places.append(origin + turn @ np.array(push.point))
        along = (places[1] - places[0]) @ np.array(push.force) / np.linalg.norm(push.force)
        assert along > 0.01
        moved += along
    assert (moved > 0.0) == bool(pushes)
    np.testing.assert_allclose(end, released, atol=1e-3)
    if not pushes:
        np.testing.assert_allclose(end, before, atol=1e-3)


def test_the_sign_matters(virtual: VirtualRobot, model: CurrentModel) -> None:
    """The law as the paper writes it, dq = Kp (y - y_est), pushes back."""
    observer = MomentumObserver(model, 3.0)
    law = JointAdmittance(0.02, Deadzone.of(1.3 * np.array(VS060_CURRENT)), virtual.robot.limits)

    def as_written(sample: Sample) -> FloatArray:
        return law.step(sample.q, -observer.step(sample))

    log = run_closed_loop(virtual, as_written, 3.5, [FOREARM], POSE)
    assert log.tau_ext is not None
    assert log.tau_ext[300, 1] > 5.0
    assert log.q[345, 1] - log.q[195, 1] < -0.01
