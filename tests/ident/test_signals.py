from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.errors import InputError
from ident.log import JointLog
from ident.signals import (
    CausalButterworth,
    CausalDerivatives,
    choose_cutoff,
    decimate,
    derive,
    differentiate,
    late,
    zero_phase,
)

DATA = Path(__file__).parents[2].parent / "shared" / "data"
RATE, CUTOFF = 100.0, 10.0


def sine_log(seconds=20.0, rate=RATE, jitter=0.0, hertz=1.5, noise=0.0, seed=0, **arrays):
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    t = t + rng.uniform(-jitter, jitter, len(t)) / rate
    w = 2 * np.pi * hertz
    phase = np.stack([w * t, 0.6 * w * t + 1.0], axis=1)
    factor = np.array([w, 0.6 * w])
    q = np.sin(phase) + noise * rng.normal(size=phase.shape)
    truth = np.sin(phase), factor * np.cos(phase), -(factor**2) * np.sin(phase)
    return JointLog(t, q, np.zeros_like(q), **arrays), truth


def response(x, hertz):
    """Complex amplitude of a signal's middle at a frequency."""
    k = np.arange(len(x))[200:-200]
    return 2.0 * np.mean(x[200:-200] * np.exp(-2j * np.pi * hertz / RATE * k))


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_both_filters_are_3_db_down_at_the_cutoff(order):
    x = np.zeros((8001, 1))
    x[4000] = 1.0
    forward_backward = zero_phase(x, RATE, CUTOFF, order)[:, 0]
    causal = CausalButterworth(RATE, CUTOFF, order, 1).run(x)[:, 0]
    turn = np.exp(-2j * np.pi * CUTOFF / RATE * np.arange(-4000, 4001))
    for impulse in (forward_backward, causal):
        assert abs(impulse @ turn) == pytest.approx(np.sqrt(0.5), rel=1e-6)
    assert np.allclose(forward_backward, forward_backward[::-1], atol=1e-12)


def test_causal_filter_is_scipys_design_started_at_rest():
    x = 3.0 + np.random.default_rng(0).normal(size=(300, 2))
    ours = CausalButterworth(RATE, CUTOFF, 3, 2).run(x)
    theirs = scipy.signal.lfilter(*scipy.signal.butter(3, 2 * CUTOFF / RATE), x - x[0], axis=0) + x[0]
    assert np.allclose(ours, theirs, atol=1e-12)


def test_causal_filter_step_by_step_is_run_and_survives_a_broken_row():
    x = np.random.default_rng(1).normal(size=(50, 3))
    x[20, 1] = np.nan
    whole, single = CausalButterworth(RATE, CUTOFF, channels=3), CausalButterworth(RATE, CUTOFF, channels=3)
    y = whole.run(x)
    assert np.array_equal(y, np.array([single.step(row) for row in x]), equal_nan=True)
    assert np.flatnonzero(np.isnan(y).any(axis=1)).tolist() == [20]
    assert np.array_equal(y[21:], CausalButterworth(RATE, CUTOFF, channels=3).run(np.delete(x, 20, axis=0))[20:])


def test_constant_stays_constant_to_the_ends():
    x = np.full((100, 2), 0.7)
    assert np.allclose(zero_phase(x, RATE, CUTOFF), 0.7, atol=1e-12)
    assert np.allclose(CausalButterworth(RATE, CUTOFF, channels=2).run(x), 0.7, atol=1e-12)


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 50.0, 80.0])
def test_impossible_cutoffs_are_refused(cutoff):
    for make in (lambda: zero_phase(np.zeros((100, 1)), RATE, cutoff), lambda: CausalDerivatives(RATE, cutoff, 1)):
        with pytest.raises(InputError, match="cut-off"):
            make()


def test_derivative_on_irregular_stamps():
    log, (_, dq, _) = sine_log(jitter=0.3)
    assert np.abs(differentiate(log.t, log.q) - dq)[5:-5].max() < 2e-3 * dq.max()


def test_derivative_of_a_single_row_is_unknown():
    assert np.isnan(differentiate(np.zeros(1), np.zeros((1, 2)))).all()


