"""Drive gains: absolute ones from a known payload, relative ones from motion alone, and those the data leave open."""

import numpy as np
import pytest
from scipy.signal import lfilter

from comparisons.protocols.calibration import payload_pair
from comparisons.protocols.excitation import fourier
from comparisons.virtual_robot.robot import VirtualRobot
from ident.bilinear import Bilinear, GainPrior
from ident.drive_gain import gains_from_payload, shared_gains, usual_effects
from ident.effects.friction import LoadFriction
from ident.errors import InputError
from ident.log import JointLog
from ident.payload import Payload, last_joint

GAIN = np.array([0.71, 0.81, 0.403, 0.112, 0.144, 0.076])  # [N m per %Use]
LOAD = Payload(2.0, (0.05, 0.0, 0.08), np.diag([0.004, 0.004, 0.003]))
CUTOFF = 10.0


def recorded(robot, payload=None, noise=0.5, speed=1.0, seed=0, seconds=40.0):
    """Log of an arm that is all the model says, with noise whose correlation lasts 0.1 s."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * 100)) / 100
    rate = speed * np.random.default_rng(1).uniform(0.5, 2.0, (2, 6))
    q = 0.6 * np.sin(rate[0] * t[:, None] + 1) + 0.3 * np.sin(rate[1] * t[:, None])
    dq = 0.6 * rate[0] * np.cos(rate[0] * t[:, None] + 1) + 0.3 * rate[1] * np.cos(rate[1] * t[:, None])
    ddq = -0.6 * rate[0] ** 2 * np.sin(rate[0] * t[:, None] + 1) - 0.3 * rate[1] ** 2 * np.sin(rate[1] * t[:, None])
    bodies = robot.multibody.parameters.copy()
    if payload is not None:
        bodies[-10:] += payload.parameters(robot)
    torque = robot.rigid_body.inverse_dynamics(q, dq, ddq, bodies) + 0.05 * ddq
    coloured = lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], rng.normal(size=q.shape), axis=0)
    current = torque / GAIN + 5.0 * np.tanh(dq / 5e-3) + 3.0 * dq + 1.0 + noise * coloured
    return JointLog(t=t, q=q, dq=dq, ddq=ddq, current=current)


@pytest.mark.parametrize("share_links", [False, True])
@pytest.mark.parametrize("payload", [LOAD, Payload(2.0, (0.05, 0.0, 0.08))], ids=["inertia known", "inertia unknown"])
def test_a_payload_tells_the_gains_without_noise_exactly(vs060, share_links, payload):
    logs = [recorded(vs060, noise=1e-6)], [recorded(vs060, LOAD, noise=1e-6)]
    estimate = gains_from_payload(vs060, *logs, payload, CUTOFF, share_links=share_links)
    np.testing.assert_allclose(estimate.value, GAIN, rtol=2e-3)
    q, still = 0.5 * np.ones(6), np.zeros(6)
    weight = vs060.rigid_body.inverse_dynamics(q, still, still, estimate.links)
    np.testing.assert_allclose(weight, vs060.multibody.gravity_torque(q), atol=0.05)


def test_intervals_hold_the_truth_and_an_unloaded_joint_is_open(vs060):
    inside = np.zeros(6)
    for seed in range(5):
        logs = [recorded(vs060, speed=0.5, seed=2 * seed)], [recorded(vs060, LOAD, speed=0.5, seed=2 * seed + 1)]
        estimate = gains_from_payload(vs060, *logs, LOAD, CUTOFF)
        inside += (estimate.low < GAIN) & (estimate.high > GAIN)
        np.testing.assert_allclose(estimate.value[1:3], GAIN[1:3], rtol=0.03)
        assert not estimate.open[1:3].any()
        assert estimate.open[0]
    assert inside.sum() >= 26  # of 30; 95 % are expected, and fewer than 26 would come once in a hundred times
    assert "joint 1" in estimate.reason[0]
    assert "gravity does not load it" in estimate.reason[0]
    assert estimate.reason[1] == ""


def test_a_prior_closes_what_the_data_leave_open_and_bounds_hold(vs060):
    logs = [recorded(vs060, speed=0.3, seed=0)], [recorded(vs060, LOAD, speed=0.3, seed=1)]
    nominal = np.array([0.75, np.nan, np.nan, np.nan, np.nan, np.nan])
    with_prior = gains_from_payload(vs060, *logs, LOAD, CUTOFF, nominal=nominal, nominal_std=0.1)
    assert with_prior.open[0]
    assert with_prior.value[0] == pytest.approx(0.75, rel=0.1)
    assert 0.05 < with_prior.std[0] / with_prior.value[0] <= 0.1
    alone = gains_from_payload(vs060, *logs, LOAD, CUTOFF, bounds=(np.full(6, 0.01), np.full(6, 2.0)))
    assert alone.std[0] > 5 * with_prior.std[0]
    assert alone.high[0] <= 2.0
    assert alone.low[0] < GAIN[0]
    np.testing.assert_allclose(with_prior.value[1:], alone.value[1:], rtol=0.01)


def test_sharing_the_links_helps_where_the_model_is_right(vs060):
    logs = [recorded(vs060, seed=0)], [recorded(vs060, LOAD, seed=1)]
    own, shared = (gains_from_payload(vs060, *logs, LOAD, CUTOFF, share_links=s) for s in (False, True))
    assert shared.std[0] < 0.8 * own.std[0]
    assert np.all(np.abs(shared.value - GAIN) < 3 * shared.std)


def test_motion_alone_tells_relative_gains(vs060):
    relative = GAIN / np.exp(np.log(GAIN).mean())
    logs = [recorded(vs060, noise=0.05)]
    estimate = shared_gains(vs060, logs, CUTOFF)
    assert np.log(estimate.value).mean() == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.abs(estimate.value - relative) < 3 * estimate.std)
    np.testing.assert_allclose(estimate.value[1:3], relative[1:3], rtol=0.05)
    scaled = shared_gains(vs060, logs, CUTOFF, inertial=vs060.multibody.parameters)
    np.testing.assert_allclose(scaled.value / scaled.value[1], estimate.value / estimate.value[1], rtol=1e-6)
    np.testing.assert_allclose(scaled.value[1:5], GAIN[1:5], rtol=0.05)


def test_gravity_loaded_joints_of_the_virtual_robot_come_within_three_percent(vs060):
    motion = fourier(vs060, seconds=60.0, seed=1)
    without, with_ = payload_pair(VirtualRobot(vs060), motion, LOAD.mass, LOAD.com, (0.004, 0.004, 0.003), seed=1)
    effects = [*usual_effects(vs060), *(LoadFriction(j) for j in (1, 2))]
    estimate = gains_from_payload(vs060, [without], [with_], LOAD, 8.0, effects)
    np.testing.assert_allclose(estimate.value[1:3], GAIN[1:3], rtol=0.03)
    assert np.all((estimate.low < GAIN) & (estimate.high > GAIN))


def test_a_frame_says_where_the_payload_is(vs060):
    at_flange = Payload(2.0, (0.05, 0.0, 0.06), np.diag([0.004, 0.004, 0.003]), frame="tool0")
    np.testing.assert_allclose(at_flange.parameters(vs060), LOAD.parameters(vs060), atol=1e-12)
    assert last_joint(vs060) == 5


def test_gradient_of_the_likelihood(rng):
    triangles = [np.triu(rng.normal(size=(5, 5))) for _ in range(3)]
    problem = Bilinear(triangles, known=1, weights=np.array([1.0, 2.0, 0.5]))
    prior = GainPrior(np.zeros(3), np.array([0.3, np.inf, 1.0]))
    at, step = 0.3 * rng.normal(size=3), 1e-6
    residual, jacobian = problem._residual(at, prior)
    for k in range(3):
        sides = [problem._residual(at + sign * step * np.eye(3)[k], prior)[0] for sign in (1, -1)]
        slope = (sides[0] @ sides[0] - sides[1] @ sides[1]) / (2 * step)
        assert 2 * residual @ jacobian[:, k] == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"with_": []}, "no log"),
        ({"payload": Payload(0.0, (0.0, 0.0, 0.0))}, "a payload of 0 kg"),
        ({"payload": Payload(1.0, (0.0, 0.0, 0.0), frame="hand")}, "no frame 'hand'"),
        ({"bounds": (np.zeros(6), np.ones(6))}, "bounds"),
    ],
)
def test_wrong_calls_are_refused(vs060, change, message):
    log = recorded(vs060, seconds=2.0)
    call = {"without": [log], "with_": [log], "payload": LOAD, "cutoff": CUTOFF} | change
    with pytest.raises(InputError, match=message):
        gains_from_payload(vs060, **call)
