import dataclasses

import numpy as np
import pytest
import torch

from ident.effects.base import initial_term
from ident.effects.friction import Viscous
from ident.errors import InputError
from ident.log import JointLog
from ident.model import CurrentModel
from ident.predictor import CurrentPredictor
from ident.robot import load_robot
from learned.motion_discriminator import DiscriminatorSpec, MotionDiscriminator
from learned.networks import METHODS
from learned.predictor import LearnedModel
from learned.torch_graph import network
from learned.window import frames_of, pad, windows


def stepwise(model, log):
    out = []
    for rows in log.segments():
        model.reset()
        out += [model.step(sample) for sample in log[rows].samples()]
    return np.array(out)


def by_torch(trained, log):
    """The same prediction with torch modules and none of the run-time code."""
    shape = trained.architecture
    frames = frames_of(log, trained.rate, trained.cutoff)
    padded, place = pad(frames.channels, frames.segments, frames.finite, shape.memory)
    window = windows(trained.frame_scaling.apply(padded), shape.memory)[place - shape.memory + 1]
    held = MotionDiscriminator(trained.discriminator, shape.n).run(frames.motion.q, frames.motion.dq, frames.segments)
    held = trained.held_scaling.apply(held.reshape(len(held), -1))
    total = np.tile(trained.output_offset, (len(held), 1))
    first = 0
    for h, (low, high) in enumerate(shape.groups):
        module = network(shape, h, 99)
        size = len(module.flat())
        module.load_flat(trained.weights[first : first + size])
        first += size
        with torch.no_grad():
            if shape.method == "lstm":
                y = module(torch.from_numpy(window.reshape(len(window), shape.memory, -1)), 1)[:, 0]
            else:
                group = held[:, low * shape.n : high * shape.n]
                y = module(torch.from_numpy(np.hstack([window, group])))
        total += trained.output_gain[h] * y.double().numpy()
    return total


@pytest.mark.parametrize("method", METHODS)
def test_step_equals_predict_equals_torch(method, stop_and_go, random_model):
    log = stop_and_go(1, seconds=5.0, segments=2)
    trained = random_model(method)
    model = LearnedModel(trained)
    assert isinstance(model, CurrentPredictor)
    predicted = model.predict(log, causal=True)
    np.testing.assert_array_equal(stepwise(model, log), predicted)
    np.testing.assert_array_equal(model.predict(log), predicted)
    expected = by_torch(trained, log)
    assert np.abs(predicted - expected).max() < 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("signal", ["median-velocity", "displacement"])
def test_other_discriminators_step_as_they_predict(signal, stop_and_go, random_model):
    log = stop_and_go(2, seconds=4.0)
    model = LearnedModel(random_model("hrdl-md", discriminator=DiscriminatorSpec((0.001, 0.01), signal)))
    np.testing.assert_array_equal(stepwise(model, log), model.predict(log))


@pytest.mark.parametrize("method", ["hrdl-md", "lstm"])
def test_an_unknown_sample_silences_its_window_only(method, stop_and_go, random_model):
    log = stop_and_go(3, seconds=4.0)
    q = log.q.copy()
    q[[0, 200]] = np.nan
    model = LearnedModel(random_model(method))
    predicted = model.predict(log.replace(q=q))
    np.testing.assert_array_equal(stepwise(model, log.replace(q=q)), predicted)
    memory = model.trained.architecture.memory
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(predicted[:, 0])), [0, *range(200, min(200 + memory, len(log)))]
    )


def test_a_faster_log_is_predicted_row_for_row(stop_and_go, random_model):
    log = stop_and_go(4, seconds=3.0, rate=500.0, segments=2)
    model = LearnedModel(random_model("hrdl-md"))
    predicted = model.predict(log)
    assert predicted.shape == log.q.shape
    fast = model.at_rate(500.0)
    np.testing.assert_array_equal(stepwise(fast, log), predicted)
    with pytest.raises(InputError, match="250 Hz where the model is for 100 Hz"):
        model.at_rate(250.0)


def test_static_estimate_does_not_drift(stop_and_go, random_model):
    log = stop_and_go(5, seconds=10.0)
    still = np.repeat(log.q[-1:], 60_000, axis=0)
    q = np.vstack([log.q, still])
    long = log.replace(t=np.arange(len(q)) / 100.0, q=q, current=q * 0.0, segment=np.zeros(len(q), dtype=np.int64))
    model = LearnedModel(random_model("hrdl-md", width=16))
    predicted = model.predict(long)
    assert np.ptp(predicted[-59_000:], axis=0).max() < 1e-9


