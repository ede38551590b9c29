"""A million steps leave every estimator where a thousand do: nothing drifts."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.effects.base import Term
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links
from ident.log import JointLog
from ident.model import CurrentModel
from ident.robot import Robot, load_robot
from ident.signals import Motion
from observers.direct import DirectEstimator
from observers.disturbance import DisturbanceObserver
from observers.filtered_dynamics import FilteredDynamicsObserver
from observers.kalman import KalmanObserver
from observers.momentum import MomentumObserver
from observers.noise import MomentumNoise
from observers.residual import ResidualEstimator
from observers.sliding_mode import SlidingModeObserver

STEPS = 1_000_000
PERIOD = 1000  # rows after which the motion repeats
PUSH = 0.5  # [N m]
ESTIMATORS: dict[str, Callable[[CurrentModel], ResidualEstimator]] = {
    "direct": lambda m: DirectEstimator(m, m.rate, m.cutoff, m.gain),
    "momentum": MomentumObserver,
    "kalman": lambda m: KalmanObserver(m, MomentumNoise(np.full(1, 0.1), np.full(1, 0.01))),
    "disturbance": DisturbanceObserver,
    "sliding-mode": lambda m: SlidingModeObserver(m, 20.0),
    "filtered-dynamics": FilteredDynamicsObserver,
}
PENDULUM = """<robot name="pendulum"><link name="base"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="10" effort="100"/></joint>
<link name="l1"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
<inertia ixx="0.3" iyy="0.3" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


@pytest.fixture(scope="module")
def pendulum(write_card: Callable[..., Path]) -> Robot:
    return load_robot(write_card("pendulum", PENDULUM, 'current_unit = "N*m"'))


@pytest.fixture(scope="module")
def model(pendulum: Robot) -> CurrentModel:
    """Links, and friction that remembers."""
    base = pendulum.rigid_body.base_parameters()
    links = Term(Links(None), coefficients=base.projection @ pendulum.multibody.parameters)
    slip = Term(MaxwellSlip(0), np.array([0.05]), np.array([0.3, 0.4, 0.3]))
    return CurrentModel(pendulum, (links, slip), 10.0, 100.0, np.ones(1), "N m")


@pytest.fixture(scope="module")
def log(model: CurrentModel) -> JointLog:
    """A swinging arm under a constant push and a noise that repeats with the motion."""
    t = np.arange(2 * PERIOD) / 100.0
    rate = 2.0 * np.pi / (PERIOD * 0.01)
    q, dq, ddq = (x[:, None] for x in (np.sin(rate * t), rate * np.cos(rate * t), -(rate**2) * np.sin(rate * t)))
    # friction in the second period is that in every later one
    torque = model.force(Motion(t, q, dq, ddq), model.start())[PERIOD:] - PUSH
    torque += 0.1 * np.random.default_rng(0).standard_normal(torque.shape)
    times = STEPS // PERIOD
    return JointLog(t=np.arange(STEPS) / 100.0, q=np.tile(q[:PERIOD], (times, 1)), current=np.tile(torque, (times, 1)))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_nothing_drifts(name: str, model: CurrentModel, log: JointLog) -> None:
    residual = ESTIMATORS[name](model).run(log).current[:, 0]
    early, late = residual[5 * PERIOD : 6 * PERIOD], residual[-PERIOD:]
    assert np.std(early) > 1e-4
    assert 0.9 * PUSH < early.mean() < 1.1 * PUSH
    # what is left is the rounding of time stamps of hours
    np.testing.assert_allclose(late, early, rtol=0, atol=1e-7)


def test_the_friction_is_remembered(model: CurrentModel, log: JointLog) -> None:
    held = log[: 2 * PERIOD]
    forgetful = CurrentModel(model.robot, model.terms[:1], model.cutoff, model.rate, model.gain, model.force_unit)
    with_, without = (ESTIMATORS["direct"](m).run(held).current[PERIOD:, 0] for m in (model, forgetful))
    assert np.abs(without - with_).max() > 0.9
