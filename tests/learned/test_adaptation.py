import dataclasses

import numpy as np
import pytest

from ident.errors import InputError
from ident.identification import identify
from ident.log import JointLog
from ident.rigid_body import RigidBody
from ident.robot import load_robot
from learned.adaptation import adapt_payload, last_link
from learned.fine_tuning import fine_tune
from learned.options import TrainingOptions
from learned.training import train

UNIT = np.array([0.71, 0.81, 0.403, 0.112, 0.144, 0.076])
PAYLOAD = np.array([2.0, 0.04, -0.02, 0.2, 0.022, 0.0, 0.022, 0.0, 0.0, 0.004])


@pytest.fixture(scope="module")
def robot():
    return load_robot("vs060")


def moving(robot, seed, seconds, payload, gain=UNIT, noise=0.3):
    """Smooth random motion of the VS060 within its limits; rigid-body torque and friction as current."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * 100.0)) / 100.0
    phase = rng.uniform(0.0, 2.0 * np.pi, (4, 6))
    speed = 2.0 * np.pi * rng.uniform(0.05, 0.4, (4, 6))
    size = 0.35 * np.minimum(np.abs(robot.limits.lower), robot.limits.upper) / 4.0
    angle = speed[:, None] * t[None, :, None] + phase[:, None]
    q = np.sum(size * np.sin(angle), axis=0)
    dq = np.sum(size * speed[:, None] * np.cos(angle), axis=0)
    ddq = -np.sum(size * speed[:, None] ** 2 * np.sin(angle), axis=0)
    parameters = robot.multibody.parameters.copy()
    parameters[last_link(robot)] += payload
    torque = RigidBody(robot.multibody).inverse_dynamics(q, dq, ddq, parameters)
    current = torque / gain + 4.0 * np.tanh(dq / 0.02) + 2.0 * dq + noise * rng.normal(size=q.shape)
    return JointLog(t, q, current, name=f"motion{seed}")


class Perfect:
    """The predictor that training without a payload would ideally give."""

    unit, n, rate, cutoff = "%Use", 6, 100.0, 20.0

    def __init__(self, robot):
        from ident.causal import CausalDerivatives

        self.body, self.parameters = RigidBody(robot.multibody), robot.multibody.parameters
        self.filters = CausalDerivatives(self.rate, self.cutoff, 6)

    def reset(self):
        self.filters.reset()

    def step(self, sample):
        q, dq, ddq = self.filters.step(sample.t, sample.q)
        torque = self.body.inverse_dynamics(q, dq, ddq, self.parameters)
        return torque / UNIT + 4.0 * np.tanh(dq / 0.02) + 2.0 * dq

    def predict(self, log, causal=False):
        self.reset()
        return np.array([self.step(sample) for sample in log.samples()])


def rmse(model, log):
    return np.sqrt(np.mean((log.current - model.predict(log, causal=True))[100:] ** 2, axis=0))


@pytest.mark.parametrize("gains", ["known", "unknown"])
def test_four_seconds_restore_the_accuracy_after_a_payload(robot, gains):
    card = robot.card
    if gains == "known":
        card = card.model_copy(update={"drive": card.drive.model_copy(update={"gain": UNIT.tolist()})})
    robot = dataclasses.replace(robot, card=card)
    assert (robot.gain is None) == (gains == "unknown")
    model = Perfect(robot)
    before = rmse(model, moving(robot, 2, 30.0, 0.0 * PAYLOAD))
    loaded = moving(robot, 2, 30.0, PAYLOAD)
    assert rmse(model, loaded).max() > 5.0 * before.max()
    reference = moving(robot, 30, 60.0, 0.0 * PAYLOAD)
    adapted = adapt_payload(model, robot, moving(robot, 3, 4.0, PAYLOAD), reference)
    after = rmse(adapted, loaded)
    assert np.sqrt(np.mean(after**2)) < 1.1 * np.sqrt(np.mean(before**2))
    if gains == "known":
        np.testing.assert_allclose(adapted.payload[0], 2.0, rtol=0.1)


def test_the_links_of_an_identified_model_say_how_much_current_a_torque_takes(robot):
    before = [moving(robot, 40 + k, 60.0, 0.0 * PAYLOAD) for k in range(2)]
    physics = identify(robot, before, effects=("coulomb", "viscous")).model
    short, loaded = moving(robot, 3, 4.0, PAYLOAD), moving(robot, 2, 30.0, PAYLOAD)
    model = Perfect(robot)
    told = adapt_payload(model, robot, short, before[0], physics)
    np.testing.assert_allclose(told.scale[[1, 2, 4]], 1.0 / UNIT[[1, 2, 4]], rtol=0.1)
    np.testing.assert_allclose(told.payload[0], 2.0, rtol=0.15)
    assert rmse(told, loaded).mean() < 1.1 * rmse(model, before[1]).mean()
    model.physics = physics  # what a hybrid stands on need not be given
    np.testing.assert_array_equal(adapt_payload(model, robot, short, before[0]).payload, told.payload)


def test_step_equals_predict(robot):
    adapted = adapt_payload(Perfect(robot), robot, moving(robot, 3, 4.0, PAYLOAD))
    log = moving(robot, 4, 2.0, PAYLOAD)
    predicted = adapted.predict(log, causal=True)
    adapted.reset()
    np.testing.assert_allclose([adapted.step(sample) for sample in log.samples()], predicted, rtol=0.0, atol=1e-9)


def test_without_a_change_nothing_is_added(robot):
    log = moving(robot, 5, 4.0, 0.0 * PAYLOAD)
    adapted = adapt_payload(Perfect(robot), robot, log)
    added = adapted.predict(log, causal=True) - Perfect(robot).predict(log, causal=True)
    assert np.sqrt(np.mean(added[50:] ** 2)) < 0.1


def test_too_little_motion_is_refused(robot):
    with pytest.raises(InputError, match="at least a second"):
        adapt_payload(Perfect(robot), robot, moving(robot, 6, 0.5, PAYLOAD))


def test_a_network_adapts_better_by_its_payload_than_by_fine_tuning(robot):
    options = TrainingOptions(epochs=6, batch=128, width=48, learning_rate=3e-3, cutoff=20.0, hierarchies=1)
    model = train(robot, [moving(robot, 20 + k, 120.0, 0.0 * PAYLOAD) for k in range(5)], None, "hrdl-md", options)
    short, loaded = moving(robot, 3, 4.0, PAYLOAD), moving(robot, 2, 30.0, PAYLOAD)
    untouched = rmse(model, loaded).mean()
    by_payload = rmse(adapt_payload(model, robot, short), loaded).mean()
    by_tuning = rmse(fine_tune(model, short, learning_rate=1e-3, anchor=0.1), loaded).mean()
    assert by_payload < 0.7 * untouched
    assert by_payload < by_tuning
