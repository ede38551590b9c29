"""Currents that come late or pass a filter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lsim, tf2ss

from ident.effects.base import Context
from ident.effects.timing import Delay, FilterLag
from ident.signals import Motion


def test_a_delay_over_a_span_of_its_own_length_is_exact(vs060):
    t = np.arange(400) * 0.002
    total = np.tanh(np.sin(9.0 * t)[:, None] / np.linspace(0.01, 1.0, 6))
    still = np.zeros_like(total)
    context = Context(vs060, Motion(t, still, still, still), total=total)
    late = np.vstack([np.repeat(total[:1], 5, axis=0), total[:-5]])
    whole = 0.01 * Delay(None).columns(context, np.array([0.01]), Delay(None).start())[:, :, 0]
    np.testing.assert_allclose(total + whole, late, atol=1e-9)
    first_order = Delay(4).columns(context, np.array([0.001]), Delay(4).start())[1:, 0]
    np.testing.assert_allclose(first_order, -np.diff(total[:, 4]) / 0.002, atol=1e-9)
    # To the last digit whatever the span, so that no search follows round-off.
    within = [Delay(4, sample=0.002).columns(context, np.array([s]), Delay(4).start()) for s in (0.001, 0.0013)]
    np.testing.assert_array_equal(*within)


def test_all_of_the_current_comes_late():
    delay, lag = Delay(None, sample=0.002), FilterLag(None)
    assert delay.plain(np.array([0.004])) == 0.004
    assert delay.plain(np.array([0.002])) is None
    assert lag.plain(np.array([20.0])) == 1.0


def test_a_filter_delays_a_ramp_by_its_time_constant_at_any_rate(vs060):
    # As filters do that run many times faster than the log: 1 / (2 pi f) behind, once settled.
    for rate in (50.0, 100.0, 1000.0):
        t = np.arange(round(rate)) / rate
        total = np.tile(3.0 * t[:, None], 6)
        context = Context(vs060, Motion(t, total, total, total), total=total)
        lag = FilterLag(None).columns(context, np.array([20.0]), FilterLag(None).start())[:, 0, 0]
        assert lag[-1] == pytest.approx(-3.0 / (2.0 * np.pi * 20.0), rel=1e-6)


def test_a_filter_of_second_order_is_butterworths(vs060, rng):
    t = np.arange(300) * 0.01
    total = np.cumsum(rng.standard_normal((300, 6)), axis=0)
    context = Context(vs060, Motion(t, total, total, total), total=total)
    lag = FilterLag(None, order=2)
    found = total + lag.columns(context, np.array([12.0]), lag.start())[:, :, 0]
    system = tf2ss(*butter(2, 2.0 * np.pi * 12.0, analog=True))
    for j in range(6):
        settled = np.linalg.solve(-system[0], system[1][:, 0]) * total[0, j]
        np.testing.assert_allclose(found[:, j], lsim(system, total[:, j], t, X0=settled)[1], atol=1e-9)
    ramp = Context(vs060, Motion(t, total, total, total), total=np.tile(3.0 * t[:, None], 6))
    behind = lag.columns(ramp, np.array([12.0]), lag.start())[-1, 0, 0]
    assert behind == pytest.approx(-3.0 * lag.lateness(np.array([12.0]), np.ones(1)), rel=1e-6)


def test_steps_of_dry_friction_come_late_within_a_sample(vs060, swinging):
    """A joint turns round between two samples: whether the one after sees it, a straight line would say by halves."""
    fine, every, late = swinging(40.0, 1000.0), 20, 0.007
    dry, turns = np.full(6, 3.0), np.full(6, 1e-4)

    def total(rows):
        return np.cos(fine.q[rows]) + dry * np.tanh(fine.dq[rows] / turns)

    rows = np.arange(every, 40_000, every)
    seen, before = fine[rows], total(rows - 7)
    context = Context(vs060, seen, total=total(rows))
    plain = Delay(None)
    steps = replace(plain, dry=tuple(dry.tolist()), turns=tuple(turns.tolist()))

    def left(delay):
        found = total(rows) + late * delay.columns(context, np.array([late]), delay.start())[:, :, 0]
        return np.sqrt(np.mean((found - before)[1:] ** 2))

    assert left(steps) < 0.2 * left(plain)


@pytest.mark.parametrize("order", [1, 2])
def test_a_filter_follows_steps_of_dry_friction_within_a_sample(vs060, swinging, order):
    fine, every = swinging(40.0, 1000.0), 20
    dry, turns = (3.0,) * 6, (1e-4,) * 6

    def left(lag, rows, total):
        context = Context(vs060, fine[rows], total=total)
        return lag.columns(context, np.array([25.0]), lag.start())[:, :, 0]

    total = np.cos(fine.q) + 3.0 * np.tanh(fine.dq / 1e-4)
    true = left(FilterLag(None, order=order), slice(None), total)[::every]
    straight, steps = (
        np.sqrt(np.mean((left(lag, slice(None, None, every), total[::every]) - true) ** 2))
        for lag in (FilterLag(None, order=order), FilterLag(None, dry, turns, order=order))
    )
    assert steps < 0.2 * straight