@pytest.mark.parametrize("jitter", [0.0, 0.003, 0.3])
def test_zero_phase_motion_has_no_lag(jitter):
    log, (q, dq, ddq) = sine_log(jitter=jitter)
    motion = derive(log, CUTOFF)
    for ours, truth in ((motion.q, q), (motion.dq, dq), (motion.ddq, ddq)):
        assert np.abs(ours - truth)[100:-100].max() < 2e-3 * np.abs(truth).max()
    assert motion.t is log.t


@pytest.mark.parametrize("rows", [13, 2000])
def test_motion_that_goes_on_beyond_a_logs_ends_has_its_acceleration_there(rows):
    log, (_, _, ddq) = sine_log()
    part = slice(900, 900 + rows)
    error = np.abs(derive(log[part], CUTOFF).ddq - ddq[part]) / np.abs(ddq).max()
    assert error.max() < (0.2 if rows < 20 else 0.02)  # too few rows for more than a cubic


def test_the_published_mistake_of_four_times_the_cutoff_would_show():
    log, (_, _, ddq) = sine_log(noise=1e-4)
    good = np.std((derive(log, CUTOFF).ddq - ddq)[100:-100])
    assert np.std((derive(log, 4 * CUTOFF).ddq - ddq)[100:-100]) > 5 * good


@pytest.mark.parametrize("jitter", [0.0, 0.4])
@pytest.mark.parametrize("logged", [(), ("dq",), ("dq", "ddq")])
def test_online_derivatives_equal_the_whole_log(jitter, logged):
    log, (_, dq, ddq) = sine_log(seconds=4.0, jitter=jitter, noise=1e-3)
    given_arrays = {"dq": dq, "ddq": ddq}
    log = log.replace(**{key: given_arrays[key] for key in logged}, segment=np.repeat([0, 4], len(log) // 2))
    motion = derive(log, CUTOFF, causal=True)
    for rows in log.segments():
        online = CausalDerivatives(log.rate, CUTOFF, log.n)
        for k, sample in enumerate(log[rows].samples(), rows.start):
            q_k, dq_k, ddq_k = online.step(sample.t, sample.q, sample.dq, sample.ddq)
            assert np.array_equal(q_k, motion.q[k])
            assert np.array_equal(dq_k, motion.dq[k])
            assert np.array_equal(ddq_k, motion.ddq[k])


def test_causal_position_is_the_causal_butterworth():
    log, _ = sine_log(noise=1e-2)
    assert np.allclose(derive(log, CUTOFF, causal=True).q, CausalButterworth(RATE, CUTOFF, 3, 2).run(log.q), atol=1e-10)


def test_causal_derivatives_share_one_lag():
    log, _ = sine_log()
    motion = derive(log, CUTOFF, causal=True)
    turn = 2j * np.pi * 1.5
    q = response(motion.q[:, 0], 1.5)
    assert response(motion.dq[:, 0], 1.5) / (turn * q) == pytest.approx(1.0, abs=2e-3)
    assert response(motion.ddq[:, 0], 1.5) / (turn**2 * q) == pytest.approx(1.0, abs=4e-3)


def test_measured_velocity_is_used_where_given():
    log, (_, dq, _) = sine_log()
    for causal in (False, True):
        doubled = derive(log.replace(dq=2.0 * dq), CUTOFF, causal)
        plain = derive(log.replace(dq=dq), CUTOFF, causal)
        assert np.allclose(doubled.dq, 2.0 * plain.dq)
        assert np.allclose(doubled.ddq, 2.0 * plain.ddq)
        assert np.array_equal(doubled.q, plain.q)


def test_online_derivatives_survive_repeated_stamps_nan_and_dropped_samples():
    log, (_, dq, _) = sine_log(seconds=6.0)
    reference = derive(log, CUTOFF, causal=True)
    online = CausalDerivatives(RATE, CUTOFF, 2)
    for k in range(400):
        if k == 250:
            continue  # dropped
        before = online.step(log.t[k], log.q[k])
        if k == 200:
            assert np.isnan(online.step(log.t[k] + 0.001, np.array([np.nan, 0.0]))).all()
            assert np.array_equal(online.step(log.t[k], log.q[k] + 1.0), before)
            assert np.array_equal(online.step(log.t[k] - 0.5, log.q[k] + 1.0), before)
    after = online.step(log.t[400], log.q[400])
    assert np.allclose(after[1], reference.dq[400], atol=1e-6 * dq.max())
    assert np.allclose(after[2], reference.ddq[400], atol=1e-4 * np.abs(reference.ddq).max())


def test_one_dropped_sample_hardly_shows():
    log, (_, dq, _) = sine_log()
    keep = np.arange(len(log)) != 1000
    thin = JointLog(log.t[keep], log.q[keep], log.current[keep])
    whole = derive(log, CUTOFF, causal=True)
    assert np.abs(derive(thin, CUTOFF, causal=True).dq - whole.dq[keep]).max() < 5e-3 * dq.max()
    assert np.abs(derive(thin, CUTOFF).dq - derive(log, CUTOFF).dq[keep])[100:-100].max() < 5e-3 * dq.max()


def test_a_long_gap_parts_a_segment():
    log, (_, dq, _) = sine_log()
    t = log.t + np.where(np.arange(len(log)) >= 1000, 60.0, 0.0)
    motion = derive(log.replace(t=t), CUTOFF)
    assert np.abs(motion.dq - dq)[100:900].max() < 2e-3 * dq.max()
    assert np.abs(motion.dq).max() < 1.2 * dq.max()


def test_rows_of_short_segments_are_unknown_and_others_are_not():
    log, _ = sine_log()
    motion = derive(log.replace(segment=(np.arange(len(log)) < 5).astype(np.int64)), CUTOFF)
    assert np.isnan(motion.ddq[:5]).all()
    assert np.isfinite(motion.ddq[5:]).all()
    assert np.isfinite(motion.q).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.5, 30.0), st.integers(1, 60))
