"""Observers of a robot whose wrist motors are coupled: they tell the joints' torques from the motors' currents."""

from dataclasses import replace

import numpy as np
import pytest

from ident.log import JointLog, Sample
from observers.methods import METHODS, make_estimator

WRIST = [[1.0, 0.0], [-0.7, 1.0]]
GAIN, PUSH = np.array([4.0, 2.5]), np.array([3.0, -2.0])


@pytest.fixture
def model(two_link, true_model):
    drive = two_link.card.drive.model_copy(update={"coupling": WRIST, "gain": GAIN.tolist()})
    card = two_link.card.model_copy(update={"drive": drive, "current_unit": "A"})
    return replace(true_model(replace(two_link, card=card), friction=True), gain=GAIN)


@pytest.fixture
def pushed(model):
    """A log in which a torque on both joints sets in and stays."""
    t = np.arange(800) / 100.0
    phase = np.array([0.9, 1.4]) * t[:, None]
    motion = JointLog(t, 0.8 * np.sin(phase), np.zeros((len(t), 2)), dq=0.8 * np.array([0.9, 1.4]) * np.cos(phase))
    push = np.where(t[:, None] > 4.0, PUSH, 0.0)
    # power on both sides: the joints' torques are C^T those of the motors
    carried = np.linalg.solve(np.array(WRIST).T, push.T).T / GAIN
    return motion.replace(current=model.predict(motion) - carried, tau_ext=push)


@pytest.mark.parametrize("method", sorted(METHODS))
def test_torque_is_that_of_the_joints(model, pushed, method):
    residual = make_estimator(method, model, [pushed]).run(pushed)
    np.testing.assert_allclose(residual.torque[-100:].mean(axis=0), PUSH, atol=0.15)


@pytest.mark.parametrize("method", sorted(METHODS))
def test_samples_one_by_one_are_as_the_whole_log(model, pushed, method):
    whole = make_estimator(method, model, [pushed]).run(pushed).current
    online = make_estimator(method, model, [pushed])
    samples = zip(pushed.t, pushed.q, pushed.current, pushed.dq, strict=True)
    alone = [online.step(Sample(t, q, current, dq)) for t, q, current, dq in samples]
    np.testing.assert_allclose(alone, whole, atol=1e-9)