def test_the_lstm_forgets_over_its_window_and_then_holds(stop_and_go, random_model):
    log = stop_and_go(5, seconds=4.0)
    q = np.vstack([log.q, np.repeat(log.q[-1:], 400, axis=0)])
    still = log.replace(t=np.arange(800) / 100.0, q=q, current=q * 0.0, segment=np.zeros(800, dtype=np.int64))
    predicted = LearnedModel(random_model("lstm")).predict(still)
    assert np.ptp(predicted[430:500], axis=0).min() > 10.0 * np.ptp(predicted[600:], axis=0).max()
    assert np.ptp(predicted[600:], axis=0).max() < 1e-6


def test_truncated_hierarchies_add_up(stop_and_go, random_model):
    log = stop_and_go(6, seconds=2.0)
    trained = random_model("hrdl-md")
    whole = LearnedModel(trained)
    first = whole.truncated(1)
    assert first.hierarchies == 1
    silent = trained.output_gain.copy()
    silent[1:] = 0.0
    expected = LearnedModel(dataclasses.replace(trained, output_gain=silent)).predict(log)
    np.testing.assert_allclose(first.predict(log), expected, rtol=1e-12)
    with pytest.raises(InputError, match="4 hierarchies"):
        whole.truncated(4)


def test_a_log_or_robot_that_does_not_fit_is_refused(arm, stop_and_go, random_model):
    model = LearnedModel(random_model("mlp", n=3))
    with pytest.raises(InputError, match="2 joints where the model has 3"):
        model.predict(stop_and_go(7, seconds=1.0))
    with pytest.raises(InputError, match="trained for joints joint_1, joint_2, joint_3"):
        model.require(arm)
    arm.unit = "A"
    with pytest.raises(InputError, match="predicts %Use where the card has A"):
        LearnedModel(random_model("mlp")).require(arm)


def test_saved_and_loaded_it_predicts_the_same(tmp_path, stop_and_go, random_model):
    log = stop_and_go(8, seconds=2.0)
    for method in METHODS[:-1]:
        model = LearnedModel(random_model(method))
        model.save(tmp_path / method)
        np.testing.assert_array_equal(LearnedModel.load(tmp_path / method).predict(log), model.predict(log))


def test_a_hybrid_keeps_its_physics(tmp_path, stop_and_go, random_model):
    robot = load_robot("vs060")
    terms = tuple(
        dataclasses.replace(initial_term(Viscous(j)), coefficients=np.array([3.0]), std=np.zeros(1)) for j in range(6)
    )
    physics = CurrentModel(robot, terms, 20.0, 100.0, np.ones(6), robot.unit)
    trained = dataclasses.replace(random_model("hybrid", n=6), joints=robot.joints, unit=robot.unit)
    log = stop_and_go(9, seconds=2.0, n=6)
    model = LearnedModel(trained, physics)
    predicted = model.predict(log)
    network = LearnedModel(trained).predict(log)
    np.testing.assert_allclose(predicted - network, physics.predict(log, causal=True), atol=1e-9)
    np.testing.assert_allclose(stepwise(model, log), predicted, rtol=0.0, atol=1e-9)
    model.save(tmp_path)
    np.testing.assert_array_equal(LearnedModel.load(tmp_path, robot).predict(log), predicted)
    with pytest.raises(InputError, match="needs the robot"):
        LearnedModel.load(tmp_path)


def test_broken_folders_are_refused(tmp_path, random_model):
    with pytest.raises(InputError, match=r"model\.json is missing"):
        LearnedModel.load(tmp_path)
    LearnedModel(random_model("mlp")).save(tmp_path)
    (tmp_path / "weights.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="broken trained model"):
        LearnedModel.load(tmp_path)


@pytest.mark.parametrize("method", ["rdl-md", "hrdl-md"])
def test_ten_minutes_at_rest_change_nothing(method, stop_and_go, random_model):
    motion = stop_and_go(7, seconds=20.0)
    q = np.concatenate([motion.q, np.repeat(motion.q[-1:], 60_000, axis=0)])
    log = JointLog(np.arange(len(q)) / 100.0, q, np.zeros_like(q))
    model = LearnedModel(random_model(method, width=8))
    rest = model.predict(log)[len(motion) + 200 :]
    np.testing.assert_allclose(rest, np.broadcast_to(rest[0], rest.shape), rtol=0.0, atol=1e-5)
    # nor has it forgotten the way that it came
    fresh = model.predict(log[len(motion) :])[-1]
    assert np.abs(rest[-1] - fresh).max() > 1e-3