def test_derive_is_finite_or_wholly_nan_for_any_stamps(seed, cutoff, rows):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([0.001, 0.01, 0.011, 0.3, 7.0], rows, p=[0.1, 0.4, 0.4, 0.05, 0.05]))
    log = JointLog(t, rng.normal(size=(rows, 2)), np.zeros((rows, 2)))
    if rows < 2 or cutoff >= 0.5 * log.rate:
        return
    for causal in (False, True):
        motion = derive(log, cutoff, causal)
        assert np.isfinite(motion.q).all()
        assert (np.isfinite(motion.ddq).all(axis=1) == np.isfinite(motion.dq).any(axis=1)).all()


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_decimation_keeps_motion_and_removes_what_would_fold(jitter):
    log, (q, _, _) = sine_log(rate=RATE, jitter=jitter)
    hum = 0.5 * np.sin(2 * np.pi * 19.0 * log.t)[:, None]
    x, t = decimate(log.q + hum, log.t, 5)
    assert np.array_equal(t, log.t[::5])
    assert np.abs(x - q[::5])[20:-20].max() < 0.02
    assert np.abs((log.q + hum)[::5] - q[::5])[20:-20].max() > 0.3


def test_decimation_refuses_what_it_cannot_do():
    with pytest.raises(InputError, match="whole number"):
        decimate(np.zeros((100, 1)), np.arange(100.0), 0)
    with pytest.raises(InputError, match="too few"):
        decimate(np.zeros((20, 1)), np.arange(20.0), 10)


def test_chosen_cutoff_falls_with_noise_and_lies_above_the_motion():
    quiet, noisy, very_noisy = (choose_cutoff(sine_log(noise=noise)[0]) for noise in (1e-6, 1e-3, 1e-2))
    assert quiet.hertz > noisy.hertz > very_noisy.hertz > 1.5
    assert quiet.hertz <= 0.4 * RATE
    assert "noise" in noisy.reason
    assert f"{noisy.hertz:.3g} Hz" in noisy.reason


