"""After a gap in the time stamps a network's memory begins anew, and what it cannot know yet is flagged."""

import numpy as np
import pytest

from learned.gaps import longest_gap, stretches
from learned.motion_discriminator import DiscriminatorSpec
from learned.options import TrainingOptions
from learned.predictor import LearnedModel
from learned.training import train
from learned.window import frames_of
from observers.direct import DirectEstimator
from observers.residual import Flag

CUTOFF = 20.0
GAP = 2.0


def cut(log, at, rows):
    """The log without ``rows`` rows from row ``at`` on: the arm moved on, and nobody logged it."""
    kept = np.r_[0:at, at + rows : len(log)]
    return log.replace(t=log.t[kept], q=log.q[kept], current=log.current[kept], segment=log.segment[kept])


def moving_row(log, after):
    """First row from ``after`` on at which both joints move fast."""
    dq = np.gradient(log.q, log.t, axis=0)
    return after + int(np.flatnonzero((np.abs(dq[after:]) > 0.6).all(axis=1))[0])


@pytest.fixture
def broken(stop_and_go):
    """A log that lacks two seconds before a row at which both joints move, and that row."""
    log = stop_and_go(3, seconds=30.0)
    rows = round(GAP * 100.0)
    begin = moving_row(log, 1000) - rows
    return cut(log, begin, rows), begin


def test_a_gap_begins_a_stretch_of_its_own(broken):
    log, row = broken
    assert stretches(log, CUTOFF) == [slice(0, row), slice(row, len(log))]
    # a gap that the filters bridge does not
    assert stretches(cut(log[:row], 500, 10), CUTOFF) == [slice(0, row - 10)]
    # samples that are no numbers leave a gap as samples that are missing do
    q = log.q[:row].copy()
    q[500:520, 1] = np.nan
    assert stretches(log[:row].replace(q=q), CUTOFF) == [slice(0, 520), slice(520, row)]


def test_velocity_counts_as_unknown_until_the_filters_have_settled(broken):
    log, row = broken
    frames = frames_of(log, 100.0, CUTOFF)
    late = log.t - log.t[row] >= longest_gap(CUTOFF)
    np.testing.assert_array_equal(frames.finite, (np.arange(len(log)) < row) | late)
    assert np.isfinite(frames.motion.q).all()
    # once known it is nearly what it would be had nothing been missing
    first = row + int(np.flatnonzero(late[row:])[0])
    truth = np.gradient(log.q[row:], log.t[row:], axis=0)
    np.testing.assert_allclose(
        frames.motion.dq[first : first + 20], truth[first - row - 3 : first - row + 17], atol=0.25
    )


@pytest.mark.parametrize("signal", ["velocity", "median-velocity", "displacement"])
@pytest.mark.parametrize("method", ["hrdl-md", "lstm"])
@pytest.mark.parametrize("factor", [1, 2])
def test_step_by_step_equals_the_whole_log(method, signal, factor, stop_and_go, random_model):
    log = stop_and_go(4, seconds=12.0, rate=100.0 * factor)
    log = cut(cut(cut(log, 400 * factor, 131), 777, 20 * factor), 300, 6 * factor)
    q = log.q.copy()
    q[600:625, 0] = np.nan
    log = log.replace(q=q)
    spec = DiscriminatorSpec((0.002, 0.01), signal)
    model = LearnedModel(random_model(method, discriminator=spec)).at_rate(100.0 * factor)
    stepped = np.array([model.step(sample) for sample in log.samples()])
    np.testing.assert_array_equal(stepped, model.predict(log))
    assert np.isfinite(stepped[-50:]).all()


def test_a_short_gap_forgets_nothing_but_the_window(stop_and_go, random_model):
    log = stop_and_go(5, seconds=10.0)
    model = LearnedModel(random_model("hrdl-md"))
    whole = model.predict(log)
    one, many = (model.predict(cut(log, 600, rows)) for rows in (1, 6))
    assert np.isfinite(one).all()
    # six rows are missing, as much as 70 ms passed, and a window is five frames
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(many).any(axis=1)), np.arange(600, 611))
    for rows, predicted in ((1, one), (6, many)):
        np.testing.assert_allclose(predicted[650:], whole[650 + rows :], atol=1e-3)


def test_what_was_before_the_gap_is_forgotten(broken, random_model):
    log, row = broken
    model = LearnedModel(random_model("hrdl-md"))
    other = log.replace(q=np.concatenate([log.q[:row] * 0.5, log.q[row:]]))
    both = model.predict(log)[row:], model.predict(other)[row:]
    np.testing.assert_array_equal(*both)
    silent = round(longest_gap(CUTOFF) * 100.0)
    assert np.isnan(both[0][:silent]).all()
    assert np.isfinite(both[0][silent:]).all()


def test_the_residual_does_not_jump_after_a_gap(arm_card, stop_and_go, broken):
    options = TrainingOptions(
        epochs=5, batch=128, width=32, learning_rate=3e-3, cutoff=CUTOFF, hierarchies=1, signal="displacement",
        thresholds=(0.001, 0.003, 0.01),
    )  # fmt: skip
    model = train(arm_card, [stop_and_go(seed, seconds=120.0) for seed in range(3)], None, "hrdl-md", options)
    log, row = broken
    residual = DirectEstimator(model, 100.0).run(log)
    silent = slice(row, row + round(longest_gap(CUTOFF) * 100.0))
    assert residual.flags[row] & Flag.GAP
    assert (residual.flags[silent] & Flag.SETTLING).all()
    assert residual.good[silent.stop :].all()
    # until then it is what it was before the gap
    np.testing.assert_array_equal(residual.current[silent], np.repeat(residual.current[row - 1 : row], 15, axis=0))
    usual = np.abs(residual.current[100:row]).max(axis=0)
    assert (np.abs(residual.current[silent.stop : silent.stop + 100]).max(axis=0) < 1.5 * usual).all()
