"""Currents that come late: by which law, on which joints, and signs of velocity chosen anew once that is known."""

from dataclasses import replace

import numpy as np
import pytest
from planar_arm import NOISE, RATE, delayed, logs, record
from scipy.signal import lfilter

from ident.effects import load_catalogue
from ident.effects.friction import Coulomb
from ident.effects.timing import Delay, FilterLag
from ident.gap import baseline_model, belief, find_gap
from ident.gap.candidates import Trial
from ident.gap.joint_gap import Named
from ident.gap.lateness import InTime, turned_in_time
from ident.gap.rests import find_rests
from ident.gap.rows import held_of, panel_of
from ident.log import JointLog

LATE = 0.019


def smoothings(model):
    return np.array([term.effect.smoothing for term in model.terms if isinstance(term.effect, Coulomb)])


def test_a_late_current_does_not_blur_the_sign_of_velocity(arm):
    train = [delayed(record(arm, seed), LATE) for seed in (1, 2, 3)]
    test = [delayed(record(arm, 9), LATE)]
    model = baseline_model(arm, train)
    found = find_gap(model, train, test)
    assert (smoothings(found.model) < 0.8 * smoothings(model)).all()
    (late,) = found.findings
    assert (late.effect, late.parameters["seconds"]) == ("delay", pytest.approx(LATE, rel=0.01))
    assert not found.unexplained
    assert (found.evidence.after < 1.02 * NOISE).all()


def test_a_log_in_time_has_the_motion_that_its_currents_are_of():
    t = np.arange(300) / 100.0
    log = JointLog(t=t, q=np.sin(t)[:, None], dq=np.cos(t)[:, None], current=np.sin(t - LATE)[:, None])
    log = replace(log, segment=np.repeat([0, 1], [100, 200]))
    whole = InTime(log, LATE).read()
    np.testing.assert_array_equal(whole.t, np.delete(t, [0, 1, 100, 101]))
    np.testing.assert_allclose(whole.q, whole.current, atol=1e-6)
    np.testing.assert_allclose(whole.dq[:, 0], np.cos(whole.t - LATE), atol=1e-6)
    for rows in (1000, 50, 7):
        blocks = list(InTime(log, LATE).blocks(rows))
        assert all(len(block) and np.ptp(block.segment) == 0 for block in blocks)
        np.testing.assert_array_equal(np.concatenate([block.t for block in blocks]), whole.t)
        np.testing.assert_allclose(np.concatenate([block.q for block in blocks]), whole.q, atol=1e-9)
    early = InTime(log, -LATE).read()
    np.testing.assert_array_equal(early.t, np.delete(t, [98, 99, 298, 299]))


def test_segments_shorter_than_the_lateness_have_no_motion_of_then(arm):
    logs = [record(arm, seed) for seed in (1, 2)]
    cut = [
        log.replace(segment=np.searchsorted([100, 101, len(log.t) - 2], np.arange(len(log.t)), "right")) for log in logs
    ]
    for log in cut:
        assert set(InTime(log, LATE).read().t.tolist()) < set(log.t.tolist())
        assert sum(len(block) for block in InTime(log, LATE).blocks(16384)) == len(log.t) - 2 - 1 - 2 - 2
    model = baseline_model(arm, logs)
    assert len(smoothings(turned_in_time(model, cut, find_rests(model, cut), np.full(2, LATE)))) == 2
    assert len(InTime(cut[0][100:101], LATE).read()) == 0


def test_signs_are_chosen_anew_where_currents_come_late_alone(arm):
    train = [record(arm, seed) for seed in (1, 2)]
    own = [delayed(log, LATE).current[:, 1] for log in train]
    late = [log.replace(current=np.column_stack([log.current[:, 0], i])) for log, i in zip(train, own, strict=True)]
    model = baseline_model(arm, late)
    turned = turned_in_time(model, late, find_rests(model, late), np.array([0.0, LATE]))
    assert smoothings(turned)[0] == smoothings(model)[0]
    assert smoothings(turned)[1] < 0.8 * smoothings(model)[1]


def test_how_late_a_current_comes_in_slow_motion():
    delay, lag = Delay(None, sample=0.01), FilterLag(None)
    assert delay.lateness(np.array([0.03]), np.array([0.028])) == 0.03
    assert delay.lateness(np.array([0.005]), np.array([0.004])) == 0.004
    assert lag.lateness(np.array([10.0]), np.array([0.5])) == pytest.approx(0.5 / (20.0 * np.pi))


@pytest.mark.parametrize("law", ["delay", "filter-lag"])
def test_a_late_current_is_told_by_what_its_law_allows(arm, law):
    def late(seed):
        log = record(arm, seed)
        pole = np.exp(-2 * np.pi * 15.0 / RATE)
        filtered = lfilter([1 - pole], [1, -pole], log.current, axis=0, zi=pole * log.current[:1])[0]
        return delayed(log, 0.01) if law == "delay" else log.replace(current=filtered)

    train = [late(seed) for seed in (1, 2, 3)]
    (one,) = find_gap(baseline_model(arm, train), train).findings
    assert (one.effect, one.joints) == (law, ())


def test_a_lead_over_more_than_a_sample_is_no_delay(arm):
    def early(log):
        return log.replace(current=log.current + 0.3 * (log.current - delayed(log, 0.1).current))

    train = [early(log) for log in logs(arm, 1)]
    found = find_gap(baseline_model(arm, train), train)
    assert not any(one.effect == "delay" and one.parameters["seconds"] < 0.0 for one in found.findings)
    assert found.findings or found.unexplained


def test_a_delay_that_shows_on_one_joint_most_is_borne_out_by_the_others(arm):
    def late(seed):
        log = delayed(record(arm, seed), 0.004)
        noise = 0.5 * np.random.default_rng(seed).standard_normal(len(log.t))
        return log.replace(current=log.current + noise[:, None] * [1.0, 0.0])

    train = [late(seed) for seed in (1, 2, 3)]
    (one,) = find_gap(baseline_model(arm, train), train).findings
    assert (one.effect, one.joints) == ("delay", ())
    assert one.parameters["seconds"] == pytest.approx(0.004, rel=0.1)


@pytest.mark.parametrize(("name", "at"), [("filter-lag", 3.0), ("delay", 0.02)])
@pytest.mark.parametrize(("share", "kept"), [(0.3, 0), (0.8, 1)])
def test_a_delay_or_a_filter_of_a_part_of_the_current_is_no_name(arm, monkeypatch, name, at, share, kept):
    train, effect, shape = logs(arm, 1), load_catalogue()[name](1), np.array([at])
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    gap = held_of(model, panel, 1)
    force = panel.columns(effect, shape, 1) @ effect.plain(shape)
    named = Named(Trial(effect, shape, 0.0), 0.0, 0.0)
    monkeypatch.setattr(belief, "inconstancy", lambda panel, survey, gap, names: [0.0 for _ in names])
    monkeypatch.setattr(belief, "_allowed", lambda panel, survey, gap, names: 1.0)
    assert len(belief.believed(panel, None, replace(gap, target=share * force), [named])) == kept
