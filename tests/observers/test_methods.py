"""Estimators by name, the noise they are tuned by, and what they refuse."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import JointLog, Sample
from ident.model import CurrentModel
from ident.robot import Robot
from observers.direct import DirectEstimator
from observers.kalman import KalmanObserver
from observers.methods import METHODS, make_estimator
from observers.momentum import MomentumObserver
from observers.noise import MomentumNoise, measure_noise
from observers.residual import Flag, Residual, ResidualEstimator


@pytest.fixture
def model(vs060: Robot, true_model: Callable[..., CurrentModel]) -> CurrentModel:
    return true_model(vs060)


def noisy(rows: int, deviation: float) -> JointLog:
    """A slow motion with noise of this deviation on the current and 1e-5 rad on the position."""
    rng = np.random.default_rng(3)
    t = np.arange(rows) / 100.0
    q = 0.3 * np.sin(t[:, None] + np.arange(6)) + 1e-5 * rng.standard_normal((rows, 6))
    return JointLog(t=t, q=q, current=np.cos(t)[:, None] + deviation * rng.standard_normal((rows, 6)))


def test_noise_is_that_of_the_signals(model: CurrentModel) -> None:
    noise = measure_noise(model, [noisy(4000, 0.5)])
    np.testing.assert_allclose(noise.force, 0.5, rtol=0.05)
    # at rest the momentum an observer sees is noise alone
    rng = np.random.default_rng(4)
    still = JointLog(
        t=np.arange(20_000) / 100.0, q=1e-5 * rng.standard_normal((20_000, 6)), current=np.zeros((20_000, 6))
    )
    signals = MomentumObserver(model)._signals(still.t, still.q, still.current, None, np.ones(20_000))
    seen = signals.momentum.std(axis=0)
    np.testing.assert_allclose(measure_noise(model, [still]).momentum, seen, rtol=0.1)


def test_noise_free_log_still_gives_a_filter(model: CurrentModel) -> None:
    still = JointLog(t=np.arange(400) / 100.0, q=np.zeros((400, 6)), current=np.zeros((400, 6)))
    noise = measure_noise(model, [still])
    assert np.all(noise.force > 0.0)
    assert np.isfinite(KalmanObserver(model, noise).run(still).current).all()


def test_kalman_follows_with_its_bandwidth_whatever_the_noise(model: CurrentModel) -> None:
    log = noisy(600, 0.0)
    pushed = log.replace(current=log.current - np.where(log.t > 3.0, 5.0, 0.0)[:, None])
    for force, momentum in ((1.0, 1e-4), (1.0, 0.05), (0.01, 0.05)):
        observer = KalmanObserver(model, MomentumNoise(np.full(6, force), np.full(6, momentum)), 2.0)
        rise = observer.run(pushed).current - observer.run(log).current
        reached = np.argmax(rise[300:] > 2.5, axis=0) / 100.0
        # half the way of a first or second order of 2 Hz, and the filter of motion
        assert np.all((reached > 0.05) & (reached < 0.25))


@pytest.mark.parametrize("method", METHODS)
def test_every_name_makes_an_estimator(method: str, model: CurrentModel) -> None:
    log = noisy(300, 0.1)
    estimator = make_estimator(method, model, [log], 3.0)
    assert isinstance(estimator, ResidualEstimator)
    assert np.isfinite(estimator.run(log).current).all()


def test_what_cannot_be_is_refused(model: CurrentModel, tmp_path: Path) -> None:
    log = noisy(100, 0.1)
    with pytest.raises(InputError, match="no method"):
        make_estimator("magic", model, [log])
    with pytest.raises(InputError, match="bandwidth"):
        MomentumObserver(model, -1.0)
    with pytest.raises(InputError, match="bandwidth"):
        MomentumObserver(model, np.ones(5))
    with pytest.raises(InputError, match="decay"):
        KalmanObserver(model, measure_noise(model, [log]), decay=-1.0)
    with pytest.raises(InputError, match="measured velocities"):
        MomentumObserver(model, filtered=False).run(log)
    with pytest.raises(InputError, match="measured velocities"):
        MomentumObserver(model, filtered=False).step(Sample(0.0, np.zeros(6), np.zeros(6)))
    with pytest.raises(InputError, match="one a joint"):
        MomentumObserver(model).step(Sample(0.0, np.zeros(5), np.zeros(6)))
    short = JointLog(t=log.t, q=log.q[:, :5], current=log.current[:, :5])
    for estimator in (MomentumObserver(model), DirectEstimator(model, 100.0)):
        with pytest.raises(InputError, match="5 joints"):
            estimator.run(short)
    with pytest.raises(InputError, match="no residual"):
        Residual.load(tmp_path / "none.parquet")


class Slow:
    """Predicts nought once it has seen five samples, like a network that needs history."""

    unit, n = "A", 6

    def reset(self) -> None:
        self.seen = 0

    def step(self, sample: Sample) -> FloatArray:
        self.seen += 1
        return np.zeros(6) if self.seen > 5 else np.full(6, np.nan)

    def predict(self, log: JointLog, causal: bool = False) -> FloatArray:
        known = np.zeros(log.q.shape)
        for segment in log.segments():
            known[segment][:5] = np.nan
        return known


def test_direct_waits_for_a_predictor_that_needs_history() -> None:
    log = noisy(200, 0.1).replace(segment=np.repeat([0, 1], 100))
    estimator = DirectEstimator(Slow(), 100.0, gain=np.full(6, 2.0))
    residual = estimator.run(log)
    settling = np.flatnonzero(residual.flags & int(Flag.SETTLING))
    np.testing.assert_array_equal(settling, [0, 1, 2, 3, 4, 100, 101, 102, 103, 104])
    np.testing.assert_array_equal(residual.current[settling], 0.0)
    np.testing.assert_array_equal(residual.current[residual.good], -log.current[residual.good])
    assert residual.torque is not None
    np.testing.assert_array_equal(residual.torque, 2.0 * residual.current)
    estimator.reset()
    stepped = [estimator.step(sample) for sample in log[:100].samples()]
    np.testing.assert_array_equal(stepped, residual.current[:100])
