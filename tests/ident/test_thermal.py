"""Friction that changes as joints, or drives, warm up."""

import numpy as np
import pytest

from ident.effects.base import Context
from ident.effects.thermal import ThermalFriction
from ident.signals import Motion


@pytest.mark.parametrize("logged", [0.0, 1.0])
def test_a_joint_is_as_warm_as_a_later_log_says_that_it_moved_before(vs060, logged):
    t, zeros = np.arange(0.0, 300.0, 0.1), np.zeros((3000, 6))
    dq = np.full((3000, 6), 0.4)
    whole = Context(vs060, Motion(1000.0 + t, zeros, dq, zeros), zeros, zeros, zeros)
    effect = ThermalFriction(1, pace=0.4, since=1000.0, logged=logged)
    rest = Context(vs060, whole.motion[1000:], zeros[1000:], zeros, zeros[1000:])
    columns, later = (effect.columns(one, np.array([80.0, 1.0]), effect.start()) for one in (whole, rest))
    np.testing.assert_array_equal(columns[0], 0.0)  # the first is cold
    expected = columns[1000:] if logged else columns[:2000]
    np.testing.assert_allclose(later, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("waning", [0.05, 2.0, 6.0])
def test_the_seconds_of_thermal_friction_are_those_of_the_change(vs060, waning):
    drive = ThermalFriction(1, steady=True, logged=1.0, friction=2.0)
    shape = np.array([100.0, waning])
    found = drive.summary(vs060, shape, np.array([-1.0, 0.0]))
    t = np.arange(0.0, 800.0, 0.1)
    rest = np.zeros((len(t), 6))
    # A joint that moves as slowly as can be and warms up by the clock.
    motion = Motion(t, rest, rest + 0.1, rest)
    change = -drive.columns(Context(vs060, motion, rest, rest[:6], rest), shape, drive.start())[:, 0]
    assert np.interp(found["seconds"], t, -change / -change[-1]) == pytest.approx(1.0 - np.exp(-1.0), abs=0.01)
    assert found["share"] == pytest.approx(-change[-1] / 2.0, rel=0.01)


@pytest.mark.parametrize("standing", [0.0, 0.3, 1.0])
def test_a_share_of_the_power_is_steady(vs060, standing):
    t = np.arange(0.0, 60.0, 0.1)
    rest, dq = np.zeros((len(t), 6)), np.repeat(np.sin(0.7 * t)[:, None], 6, axis=1)
    context = Context(vs060, Motion(t, rest, dq, rest), rest, rest[:6], rest)
    own, steady, mixed = (ThermalFriction(1, pace=0.5, steady=s, mixed=m) for s, m in ((0, 0), (1, 0), (0, 1)))
    # Where the change is as the heat, that is a sum of both.
    shape = np.array([40.0, 1e-6])
    parts = [effect.columns(context, shape, effect.start()) for effect in (own, steady)]
    found = mixed.columns(context, np.append(shape, standing), mixed.start())
    np.testing.assert_allclose(found, (1.0 - standing) * parts[0] + standing * parts[1], atol=1e-5)
    assert mixed.summary(vs060, np.append(shape, standing), np.array([-1.0, 0.0]))["standing"] == standing


def test_drives_warm_up_whatever_the_joint_does(vs060):
    t = np.arange(0.0, 60.0, 0.1)
    rest = np.zeros((len(t), 6))
    moves = rest + 0.1 * (t > 40.0)[:, None]
    found = [
        ThermalFriction(1, steady=steady).columns(
            Context(vs060, Motion(t, rest, moves, rest), rest, rest[:6], rest), np.array([20.0, 0.05]),
            ThermalFriction(1).start(),
        )[-1, 0]
        for steady in (False, True)
    ]  # fmt: skip
    assert found[1] == pytest.approx(1.0 - np.exp(-3.0), rel=0.05)
    assert found[0] < 0.2
