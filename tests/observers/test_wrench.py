"""The wrench at the tool, from torques and, after KDL's protocol, from a moving arm."""

from collections.abc import Callable

import numpy as np
import pytest

from ident.arrays import FloatArray
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import Links
from ident.errors import InputError
from ident.fit import Drives, fit
from ident.log import JointLog
from ident.model import CurrentModel
from ident.robot import Robot
from observers.momentum import MomentumObserver
from observers.wrench import WrenchEstimator

POSE = np.array([0.2, 0.4, 1.0, 0.3, 0.5, 0.1])
WRENCH = np.array([10.0, -5.0, 8.0, 0.5, -0.4, 0.6])
COULOMB, VISCOUS = np.array([5.0, 6.0, 3.0, 1.0, 1.0, 0.6]), np.array([4.0, 5.0, 2.5, 0.8, 0.8, 0.5])


@pytest.mark.parametrize("axes", ["base", "tool"])
def test_wrench_of_known_torques(vs060: Robot, axes: str) -> None:
    estimator = WrenchEstimator(vs060, axes=axes)  # type: ignore[arg-type]
    torque = vs060.multibody.frame_jacobian(POSE).T @ WRENCH
    found = estimator.estimate(POSE, torque)
    rotation, _ = vs060.multibody.frame_pose(POSE)
    expected = WRENCH if axes == "base" else np.concatenate([rotation.T @ WRENCH[:3], rotation.T @ WRENCH[3:]])
    np.testing.assert_allclose(found.wrench, expected, atol=1e-8)
    assert not found.near_singular
    assert len(found.blind) == 0
    assert found.condition < 100.0


def test_singular_pose_says_what_it_cannot_see(vs060: Robot) -> None:
    straight = np.array([0.2, 0.4, 1.0, 0.3, 0.0, 0.1])  # joints 4 and 6 in line
    estimator = WrenchEstimator(vs060)
    jacobian = vs060.multibody.frame_jacobian(straight)
    found = estimator.estimate(straight, jacobian.T @ WRENCH)
    assert found.near_singular
    assert len(found.blind) == 1
    unseen = found.blind[0] * np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])
    assert np.abs(jacobian.T @ unseen).max() < 1e-6
    # damping keeps noise from growing, where the plain inverse would not
    noisy = estimator.estimate(straight, jacobian.T @ WRENCH + 0.1).wrench
    assert np.abs(noisy - found.wrench).max() < 10.0
    nearly = straight + np.array([0.0, 0.0, 0.0, 0.0, 0.001, 0.0])
    assert estimator.estimate(nearly, np.full(6, 0.1)).near_singular


def test_two_joints_are_blind_in_four_directions(two_link: Robot) -> None:
    found = WrenchEstimator(two_link).estimate(np.array([0.3, 0.8]), np.array([1.0, 0.5]))
    assert found.near_singular
    assert len(found.blind) == 4
    assert np.isfinite(found.wrench).all()


def test_unknown_frame_and_bad_numbers_are_refused(vs060: Robot) -> None:
    with pytest.raises(InputError, match="no frame"):
        WrenchEstimator(vs060, frame="flange7")
    with pytest.raises(InputError, match="above 0"):
        WrenchEstimator(vs060, threshold=0.0)


def motion(t: FloatArray, seed: int, size: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Random smooth motion: two sines a joint."""
    rng = np.random.default_rng(seed)
    rate, phase = rng.uniform(0.5, 2.5, (2, 6)), rng.uniform(-np.pi, np.pi, (2, 6))
    angle = t[:, None, None] * rate + phase
    q = POSE + size * np.sin(angle).sum(axis=1)
    return q, size * (rate * np.cos(angle)).sum(axis=1), -size * (rate**2 * np.sin(angle)).sum(axis=1)


def torque_log(robot: Robot, t: FloatArray, seed: int, size: float, friction: bool, wrench: FloatArray) -> JointLog:
    q, dq, ddq = motion(t, seed, size)
    torque = robot.rigid_body.inverse_dynamics(q, dq, ddq, robot.multibody.parameters)
    if friction:
        torque += COULOMB * np.tanh(dq / 5e-3) + VISCOUS * dq
    external = np.array([robot.multibody.frame_jacobian(row).T @ wrench for row in q])
    return JointLog(t=t, q=q, dq=dq, current=torque - external, tau_ext=external)


@pytest.fixture(scope="module")
def with_friction(vs060: Robot) -> CurrentModel:
    """Model identified from 20 s of motion without contact, noise on the torque."""
    log = torque_log(vs060, np.arange(2000) / 100.0, 5, 0.5, True, np.zeros(6))
    noise = 0.2 * np.random.default_rng(6).standard_normal(log.current.shape)
    effects = [Links(None), *(kind(j) for j in range(6) for kind in (Coulomb, Viscous))]
    return fit(vs060, effects, [log.replace(current=log.current + noise)], 10.0, Drives(np.ones(6), "N m")).model


@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_kdl_protocol(
    seed: int, friction: bool, vs060: Robot, true_model: Callable[..., CurrentModel], with_friction: CurrentModel
) -> None:
    """Random motion at 1 kHz, K = 45, 0.4 s of a constant wrench: within .5 N and .3 N m."""
    model = with_friction if friction else true_model(vs060)
    log = torque_log(vs060, np.arange(400) / 1000.0, seed, 0.15, friction, WRENCH)
    observer = MomentumObserver(model, 45.0 / (2.0 * np.pi), filtered=False, rate=1000.0)
    residual = observer.run(log)
    assert residual.torque is not None
    found = WrenchEstimator(vs060).estimate(log.q[-1], residual.torque[-1])
    assert not found.near_singular
    np.testing.assert_allclose(found.wrench[:3], WRENCH[:3], atol=0.5)
    np.testing.assert_allclose(found.wrench[3:], WRENCH[3:], atol=0.3)
