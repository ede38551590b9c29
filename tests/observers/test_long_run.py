"""A million steps leave every observer where a thousand do: nothing drifts."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.effects.base import Term
from ident.effects.rigid_body import Links
from ident.log import JointLog
from ident.model import CurrentModel
from ident.robot import Robot, load_robot
from observers.disturbance import DisturbanceObserver
from observers.filtered_dynamics import FilteredDynamicsObserver
from observers.kalman import KalmanObserver
from observers.model_based import ModelBasedObserver
from observers.momentum import MomentumObserver
from observers.noise import MomentumNoise
from observers.sliding_mode import SlidingModeObserver

STEPS = 1_000_000
PERIOD = 1000  # rows after which the motion repeats
OBSERVERS: dict[str, Callable[[CurrentModel], ModelBasedObserver]] = {
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
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder: Path = tmp_path_factory.mktemp("pendulum")
    (folder / "pendulum.urdf").write_text(PENDULUM)
    (folder / "robot.toml").write_text('name = "pendulum"\nurdf = "pendulum.urdf"\ncurrent_unit = "N*m"\n')
    return load_robot(folder)


@pytest.fixture(scope="module")
def log(pendulum: Robot) -> JointLog:
    """A swinging arm under a constant push and a noise that repeats with the motion."""
    phase = 2.0 * np.pi * np.arange(PERIOD) / PERIOD
    rate = 2.0 * np.pi / (PERIOD * 0.01)
    q, dq, ddq = (x[:, None] for x in (np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase)))
    torque = pendulum.rigid_body.inverse_dynamics(q, dq, ddq, pendulum.multibody.parameters) - 0.5
    torque += 0.1 * np.random.default_rng(0).standard_normal(torque.shape)
    times = STEPS // PERIOD
    return JointLog(t=np.arange(STEPS) / 100.0, q=np.tile(q, (times, 1)), current=np.tile(torque, (times, 1)))


@pytest.mark.parametrize("name", OBSERVERS)
def test_nothing_drifts(name: str, pendulum: Robot, log: JointLog) -> None:
    base = pendulum.rigid_body.base_parameters()
    links = Term(Links(None), coefficients=base.projection @ pendulum.multibody.parameters)
    model = CurrentModel(pendulum, (links,), 10.0, 100.0, np.ones(1), "N m")
    residual = OBSERVERS[name](model).run(log).current[:, 0]
    early, late = residual[5 * PERIOD : 6 * PERIOD], residual[-PERIOD:]
    assert np.std(early) > 1e-4
    assert 0.4 < early.mean() < 0.6
    # what is left is the rounding of time stamps of hours
    np.testing.assert_allclose(late, early, rtol=0, atol=1e-7)
