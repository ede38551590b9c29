from pathlib import Path

import numpy as np
import pytest

from ident.log import JointLog
from ident.log_summary import summarise
from ident.robot import load_robot

PANDA = Path(__file__).parents[2].parent / "shared" / "data" / "panda_inria"


def made(rate=100.0, seconds=40.0, lag=0.0):
    """Joint 1 swings, joint 2 rests half the time, joint 3 never moves."""
    t = np.arange(int(rate * seconds)) / rate
    swing = np.sin(t - lag)
    half = np.where(t < seconds / 2, np.sin(t) ** 2 * 0.5, np.sin(seconds / 2) ** 2 * 0.5)
    q = np.stack([swing, half, np.full(len(t), 0.2)], axis=1)
    return JointLog(t, q, np.cos(t)[:, None] * [1.0, 2.0, 3.0], name="made")


def test_time_and_coverage():
    summary = summarise(made(), load_robot_limits())
    assert (summary.rows, summary.segments, summary.gaps, summary.repeated) == (4000, 1, 0, 0)
    assert summary.duration == pytest.approx(39.99)
    assert summary.rate == pytest.approx(100.0)
    assert summary.jitter < 1e-9
    assert summary.speed == pytest.approx([1.0, 0.5, 0.0], abs=0.02)
    assert summary.rest == pytest.approx([0.003, 0.5, 1.0], abs=0.02)
    assert summary.never_moves == (3,)
    limits = load_robot_limits()
    assert summary.range_share[0] == pytest.approx(2.0 / (limits.upper[0] - limits.lower[0]), rel=1e-3)


def load_robot_limits():
    limits = load_robot("vs060").limits
    return type(limits)(
        limits.lower[:3], limits.upper[:3], limits.velocity[:3], limits.acceleration[:3], limits.effort[:3]
    )


def test_range_share_is_unknown_without_limits():
    assert np.isnan(summarise(made()).range_share).all()


def test_jitter_gaps_repeats_and_segments():
    log = made()
    t = log.t + np.random.default_rng(0).uniform(-0.001, 0.001, len(log))
    t[2000:] += 0.5
    q, current = np.array(log.q), np.array(log.current)
    q[100:103], current[100:103] = q[100], current[100]
    segment = (np.arange(4000) >= 3000).astype(np.int64)
    summary = summarise(log.replace(t=t, q=q, current=current, segment=segment))
    assert (summary.segments, summary.gaps, summary.repeated) == (2, 1, 2)
    assert summary.jitter == pytest.approx(0.001 * np.sqrt(2 / 3), rel=0.1)
    assert summary.longest_step == pytest.approx(0.51, abs=0.002)


@pytest.mark.parametrize("step", [2e-5, 1e-3])
def test_quantisation_is_found_through_rounding_in_the_log(step):
    log = made()
    coarse = np.round(np.round(log.q / step) * step, 7)
    summary = summarise(log.replace(q=coarse, current=np.round(log.current / 0.1) * 0.1))
    assert summary.position_step[:2] == pytest.approx([step, step], rel=0.01)
    assert summary.current_step == pytest.approx([0.1] * 3, rel=0.01)


def test_no_quantisation_is_claimed_where_there_is_none():
    assert summarise(made()).position_step.tolist() == [0.0, 0.0, 0.0]


def test_lag_of_the_logged_velocity():
    log = made()
    dq = np.gradient(made(lag=0.007).q, log.t, axis=0)
    dq[:50] = 3.0  # wrong at the start, as a filtered log may be
    lag = summarise(log.replace(dq=dq)).velocity_lag
    assert lag is not None
    assert lag[0] == pytest.approx(0.007, abs=0.0005)
    assert np.isnan(lag[2])


def test_short_segments_are_summarised_too():
    log = made()[:40]
    summary = summarise(log.replace(segment=np.arange(40) // 4))
    assert summary.segments == 10
    assert summary.speed[0] == pytest.approx(1.0, abs=0.1)


def test_text_names_what_people_look_for():
    log = made()
    text = str(summarise(log.replace(dq=np.gradient(log.q, log.t, axis=0)), load_robot_limits()))
    for words in ("made: 4000 rows, 39.99 s in 1 segment", "100.00 Hz", "0 gaps", "never moving: joint 3", "34 %"):
        assert words in text
    assert "velocity lag" in text
    header, rows = summarise(log).table()
    assert [len(row) for row in rows] == [len(header)] * 3


@pytest.mark.skipif(not PANDA.is_dir(), reason="the measured logs are not here")
def test_velocity_of_the_measured_panda_lags_by_5_ms():
    t, q, dq, current = (
        np.loadtxt(PANDA / f"exciting_traj_{name}.txt") for name in ("time", "positions", "velocity", "torques")
    )
    log = JointLog(t.ravel(), q.reshape(-1, 7), current.reshape(-1, 7), dq.reshape(-1, 7))
    summary = summarise(log)
    assert summary.velocity_lag == pytest.approx(np.full(7, 0.005), abs=0.0006)
    assert summary.longest_step == pytest.approx(0.0088, abs=1e-4)
    assert summary.gaps > 100