@pytest.mark.parametrize("noise", [1e-3, 1e-2, 5e-2])
def test_chosen_cutoff_is_near_the_best_there_is(noise):
    log, (_, _, ddq) = sine_log(noise=noise, seconds=60.0)

    def error(cutoff):
        return np.std((derive(log, cutoff).ddq - ddq)[100:-100] / np.std(ddq, axis=0))

    best = min(error(cutoff) for cutoff in np.geomspace(1.0, 40.0, 40))
    assert error(choose_cutoff(log).hertz) < max(1.5 * best, 0.04)


def test_cutoff_of_logs_that_say_nothing():
    still = JointLog(np.arange(1000) / RATE, np.zeros((1000, 2)), np.zeros((1000, 2)))
    assert "no joint moves" in choose_cutoff(still).reason
    short, _ = sine_log(seconds=0.3)
    assert "too short" in choose_cutoff(short).reason


measured = pytest.mark.skipif(not DATA.is_dir(), reason="the measured logs are not here")


def measured_log(name):
    """Positions (and velocities) of a measured log; it is motion that is tried here, so currents are left at nought."""
    if name.startswith("kuka"):
        file = np.load(DATA / name)
        t, q, dq = file["times"], file["positions"], file["velocities"]
    elif name.startswith("panda"):
        t, q, dq = (np.loadtxt(DATA / name / f"exciting_traj_{k}.txt") for k in ("time", "positions", "velocity"))
        q, dq = q.reshape(-1, 7), dq.reshape(-1, 7)
    else:
        file = scipy.io.loadmat(DATA / name)
        t, q, dq = file["mt"], file["mq"], file["mdq"]
    return JointLog(t.ravel(), q, np.zeros_like(q), dq=dq)


@measured
@pytest.mark.parametrize(
    "name", ["ur3_aspectum/id1.mat", "ur3_aspectum/id2.mat", "kuka_lwr4_flobaroid/measurements_1.npz", "panda_inria"]
)
def test_cutoffs_of_measured_logs_are_those_of_the_field(name):
    assert 4.0 < choose_cutoff(measured_log(name)).hertz < 20.0


@measured
@pytest.mark.parametrize("name", ["ur3_aspectum/id1.mat", "ur3_aspectum/id2.mat"])
def test_derived_velocity_of_a_measured_log_is_the_logged_one(name):
    log = measured_log(name)
    cutoff = choose_cutoff(log).hertz
    derived, logged = derive(log.replace(dq=None), cutoff), derive(log, cutoff)
    error = np.sqrt(np.mean((derived.dq - logged.dq)[50:-50] ** 2, axis=0))
    assert (error < 0.03 * np.std(logged.dq, axis=0)).all()


def test_samples_that_come_late_are_told_from_standing_and_creeping_and_bend_no_derivative():
    log, _ = sine_log()
    repeated = np.zeros(len(log), dtype=bool)
    repeated[[300, 301, 302, *range(520, 1500, 70)]] = True
    held = np.maximum.accumulate(np.where(repeated, 0, np.arange(len(log))))
    stale = log.replace(q=log.q[held], current=log.t[held][:, None] * np.ones(log.n))
    # Where the motion turns round nothing is lost, and nothing shows.
    found = late(stale)
    assert not found[~repeated].any()
    assert found.sum() > 0.8 * repeated.sum()
    exact, bent = derive(log, CUTOFF), derive(stale, CUTOFF)
    assert np.abs(bent.ddq - exact.ddq)[50:-50].max() < 0.02 * np.abs(exact.ddq).max()
    assert np.isnan(derive(stale[295:307], CUTOFF).ddq).all()  # too short to filter
    stands = np.concatenate([log.q[:800], np.repeat(log.q[800:801], 3, axis=0), np.repeat(log.q[800:801], 400, axis=0)])
    counts = np.round(0.3 * np.arange(len(log)) / 4) * 1e-4
    for q in (stands, np.column_stack([counts] * log.n)):
        assert not late(JointLog(np.arange(len(q)) / RATE, q, np.zeros_like(q))).any()
