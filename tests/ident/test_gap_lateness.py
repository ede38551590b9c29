"""Signs of velocity that are chosen anew once it is known how late the current comes."""

from dataclasses import replace

import numpy as np
import planar_arm
import pytest

from ident.effects.friction import Coulomb
from ident.effects.timing import Delay, FilterLag
from ident.gap import baseline_model, find_gap
from ident.gap.lateness import InTime

LATE = 0.019


def delayed(log):
    late = [np.interp(log.t - LATE, log.t, current) for current in log.current.T]
    return log.replace(current=np.stack(late, axis=1))


def smoothings(model):
    return np.array([term.effect.smoothing for term in model.terms if isinstance(term.effect, Coulomb)])


def test_a_late_current_does_not_blur_the_sign_of_velocity(arm):
    train = [delayed(planar_arm.record(arm, seed)) for seed in (1, 2, 3)]
    test = [delayed(planar_arm.record(arm, 9))]
    model = baseline_model(arm, train)
    found = find_gap(model, train, test)
    assert (smoothings(found.model) < 0.8 * smoothings(model)).all()
    (late,) = found.findings
    assert (late.effect, late.parameters["seconds"]) == ("delay", pytest.approx(LATE, rel=0.01))
    assert not found.unexplained
    assert (found.evidence.after < 1.02 * planar_arm.NOISE).all()


def test_a_log_in_time_is_the_log_without_the_delay():
    t = np.arange(300) / 100.0
    wave = np.sin(t)[:, None] * [1.0, 2.0]
    log = replace(
        planar_arm.JointLog(t=t, q=wave, current=np.stack([wave[:, 0], np.sin(t - LATE)], axis=1)),
        segment=np.repeat([0, 1], [100, 200]),
    )
    whole = InTime(log, np.array([0.0, LATE])).read().current
    inside = np.concatenate([np.arange(98), np.arange(100, 298)])
    np.testing.assert_allclose(whole[:, 0], wave[:, 0])
    np.testing.assert_allclose(whole[inside, 1], np.sin(t)[inside], atol=1e-4)
    blocks = np.concatenate([block.current for block in InTime(log, np.array([0.0, LATE])).blocks(1000)])
    np.testing.assert_array_equal(blocks, whole)


def test_how_late_a_current_comes_in_slow_motion():
    delay, lag = Delay(None, 0.01), FilterLag(None)
    assert delay.lateness(np.array([0.03]), np.array([0.028])) == 0.03
    assert delay.lateness(np.array([0.005]), np.array([0.004])) == 0.004
    assert lag.lateness(np.array([10.0]), np.array([0.5])) == pytest.approx(0.5 / (20.0 * np.pi))
