"""Figures of merit against signals whose figures are known."""

import numpy as np
import pytest

from comparisons.metrics import (
    Regimes,
    auroc,
    changes,
    contact_figures,
    error_figures,
    peak,
    rmse,
    static_bias,
    static_drift_per_minute,
    touches,
)

RATE = 100.0


def regimes(dq, known=None, free=None, segment=None):
    """Regimes of velocities (N,) or (N, n) at 100 Hz."""
    dq = np.asarray(dq, dtype=float).reshape(len(dq), -1)
    segment = np.zeros(len(dq), dtype=np.int64) if segment is None else segment
    known = np.ones(dq.shape, dtype=bool) if known is None else known
    return Regimes.of(np.arange(len(dq)) / RATE, dq, segment, known, free)


def stop_and_go(rests=4, seconds=3.0):
    """Velocity of one joint that rests and moves in turn, ``seconds`` each."""
    rows = round(seconds * RATE)
    return np.tile(np.repeat([0.0, 0.1], rows), rests)


def test_moving_static_and_transition_frames():
    told = regimes(stop_and_go(2, 3.0))
    starts, stops = np.flatnonzero(told.starts[:, 0]), np.flatnonzero(told.stops[:, 0])
    np.testing.assert_array_equal(starts, [300, 900])
    np.testing.assert_array_equal(stops, [600])
    assert told.moving[:, 0].sum() == 600
    expected = np.zeros(1200, dtype=bool)
    for row in (300, 600, 900):
        expected[row : row + 50] = True
    np.testing.assert_array_equal(told.transition[:, 0], expected)


def test_threshold_of_motion_is_five_milliradians_a_second():
    told = regimes([0.0049, -0.0049, 0.0051, -0.0051, np.nan])
    np.testing.assert_array_equal(told.moving[:, 0], [False, False, True, True, False])


def test_a_reversal_or_a_flicker_is_neither_stop_nor_start():
    dq = np.full(400, 0.1)
    dq[100:105] = 0.0  # a reversal: 50 ms below the threshold
    dq[200:] = 0.0
    dq[300:303] = 0.1  # noise about it
    told = regimes(dq)
    assert told.starts.sum() == 0
    np.testing.assert_array_equal(np.flatnonzero(told.stops[:, 0]), [200])


def test_segments_do_not_see_each_other():
    segment = np.repeat([0, 1], 300)
    moving = np.repeat([[True], [False]], 300, axis=0)
    starts, stops = changes(np.arange(600) / RATE, moving, segment)
    assert starts.sum() == stops.sum() == 0


def test_rmse_by_regime_of_errors_that_differ_between_them():
    told = regimes(stop_and_go(3))
    error = np.where(told.moving, 2.0, 3.0)
    error[told.transition] = 5.0
    figures = error_figures(error, told)
    moving, static = told.moving & ~told.transition, ~told.moving & ~told.transition
    half = [told.transition & told.moving, told.transition & ~told.moving]
    expected = np.sqrt((4 * moving.sum() + 25 * half[0].sum()) / told.moving.sum())
    assert figures["rmse_moving"][0] == pytest.approx(expected)
    expected = np.sqrt((9 * static.sum() + 25 * half[1].sum()) / (~told.moving).sum())
    assert figures["rmse_static"][0] == pytest.approx(expected)
    assert figures["rmse_transition"][0] == pytest.approx(5.0)
    whole = 4 * moving.sum() + 9 * static.sum() + 25 * told.transition.sum()
    assert figures["rmse"][0] == pytest.approx(np.sqrt(whole / len(error)))
    assert figures["peak"][0] == 5.0


def test_frames_without_a_prediction_are_not_scored():
    error = np.array([[1.0, 1.0], [np.nan, 3.0], [1.0, np.nan]])
    np.testing.assert_allclose(rmse(error, np.ones(error.shape, dtype=bool)), [1.0, np.sqrt(5.0)])
    assert np.isnan(rmse(error, np.zeros(error.shape, dtype=bool))).all()
    np.testing.assert_array_equal(peak(error, np.array([True, False, True])), [1.0, 1.0])
    assert np.isnan(peak(np.full((3, 1), np.nan), np.ones(3, dtype=bool))).all()


def test_bias_has_a_sign_and_only_static_frames():
    told = regimes(stop_and_go())
    error = np.where(told.moving, 7.0, -1.5)
    assert static_bias(error, told)[0] == pytest.approx(-1.5)


