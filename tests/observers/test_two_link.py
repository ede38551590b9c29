"""A two-link arm without noise or friction, the test of ext_observer: how close and how quick each observer is."""

from collections.abc import Callable

import numpy as np
import pytest

from ident.arrays import FloatArray
from ident.log import JointLog
from ident.model import CurrentModel
from ident.robot import Robot
from observers.disturbance import DisturbanceObserver
from observers.filtered_dynamics import FilteredDynamicsObserver
from observers.kalman import KalmanObserver
from observers.model_based import ModelBasedObserver
from observers.momentum import MomentumObserver
from observers.noise import MomentumNoise
from observers.sliding_mode import SlidingModeObserver

Make = Callable[[CurrentModel], ModelBasedObserver]

# ext_observer's figures, measured for this project: RMSE of joints 1 and 2 [N m], time to 90 % [s]
COUNTERPARTS: dict[str, tuple[Make, tuple[float, float], float]] = {
    "momentum": (lambda m: MomentumObserver(m, 10.0, filtered=False), (0.046, 0.046), 0.050),
    "disturbance": (lambda m: DisturbanceObserver(m, 300.0, filtered=False), (0.010, 0.004), 0.010),
    "sliding-mode": (lambda m: SlidingModeObserver(m, 15.0, filtered=False), (0.090, 0.082), 0.080),
    "kalman": (
        lambda m: KalmanObserver(m, MomentumNoise(np.full(2, 0.01), np.full(2, 1e-4)), 5.0, filtered=False),
        (0.115, 0.093),
        0.210,
    ),
    "filtered-dynamics": (lambda m: FilteredDynamicsObserver(m, 5.0, filtered=False), (0.103, 0.102), 0.290),
}


@pytest.fixture
def log(two_link: Robot) -> JointLog:
    t = np.arange(300) / 100.0
    rate = np.array([1.3, 0.8])
    q = np.sin(t[:, None] * rate)
    dq, ddq = rate * np.cos(t[:, None] * rate), -(rate**2) * q
    external = np.where(((t >= 1.0) & (t < 2.0))[:, None], 0.5, 0.0) * np.ones(2)
    torque = two_link.rigid_body.inverse_dynamics(q, dq, ddq, two_link.multibody.parameters) - external
    return JointLog(t=t, q=q, dq=dq, current=torque, tau_ext=external)


def figures(observer: ModelBasedObserver, log: JointLog) -> tuple[FloatArray, FloatArray]:
    """RMSE over the run [N m] and time from the push to 90 % of it [s], of each joint."""
    residual = observer.run(log).current
    assert log.tau_ext is not None
    rmse = np.sqrt(np.mean((residual - log.tau_ext) ** 2, axis=0))
    reached = np.argmax(residual[100:] >= 0.45, axis=0) / 100.0
    return rmse, reached


@pytest.mark.parametrize("name", COUNTERPARTS)
def test_no_worse_than_its_counterpart(
    name: str, two_link: Robot, log: JointLog, true_model: Callable[..., CurrentModel]
) -> None:
    make, rmse_known, reached_known = COUNTERPARTS[name]
    rmse, reached = figures(make(true_model(two_link)), log)
    assert np.all(rmse <= np.array(rmse_known)), rmse
    assert np.all(reached <= reached_known + 1e-9), reached


def test_momentum_residual_rises_as_designed(
    two_link: Robot, log: JointLog, true_model: Callable[..., CurrentModel]
) -> None:
    residual = MomentumObserver(true_model(two_link), 30.0 / (2.0 * np.pi), filtered=False).run(log).current
    # the trapezoid sees the push, which begins at a sample, half a sample early
    since = log.t[100:200] - 1.0 + 0.005
    np.testing.assert_allclose(residual[100:200, 0], 0.5 * (1.0 - np.exp(-30.0 * since)), atol=0.01)
    # stable far beyond the Euler form's limit K h = 2
    fast = MomentumObserver(true_model(two_link), 1000.0, filtered=False).run(log).current
    np.testing.assert_allclose(fast[150], 0.5, atol=1e-3)


def test_kalman_fast_path_is_the_full_filter(
    two_link: Robot, log: JointLog, true_model: Callable[..., CurrentModel]
) -> None:
    model, noise = true_model(two_link), MomentumNoise(np.array([0.3, 0.2]), np.array([0.01, 0.02]))
    fast = KalmanObserver(model, noise, filtered=False).run(log).current
    full = KalmanObserver(model, noise, gain="full", filtered=False).run(log).current
    np.testing.assert_allclose(fast, full, rtol=0, atol=1e-9)
    assert np.abs(full).max() > 0.4
