"""The cut-off of the filter by which the gap workflow sees a log."""

from dataclasses import replace

import numpy as np
import pytest
from planar_arm import logs, record

from ident.gap import baseline, baseline_model
from ident.gap.rests import no_rests
from ident.gap.smoothing import Smoothed, smoothed
from ident.identification import identify
from ident.start import start_of

PLAIN = ("coulomb", "viscous")


def test_cut_off_is_the_one_that_predicts_best_unless_it_is_given(arm):
    def counted(seed):
        log = record(arm, seed)
        return log.replace(q=np.round(log.q / 1e-3) * 1e-3)

    train = [counted(seed) for seed in (1, 2, 3)]
    spectrum = start_of(arm, train).cutoff.hertz
    chosen = baseline_model(arm, train)
    assert identify(arm, train, effects=PLAIN).cutoff.hertz == chosen.cutoff
    assert identify(arm, train, effects=PLAIN, cutoff=spectrum).cutoff.hertz == spectrum
    given = baseline_model(arm, train, cutoff=spectrum)
    assert given.cutoff == spectrum
    assert chosen.cutoff < spectrum
    errors = [np.nanmean((train[0].current - m.predict(train[0])) ** 2) for m in (chosen, given)]
    assert errors[0] < errors[1]


def test_the_cut_off_is_sought_beyond_a_worse_step(arm, monkeypatch):
    model = replace(identify(arm, logs(arm, 1), effects=PLAIN).model, cutoff=20.0)
    errors = {20.0: 0.0, 14.0: 0.5, 9.8: -1.0, 6.86: -0.99, 4.8: -0.98}

    unused = baseline._Logs([], False, no_rests(2), 0.0)

    def tried(model, logs):
        return Smoothed(model, errors[round(model.cutoff, 2)], 100)

    monkeypatch.setattr(baseline, "_best_velocities", tried)
    assert baseline._followed(tried(model, unused), 0.7, unused).model.cutoff == pytest.approx(9.8)


@pytest.mark.parametrize(("factor", "steps"), [(0.7, 0), (1.0 / 0.7, 1)])
def test_one_joint_that_predicts_better_lifts_the_cut_off_and_does_not_lower_it(arm, monkeypatch, factor, steps):
    model = replace(identify(arm, logs(arm, 1), effects=PLAIN).model, cutoff=10.0)
    unused = baseline._Logs([], False, no_rests(2), 0.0)

    def tried(model, logs):
        return Smoothed(model, 0.0 if model.cutoff == 10.0 else -0.08, 100)

    monkeypatch.setattr(baseline, "_best_velocities", tried)
    found = baseline._followed(tried(model, unused), factor, unused)
    assert found.model.cutoff == pytest.approx(10.0 * factor**steps)


def test_rows_at_the_ends_of_logs_do_not_choose_the_cut_off(arm):
    train = logs(arm, 1)
    model = identify(arm, train, effects=PLAIN).model
    spoilt = [log.replace(current=log.current + 20.0 * (log.t < 0.2)[:, None]) for log in train]
    usual, left_out, seen = (
        smoothed(model, sources, no_rests(2), ends).error
        for sources, ends in ((train, 0.3), (spoilt, 0.3), (spoilt, 0.0))
    )
    assert left_out == pytest.approx(usual, abs=1e-6)
    assert seen > usual + 1.0
