"""What every residual estimator keeps, whatever it is made of."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.log import JointLog
from ident.model import CurrentModel
from ident.robot import Robot
from ident.signals import Motion
from observers.direct import DirectEstimator
from observers.disturbance import DisturbanceObserver
from observers.filtered_dynamics import FilteredDynamicsObserver
from observers.kalman import KalmanObserver
from observers.momentum import MomentumObserver
from observers.noise import MomentumNoise
from observers.residual import Flag, Residual, ResidualEstimator
from observers.sliding_mode import SlidingModeObserver

Make = Callable[[CurrentModel], ResidualEstimator]


def noise(model: CurrentModel) -> MomentumNoise:
    return MomentumNoise(np.full(model.n, 0.3), np.full(model.n, 0.01))


ESTIMATORS: dict[str, Make] = {
    "direct": lambda m: DirectEstimator(m, m.rate, m.cutoff, m.gain if m.force_unit == "N m" else None),
    "momentum": MomentumObserver,
    "kalman": lambda m: KalmanObserver(m, noise(m)),
    "kalman-full": lambda m: KalmanObserver(m, noise(m), gain="full"),
    "kalman-decay": lambda m: KalmanObserver(m, noise(m), decay=0.5),
    "disturbance": DisturbanceObserver,
    "sliding-mode": lambda m: SlidingModeObserver(m, 60.0),
    "filtered-dynamics": FilteredDynamicsObserver,
}


@pytest.fixture(scope="module", params=[1.0, None], ids=["torque", "current"])
def model(request: pytest.FixtureRequest, vs060: Robot, true_model: Callable[..., CurrentModel]) -> CurrentModel:
    return true_model(vs060, gain=request.param, friction=True)


@pytest.fixture(scope="module")
def log(model: CurrentModel) -> JointLog:
    """Four seconds in two segments, a push on joints 1 to 3 in the second of each, noise on everything."""
    rng = np.random.default_rng(1)
    t = np.arange(400) / 100.0
    phase = 2.0 * t[:, None] * np.linspace(0.5, 1.0, 6) + 0.3 * np.arange(6)
    speed = 2.0 * np.linspace(0.5, 1.0, 6)
    motion = Motion(t, 0.6 * np.sin(phase), 0.6 * speed * np.cos(phase), -0.6 * speed**2 * np.sin(phase))
    external = np.where(((t % 2.0) > 1.2)[:, None], np.array([4.0, -6.0, 3.0, 0.0, 0.0, 0.0]), 0.0)
    current = (model.force(motion, model.start()) - external) / model.gain + 0.1 * rng.standard_normal((400, 6))
    q = motion.q + 1e-5 * rng.standard_normal((400, 6))
    return JointLog(t=t, q=q, current=current, tau_ext=external, segment=np.repeat([0, 1], 200))


@pytest.fixture(params=list(ESTIMATORS), scope="module")
def estimator(request: pytest.FixtureRequest, model: CurrentModel) -> ResidualEstimator:
    return ESTIMATORS[request.param](model)


def stepped(estimator: ResidualEstimator, log: JointLog) -> tuple[np.ndarray, np.ndarray]:
    current, flags = np.empty(log.q.shape), np.empty(len(log), dtype=int)
    for segment in log.segments():
        estimator.reset()
        for k, sample in zip(range(segment.start, segment.stop), log[segment].samples(), strict=True):
            current[k], flags[k] = estimator.step(sample), int(estimator.flag)
    return current, flags


def spoilt(log: JointLog) -> JointLog:
    """Return the log with a NaN position, a NaN current, five samples dropped, and a stamp repeated."""
    q, current, t = log.q.copy(), log.current.copy(), log.t.copy()
    q[60, 2], current[90, 0] = np.nan, np.nan
    t[150] = t[149]
    kept = np.r_[0:110, 115:400]
    return JointLog(t=t[kept], q=q[kept], current=current[kept], segment=log.segment[kept])


def test_it_is_an_estimator(estimator: ResidualEstimator, model: CurrentModel) -> None:
    assert isinstance(estimator, ResidualEstimator)
    assert (estimator.n, estimator.unit) == (6, model.unit)


def test_steps_equal_the_whole_log(estimator: ResidualEstimator, log: JointLog) -> None:
    for given in (log, spoilt(log)):
        whole = estimator.run(given)
        current, flags = stepped(estimator, given)
        np.testing.assert_allclose(current, whole.current, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(flags, whole.flags)


def test_reset_forgets(estimator: ResidualEstimator, log: JointLog) -> None:
    first = stepped(estimator, log)[0]
    np.testing.assert_array_equal(stepped(estimator, log)[0], first)


def test_it_finds_the_push(estimator: ResidualEstimator, log: JointLog, model: CurrentModel) -> None:
    residual = estimator.run(log)
    assert log.tau_ext is not None
    end = slice(185, 200)
    np.testing.assert_allclose(residual.current[end].mean(axis=0), log.tau_ext[190] / model.gain, atol=0.6)
    if model.force_unit == "N m":
        assert residual.torque is not None
        np.testing.assert_allclose(residual.torque, residual.current * model.gain)
    else:
        assert residual.torque is None


def test_bad_samples_are_survived_and_flagged(estimator: ResidualEstimator, log: JointLog) -> None:
    clean, residual = estimator.run(log), estimator.run(spoilt(log))
    assert np.isfinite(residual.current).all()
    assert [k for k in range(len(residual)) if residual.flags[k] & Flag.MISSING] == [60, 90]
    assert [k for k in range(len(residual)) if residual.flags[k] & Flag.REPEATED] == [145]
    assert residual.flags[110] & Flag.GAP
    np.testing.assert_array_equal(residual.current[60], residual.current[59])
    np.testing.assert_array_equal(residual.current[145], residual.current[144])
    # what was spoilt is forgotten by the end of the segment
    np.testing.assert_allclose(residual.current[180:195], clean.current[185:200], atol=0.7)


def test_a_long_gap_starts_anew(estimator: ResidualEstimator, log: JointLog) -> None:
    t = log.t.copy()
    t[100:200] += 60.0
    residual = estimator.run(log.replace(t=t)[:200])
    assert np.isfinite(residual.current).all()
    assert residual.flags[100] & Flag.GAP
    assert np.abs(residual.current).max() < 25.0


def test_result_round_trips(estimator: ResidualEstimator, log: JointLog, tmp_path: Path) -> None:
    residual = estimator.run(spoilt(log))
    residual.save(tmp_path / "residual.parquet")
    loaded = Residual.load(tmp_path / "residual.parquet")
    np.testing.assert_array_equal(loaded.current, residual.current)
    np.testing.assert_array_equal(loaded.flags, residual.flags)
    assert (loaded.torque is None) == (residual.torque is None)
    assert loaded.unit == residual.unit
