"""Joints whose dry friction builds up over a fraction of a milliradian as they turn round: that hides no effect."""

import numpy as np
import pytest

from ident.gap import baseline_model, find_gap
from ident.gap.rests import find_rests
from ident.gap.standing import hardly_moved
from ident.log import JointLog
from ident.signals import Motion
from ident.walk import Block

RATE, NOISE, DRY = 100.0, 0.03, np.array([1.5, 0.8])


def dahl(q, slip):
    """Friction (N,) of a joint over its Coulomb force, which builds up over a displacement (Dahl 1968)."""
    state, force = 0.0, np.zeros(len(q))
    for k, step in enumerate(np.diff(q), start=1):
        state = np.sign(step) + (state - np.sign(step)) * np.exp(-np.abs(step) / slip)
        force[k] = state
    return force


def record(arm, seed, friction, hidden=None):
    """Sinusoids that never stand; a law of friction, and maybe an effect on joint 2."""
    rng = np.random.default_rng(seed)
    t = np.arange(4000) / RATE
    w = 2 * np.pi * rng.uniform(0.15, 0.5, (3, 1, 2))
    size, phase = 0.35 * np.array([1.0, 0.5, 0.3])[:, None, None], rng.uniform(0, 6, (3, 1, 2))
    q, dq, ddq = (np.sum(size * w**k * np.sin(w * t[:, None] + phase + 0.5 * k * np.pi), axis=0) for k in range(3))
    torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
    torque += np.stack([DRY[j] * friction(q[:, j], dq[:, j]) for j in range(2)], axis=1)
    torque += np.array([1.0, 0.5]) * dq + NOISE * rng.standard_normal(q.shape)
    if hidden is not None:
        torque[:, 1] += hidden(q, dq)
    return JointLog(t=t, q=q + 2e-6 * rng.standard_normal(q.shape), current=torque, name=f"log{seed}")


def found_in(arm, friction, hidden=None):
    train = [record(arm, seed, friction, hidden) for seed in (1, 2, 3)]
    return find_gap(baseline_model(arm, train), train, [record(arm, 9, friction, hidden)])


def short(q, dq):
    return dahl(q, 1.2e-4)


def lower(q, dq):
    return 0.12 * np.sign(dq[:, 1]) * np.exp(-((dq[:, 1] / 0.08) ** 2))


def test_what_builds_up_over_less_than_a_milliradian_is_left_out_and_bends_nothing(arm):
    found = found_in(arm, short)
    assert (found.rests, found.turns) == ((), (0, 1))
    assert found.findings == ()
    assert found.unexplained == ()
    assert np.all(found.evidence.after > 1.5 * NOISE)
    np.testing.assert_allclose(found.evidence.moving[-1], NOISE, rtol=0.1)


def test_an_effect_is_named_beside_turns_ten_times_the_noise(arm):
    (one,) = found_in(arm, short, lower).findings
    assert (one.effect, one.joints) == ("stribeck", (1,))
    assert one.parameters["force"] == pytest.approx(0.12, rel=0.25)


def test_friction_that_turns_with_the_speed_or_builds_up_over_milliradians_does_not_yield(arm):
    for friction in (lambda q, dq: np.tanh(dq / 3e-3), lambda q, dq: dahl(q, 4e-3)):
        train = [record(arm, seed, friction) for seed in (1, 2, 3)]
        assert find_rests(baseline_model(arm, train), train).joints == ()


def test_currents_that_come_late_are_no_friction_that_yields(arm):
    # At a turn what comes late is all of the dry friction, the wrong way round.
    def late(log):
        t = np.arange(len(log))
        return log.replace(current=np.stack([np.interp(t - 1.5, t, column) for column in log.current.T], axis=1))

    train = [late(record(arm, seed, lambda q, dq: np.tanh(dq / 2e-3))) for seed in (1, 2, 3)]
    assert find_rests(baseline_model(arm, train), train).joints == ()


def test_rows_around_a_turn_are_told_by_displacement():
    t = np.arange(200) / RATE
    q, dq = 0.01 * np.sin(3.0 * t + 0.1)[:, None], 0.03 * np.cos(3.0 * t + 0.1)[:, None]
    block = Block(JointLog(t=t, q=q, current=q), Motion(t, q, dq, dq), True, np.ones(200, dtype=bool))
    near = hardly_moved(block, np.array([1e-3]))[:, 0]
    turn = int(np.argmax(dq[:, 0] < 0.0))
    assert near[turn]
    moved = np.abs(q[:, 0] - q[turn, 0])
    later = slice(turn, turn + 60)
    np.testing.assert_array_equal(near[later], moved[later] < 1e-3)
    before = slice(10, turn)
    np.testing.assert_array_equal(near[before], (moved < 2e-4)[before] | (np.abs(q[:, 0] - q[0, 0]) < 1e-3)[before])
    assert not hardly_moved(block, np.zeros(1)).any()