@pytest.mark.parametrize("seconds", [3.0, 6.0])
def test_drift_is_found_whichever_way_each_rest_runs(seconds, rng):
    dq = stop_and_go(6, seconds)
    told = regimes(dq)
    rows = round(seconds * RATE)
    error = np.zeros((len(dq), 1))
    for number in range(6):
        start = 2 * number * rows
        slope = 4.0 if number % 2 else -4.0  # a minute
        error[start : start + rows, 0] = slope / 60.0 * np.arange(rows) / RATE + rng.normal()
    assert static_drift_per_minute(error, told)[0] == pytest.approx(4.0, rel=1e-9)
    # one direction only is the same, and an offset that differs between rests is no drift
    assert static_drift_per_minute(np.where(told.moving, error, 2.0), told)[0] == pytest.approx(0.0, abs=1e-9)


def test_noise_makes_the_drift_that_the_docstring_says(rng):
    seconds = 10.0
    dq = stop_and_go(40, seconds)
    error = rng.normal(size=(len(dq), 1))
    length = seconds - 0.5
    expected = 170.0 / (length * np.sqrt(length * RATE))
    assert static_drift_per_minute(error, regimes(dq))[0] == pytest.approx(expected, rel=0.25)


def test_no_rest_no_drift():
    assert np.isnan(static_drift_per_minute(np.zeros((100, 1)), regimes(np.full(100, 0.1)))).all()


def test_unknown_history_is_told_apart():
    known = np.repeat([[False], [True]], 100, axis=0)
    figures = error_figures(np.where(known, 1.0, 10.0), regimes(np.zeros(200), known))
    assert figures["rmse_known_history"][0] == pytest.approx(1.0)
    assert figures["rmse_unknown_history"][0] == pytest.approx(10.0)
    assert figures["rmse"][0] == pytest.approx(np.sqrt(50.5))


def test_touched_rows_and_what_they_leave_are_no_error():
    tau = np.zeros((1000, 2))
    tau[400:500, 1] = -3.0
    t, segment = np.arange(1000) / RATE, np.zeros(1000, dtype=np.int64)
    touched, free = touches(t, tau, segment)
    np.testing.assert_array_equal(np.flatnonzero(touched), np.arange(400, 500))
    np.testing.assert_array_equal(np.flatnonzero(~free), np.arange(400, 600))
    error = np.where(free[:, None], 1.0, 100.0) * np.ones((1, 2))
    figures = error_figures(error, regimes(np.zeros((1000, 2)), free=free))
    np.testing.assert_allclose(figures["rmse"], 1.0)
    np.testing.assert_allclose(figures["peak"], 1.0)


def test_contacts_missed_late_and_false():
    t = np.arange(360_000) / RATE  # an hour
    segment = np.zeros(len(t), dtype=np.int64)
    tau = np.zeros((len(t), 1))
    told = np.zeros(len(t), dtype=bool)
    for number, delay in enumerate((0.1, 0.2, 0.3, None)):
        start = 50_000 + 50_000 * number
        tau[start : start + 200] = 2.0
        if delay is not None:
            told[start + round(delay * RATE) : start + 200] = True
    told[10_000:10_010] = told[10_030:10_040] = True  # 0.2 s apart: one
    told[20_000:20_010] = True
    touched, free = touches(t, tau, segment)
    figures = contact_figures(regimes(np.zeros(len(t)), free=free), touched, told, told.astype(float))
    assert figures["contacts"] == 4
    assert figures["missed"] == 1
    assert figures["delay_median"] == pytest.approx(0.2)
    assert figures["delay_p95"] == pytest.approx(0.29)
    assert figures["false_alarms_per_hour"] == pytest.approx(2.0, rel=0.01)
    share, false = told[touched].mean(), told[free].mean()
    assert figures["auroc"] == pytest.approx(0.5 * (1.0 + share - false), abs=1e-9)


def test_auroc_of_known_orders(rng):
    assert auroc(np.array([1.0, 2.0, 3.0, 4.0]), np.array([False, False, True, True])) == 1.0
    assert auroc(np.array([4.0, 3.0, 2.0, 1.0]), np.array([False, False, True, True])) == 0.0
    assert auroc(np.ones(4), np.array([False, True, True, True])) == 0.5
    assert auroc(np.ones(4), np.ones(4, dtype=bool)) is None
    score, positive = rng.normal(size=300).round(1), rng.random(300) < 0.3
    pairs = score[positive][:, None] - score[~positive][None]
    assert auroc(score, positive) == pytest.approx(np.mean((pairs > 0) + 0.5 * (pairs == 0)))
