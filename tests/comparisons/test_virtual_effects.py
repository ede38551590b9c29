"""Each effect of a scenario changes the current in the way its name says, and no other joint than those it names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest

from comparisons.protocols.excitation import sinusoid
from comparisons.virtual_robot.motion import ReferenceBlock
from comparisons.virtual_robot.robot import VirtualRobot
from comparisons.virtual_robot.scenario import Scenario, load_scenario
from ident.arrays import FloatArray
from ident.log import JointLog, concatenate
from ident.robot import Robot

QUIET = load_scenario("vs060").without(
    "load-friction", "coulomb-asymmetry", "position-friction", "viscous-nonlinear", "cross-joint-hysteresis",
    "gear-ripple", "sensors",
)  # fmt: skip


@dataclass
class Case:
    """A motion recorded without and with an effect."""

    before: JointLog
    after: JointLog
    virtual: VirtualRobot

    @property
    def change(self) -> FloatArray:
        """Current with the effect less current without, (N, n)."""
        change: FloatArray = self.after.current - self.before.current
        return change

    @cached_property
    def dq(self) -> FloatArray:
        """True velocities, (N, n)."""
        assert self.after.dq is not None
        return self.after.dq

    @cached_property
    def torque(self) -> FloatArray:
        """What the links ask, (N, n)."""
        assert self.after.ddq is not None
        return self.virtual.rigid_torque(self.after.q, self.dq, self.after.ddq)


def record(robot: Robot, scenario: Scenario, q: FloatArray | None = None) -> tuple[VirtualRobot, JointLog]:
    virtual = VirtualRobot(robot, scenario)
    motion = sinusoid(robot, seconds=40.0, seed=4)
    blocks = motion.blocks() if q is None else [ReferenceBlock(q)]
    return virtual, concatenate(list(virtual.simulate(blocks, derivatives=True)))


def alike(a: FloatArray, b: FloatArray) -> float:
    """Correlation of two signals."""
    return float(np.corrcoef(a, b)[0, 1])


def payload(case: Case) -> None:
    rest = slice(0, 50)
    gain = case.virtual.laws.gain
    assert np.abs(case.change[rest, 1:3].mean(axis=0) * gain[1:3]).max() > 1.0
    assert np.abs(case.change[rest, 0]).max() < 1e-6


def base_tilt(case: Case) -> None:
    assert np.abs(case.change[:50, 0].mean()) > 0.1  # an upright first joint carries no weight


def cable_spring(case: Case) -> None:
    cable = case.virtual.laws.cable
    assert cable is not None
    bend = (case.after.q[:, 2] - cable.neutral[2]) / cable.reach[2]
    assert alike(case.change[:, 2], np.sinh(bend)) > 0.9999
    assert alike(case.change[:, 2], bend) < 0.99999


def gravity_balancer(case: Case) -> None:
    weight = case.virtual.rigid_torque(case.after.q, 0 * case.dq, 0 * case.dq)[:, 1]
    assert alike(case.change[:, 1], -weight) > 0.8
    assert np.abs(case.change[:, [0, 2, 3, 4, 5]]).max() < 1e-9


def ripple(per_turn: float, joint: int) -> Callable[[Case], None]:
    def check(case: Case) -> None:
        phase = per_turn * case.virtual.laws.gear_ratio[joint] * case.after.q[:, joint]
        basis = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        slow = np.abs(case.dq[:, joint]) < 0.05  # the drive's own smoothing does not show there
        signal = case.change[slow, joint]
        fitted = basis[slow] @ np.linalg.lstsq(basis[slow], signal, rcond=None)[0]
        assert np.var(signal - fitted) < 0.2 * np.var(signal)

    return check


def torque_saturation(case: Case) -> None:
    excess = case.change[:, 1] / case.before.current[:, 1]
    small, large = np.abs(case.before.current[:, 1]) < 10.0, np.abs(case.before.current[:, 1]) > 40.0
    assert np.median(excess[small]) < 0.02
    assert np.median(excess[large]) > 0.03


def drive_gain(case: Case) -> None:
    np.testing.assert_allclose(case.after.current * 1.1, case.before.current, atol=1e-9)


def current_offset(case: Case) -> None:
    np.testing.assert_allclose(case.change, np.tile([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], (len(case.change), 1)), atol=1e-9)


def sensor_drift(case: Case) -> None:
    np.testing.assert_allclose(case.change[:, 3], case.after.t * 36.0 / 3600.0, atol=1e-9)


def delay(case: Case) -> None:
    np.testing.assert_allclose(case.after.current[3:], case.before.current[:-3], atol=1e-9)


def filter_lag(case: Case) -> None:
    slope = np.gradient(case.before.current[:, 1], case.before.t)
    assert alike(case.change[:, 1], -slope) > 0.8
    assert np.std(np.diff(case.after.current[:, 1])) < np.std(np.diff(case.before.current[:, 1]))


def coulomb_asymmetry(case: Case) -> None:
    fast = np.abs(case.dq[:, 0]) > 0.1
    assert case.change[fast, 0].min() > 0.0  # a larger loss forwards and a smaller one backwards


def position_friction(case: Case) -> None:
    law = case.virtual.laws.friction
    fast = np.abs(case.dq[:, 3]) > 0.1
    swing = np.cos(case.after.q[fast, 3] - law.phase[3]) * np.sign(case.dq[fast, 3])
    assert alike(case.change[fast, 3], swing) > 0.9


def load_friction(case: Case) -> None:
    fast = np.abs(case.dq[:, 1]) > 0.1
    loss = case.change[fast, 1] * np.sign(case.dq[fast, 1])
    assert loss.min() > -0.2
    assert alike(loss, np.abs(case.torque[fast, 1])) > 0.9


def viscous_nonlinear(case: Case) -> None:
    saved = -case.change[:, 0] * np.sign(case.dq[:, 0])
    fast, slow = np.abs(case.dq[:, 0]) > 0.7, np.abs(case.dq[:, 0]) < 0.1
    assert saved[fast].min() > 3.0 * np.abs(saved[slow]).max()


def thermal_friction(case: Case) -> None:
    saved = -case.change[:, 0] * np.sign(case.dq[:, 0])
    fast = np.abs(case.dq[:, 0]) > 0.2
    early, late = fast & (case.after.t < 8.0), fast & (case.after.t > 25.0)
    assert saved[late].mean() > 1.5 * saved[early].mean() > 0.0


def cross_joint_friction(case: Case) -> None:
    part = case.dq[:, 4] + case.dq[:, 5]
    assert alike(case.change[:, 4], np.sign(part)) > 0.8
    np.testing.assert_allclose(case.change[:, 4] * 0.144, case.change[:, 5] * 0.076, atol=1e-9)


def elasticity(case: Case) -> None:
    soft = 4000.0
    still = slice(20, 60)
    weight = case.virtual.rigid_torque(case.after.q[still], 0 * case.dq[still], 0 * case.dq[still])
    hanging = case.after.q[still] - weight / soft * (np.arange(6) == 1)
    lower = case.virtual.rigid_torque(hanging, 0 * case.dq[still], 0 * case.dq[still])
    np.testing.assert_allclose(case.change[still, 1] * 0.81, (lower - weight)[:, 1], atol=1e-6)
    assert np.std(case.change[300:-300, 1]) > 0.0


def backlash(case: Case) -> None:
    near = np.abs(case.torque[:, 3]) < 0.05  # the flanks change where the torque passes through zero
    assert np.mean(case.change[near, 3] ** 2) > 2.0 * np.mean(case.change[~near, 3] ** 2)


CASES: list[tuple[str, dict[str, object], Callable[[Case], None]]] = [
    ("payload", {"mass": 2.0}, payload),
    ("base-tilt", {"roll": 0.05, "pitch": 0.03}, base_tilt),
    ("cable-spring", {"joints": (3,)}, cable_spring),
    ("gravity-balancer", {}, gravity_balancer),
    ("gear-ripple", {"joints": (1,), "per_turn": 2.0, "load": 0.0}, ripple(2.0, 0)),
    ("cogging", {"joints": (4,), "per_turn": 4.0}, ripple(4.0, 3)),
    ("torque-saturation", {"joints": (2,)}, torque_saturation),
    ("drive-gain", {"factor": 1.1}, drive_gain),
    ("current-offset", {"offset": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)}, current_offset),
    ("sensor-drift", {"per_hour": 36.0}, sensor_drift),
    ("delay", {"seconds": 0.03}, delay),
    ("filter-lag", {"hertz": 3.0}, filter_lag),
    ("coulomb-asymmetry", {"joints": (1,)}, coulomb_asymmetry),
    ("position-friction", {"joints": (4,), "share": 0.2}, position_friction),
    ("load-friction", {"joints": (2,)}, load_friction),
    ("viscous-nonlinear", {"joints": (1,)}, viscous_nonlinear),
    ("thermal-friction", {"joints": (1,), "seconds": 20.0}, thermal_friction),
    ("cross-joint-friction", {"pairs": ((5, 6),)}, cross_joint_friction),
    ("elasticity", {"joints": (2,), "stiffness": 4000.0}, elasticity),
    ("backlash", {"joints": (4,), "gap": 1e-3}, backlash),
]


@pytest.mark.parametrize(("effect", "figures", "check"), CASES, ids=[case[0] for case in CASES])
def test_effect_does_what_its_name_says(
    vs060: Robot, effect: str, figures: dict[str, object], check: Callable[[Case], None]
) -> None:
    _, before = record(vs060, QUIET)
    virtual, after = record(vs060, QUIET.with_effect(effect, **figures))
    case = Case(before, after, virtual)
    assert effect in virtual.truth["effects"]
    assert effect not in VirtualRobot(vs060, QUIET).truth["effects"]
    np.testing.assert_array_equal(before.q, after.q)
    assert np.abs(case.change).max() > 1e-3
    named = figures.get("joints")
    if isinstance(named, tuple):
        others = [j for j in range(6) if j + 1 not in named]
        # a soft joint hangs lower, and the others feel that
        assert np.abs(case.change[:, others]).max() < (0.5 if effect in ("elasticity", "backlash") else 1e-9)
    check(case)


def test_scale_switches_an_effect_off_joint_by_joint(vs060: Robot) -> None:
    _, before = record(vs060, QUIET)
    _, after = record(vs060, QUIET.with_effect("current-offset", offset=2.0, scale=(0.0, 1.0, 0.5, 0.0, 0.0, 0.0)))
    np.testing.assert_allclose((after.current - before.current)[0], [0.0, 2.0, 1.0, 0.0, 0.0, 0.0], atol=1e-9)
