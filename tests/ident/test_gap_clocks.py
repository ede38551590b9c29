"""Logs whose clocks begin anew: put on one clock, and with heat and drift that go on from log to log, or do not."""

from dataclasses import replace

import numpy as np
import pytest
from planar_arm import NOISE, motion, record

from ident.effects.base import Term
from ident.effects.elapsed import PAUSE, elapsed
from ident.effects.electrical import SensorDrift
from ident.effects.friction import Coulomb
from ident.effects.thermal import ThermalFriction
from ident.gap import baseline_model, find_gap
from ident.gap.clocks import Clock, by_own_clock, clock_warnings, on_one_clock
from ident.log import JointLog, Later
from ident.model import CurrentModel

SEEDS = (1, 2, 3, 9)


def log(first, last, name="log"):
    t = np.linspace(first, last, 11)
    return JointLog(t=t, q=np.zeros((11, 2)), current=np.zeros((11, 2)), name=name)


@pytest.fixture
def plain(arm):
    return CurrentModel(arm, (), 5.0, 100.0, np.ones(2), "N*m")


def test_logs_of_one_clock_are_left_as_they_are(plain):
    for logs in ([log(0.0, 5.0)], [log(7.0, 9.0), log(0.0, 5.0), log(5.0, 6.0)]):
        assert on_one_clock(plain, logs) == (logs, Clock())


def test_logs_whose_clocks_begin_anew_follow_one_another(plain):
    logs, clock = on_one_clock(plain, [log(2.0, 7.0, "a"), log(0.0, 4.0, "b")])
    assert [source.name for source in logs] == ["a", "b"]
    assert clock == Clock((0.0, 5.0 + PAUSE), 9.0 + 2.0 * PAUSE)
    for source, span in zip(logs, ((0.0, 5.0), (5.0 + PAUSE, 9.0 + PAUSE)), strict=True):
        whole = source.read()
        np.testing.assert_allclose(whole.t[[0, -1]], span)
        np.testing.assert_array_equal(np.concatenate([block.t for block in source.blocks(4)]), whole.t)


def test_segments_of_a_log_stay_on_its_clock(plain):
    parted = log(0.0, 5.0).replace(segment=np.repeat([0, 1], [5, 6]))
    (one, other), clock = on_one_clock(plain, [parted, parted])
    assert clock.begins == (0.0, 5.0 + PAUSE)
    for source, begin in ((one, 0.0), (other, 5.0 + PAUSE)):
        np.testing.assert_allclose(source.read().t, parted.t + begin)
        np.testing.assert_array_equal(source.read().segment, parted.segment)


def test_a_model_of_what_follows_the_clock_knows_that_of_the_logs(plain):
    warm = replace(plain, terms=(Term(ThermalFriction(1)),))
    logs = [log(0.0, 5.0), log(0.0, 5.0)]
    assert on_one_clock(warm, logs) == (logs, Clock())


def test_a_model_holds_for_the_log_that_follows(plain):
    begins = (2.0, 8.0)
    effects = (ThermalFriction(1, since=2.0), Coulomb(0), SensorDrift(0, since=2.0, begins=begins))
    model = replace(plain, terms=tuple(map(Term, effects)))
    found = by_own_clock(model, Clock(begins, 11.0)).terms
    assert found[0].effect == ThermalFriction(1, since=-9.0)
    assert found[1] is model.terms[1]
    assert found[2].effect == SensorDrift(0, since=2.0)
    assert by_own_clock(model, Clock()) is model


def test_the_time_since_a_log_began_is_that_of_its_own_clock(plain):
    logs, clock = on_one_clock(plain, [log(0.0, 5.0), log(0.0, 4.0)])
    t = np.concatenate([source.read().t for source in logs])
    own = np.concatenate([log(0.0, 5.0).t, log(0.0, 4.0).t])
    np.testing.assert_allclose(elapsed(t, 0.0, clock.begins), own, atol=1e-12)
    np.testing.assert_array_equal(elapsed(own, 1.0), own - 1.0)


def test_only_names_that_follow_the_clock_are_warned_of():
    assert clock_warnings(Clock((0.0, 6.0), 11.0), ["stribeck"]) == []
    assert clock_warnings(Clock(), ["sensor-drift"]) == []
    (warning,) = clock_warnings(Clock((0.0, 6.0), 11.0), ["stribeck", "thermal-friction", "sensor-drift"])
    assert "sensor-drift and thermal-friction" in warning


def test_a_later_log_is_the_same_but_for_its_clock():
    one = log(0.0, 5.0)
    later = Later(one, 3.0).read()
    np.testing.assert_array_equal(later.t, one.t + 3.0)
    assert later.q is not one.q
    np.testing.assert_array_equal(later.q, one.q)
    np.testing.assert_array_equal(one.t[0], 0.0)


def warming(goes_on):
    """Friction that falls by two nodes' heat, the second's from log to log, or from cold in each."""
    heats, warm = {}, np.zeros(2)
    for seed in SEEDS:
        t, _, dq, _ = motion(seed)
        if not goes_on:
            warm = np.zeros(2)
        power, heat = np.abs(dq[:, 1]) / 0.5, np.empty(len(t))
        for k, p in enumerate(power):
            warm = warm + (t[1] - t[0]) * np.array([p - warm[0], warm[0] - warm[1]]) / np.array([4.0, 40.0])
            heat[k] = warm[1]
        heats[seed] = heat
    return heats


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_joint_that_is_warm_from_the_log_before_warms_up(arm, goes_on):
    heats = warming(goes_on)

    def worn(seed):
        loss = 1.0 - 1.0 / (1.0 + 1.5 * heats[seed])
        return record(arm, seed, hidden=lambda t, q, dq: -loss * (0.8 * np.tanh(dq[:, 1] / 2e-3) + 0.5 * dq[:, 1]))

    train = [worn(seed) for seed in SEEDS[:3]]
    found = find_gap(baseline_model(arm, train), train, [worn(SEEDS[3])])
    (one,) = found.findings
    assert (one.effect, one.joints) == ("thermal-friction", (1,))
    effect = one.terms[0].effect
    assert bool(effect.begins) is not goes_on
    assert found.evidence.after[1] < 1.06 * NOISE < 0.8 * found.evidence.before[1]


@pytest.mark.parametrize("goes_on", [True, False])
def test_an_offset_that_drifts_from_log_to_log_drifts(arm, goes_on):
    def drifted(number, seed):
        since = 60.0 * number if goes_on else 0.0
        return record(arm, seed, hidden=lambda t, q, dq: 0.6 * np.tanh((since + t) / 300.0))

    train = [drifted(k, seed) for k, seed in enumerate(SEEDS[:3])]
    found = find_gap(baseline_model(arm, train), train, [drifted(3, SEEDS[3])])
    (one,) = found.findings
    assert (one.effect, one.joints) == ("sensor-drift", (1,))
    assert bool(one.terms[0].effect.begins) is not goes_on
    assert any("clock begins anew" in warning and "sensor-drift" in warning for warning in found.warnings)
    assert found.evidence.after[1] < 1.06 * NOISE
    assert found.evidence.before[1] > 1.08 * NOISE
