"""Joints whose dry friction builds up over a fraction of a milliradian as they turn round: it is modelled so."""

import numpy as np
import pytest

from ident.effects.friction import Coulomb
from ident.gap import baseline_model, find_gap
from ident.gap.standing import hardly_moved
from ident.log import JointLog
from ident.model_file import load_model, save_model
from ident.signals import Motion, derive
from ident.walk import Block

RATE, NOISE, DRY = 100.0, 0.03, np.array([1.5, 0.8])
FINER = 20
"""Steps a sample in which friction is simulated: joints turn between samples."""


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
    t = np.arange(4000 * FINER) / RATE / FINER
    w = 2 * np.pi * rng.uniform(0.15, 0.5, (3, 1, 2))
    size, phase = 0.35 * np.array([1.0, 0.5, 0.3])[:, None, None], rng.uniform(0, 6, (3, 1, 2))
    q, dq, ddq = (np.sum(size * w**k * np.sin(w * t[:, None] + phase + 0.5 * k * np.pi), axis=0) for k in range(3))
    dry = np.stack([DRY[j] * friction(q[:, j], dq[:, j]) for j in range(2)], axis=1)
    t, q, dq, ddq, dry = (x[::FINER] for x in (t, q, dq, ddq, dry))
    torque = dry + arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
    torque += np.array([1.0, 0.5]) * dq + NOISE * rng.standard_normal(q.shape)
    if hidden is not None:
        torque[:, 1] += hidden(q, dq)
    return JointLog(t=t, q=q + 2e-6 * rng.standard_normal(q.shape), current=torque, name=f"log{seed}")


def found_in(arm, friction, hidden=None):
    train = [record(arm, seed, friction, hidden) for seed in (1, 2, 3)]
    return find_gap(baseline_model(arm, train), train, [record(arm, 9, friction, hidden)])


def short(q, dq):
    return dahl(q, 1.2e-4)


def elements(q, dq):
    """Friction over its Coulomb force of six springs that slip one after the other, within half a milliradian."""
    force = np.zeros(len(q))
    for slip in 1e-4 * np.arange(0.5, 5.5, 0.9):
        stretch = 0.0
        for k, step in enumerate(np.diff(q), start=1):
            stretch = np.clip(stretch + step, -slip, slip)
            force[k] += stretch / slip / 6
    return force


def lower(q, dq):
    return 0.12 * short(q[:, 1], dq) * np.exp(-((dq[:, 1] / 0.08) ** 2))


def lower_at_once(q, dq):
    return 0.12 * np.sign(dq[:, 1]) * np.exp(-((dq[:, 1] / 0.08) ** 2))


@pytest.mark.parametrize(("friction", "length", "noise"), [(short, 1.2e-4, 1.1), (elements, 2.9e-4, 1.1)])
def test_the_baseline_builds_up_what_yields_and_nothing_is_named(arm, friction, length, noise):
    found = found_in(arm, friction)
    np.testing.assert_allclose(found.survey.presliding, length, rtol=0.2)
    assert found.rests == ()
    assert found.findings == ()
    assert found.unexplained == ()
    assert np.all(found.evidence.after < noise * NOISE)


@pytest.mark.parametrize(("hidden", "within"), [(lower, 0.1), (lower_at_once, 0.3)])
def test_an_effect_is_named_beside_turns_that_a_sign_of_velocity_misses_by_ten_times_the_noise(arm, hidden, within):
    (one,) = found_in(arm, short, hidden).findings
    assert (one.effect, one.joints) == ("stribeck", (1,))
    assert one.parameters["force"] == pytest.approx(0.12, rel=within)


def test_friction_that_turns_with_the_speed_or_builds_up_over_milliradians_does_not_yield(arm):
    for friction in (lambda q, dq: np.tanh(dq / 3e-3), lambda q, dq: dahl(q, 4e-3)):
        assert lengths(arm, [record(arm, seed, friction) for seed in (1, 2, 3)]) == [0.0, 0.0]


def test_currents_that_come_late_are_no_friction_that_yields(arm):
    # At a turn what comes late is all of the dry friction, the wrong way round.
    def late(log):
        t = np.arange(len(log))
        return log.replace(current=np.stack([np.interp(t - 1.5, t, column) for column in log.current.T], axis=1))

    assert lengths(arm, [late(record(arm, seed, lambda q, dq: np.tanh(dq / 2e-3))) for seed in (1, 2, 3)]) == [0.0, 0.0]


def lengths(arm, train):
    model = baseline_model(arm, train)
    return [term.effect.presliding for term in model.terms if isinstance(term.effect, Coulomb)]


def test_what_rests_hold_is_told_by_how_the_joint_came_there(arm):
    """Joints that stop and go: a sign of velocity says nothing at rest, what has built up stays."""
    train, test = [stop_and_go(arm, seed) for seed in (1, 2, 3)], [stop_and_go(arm, 9)]
    found = find_gap(baseline_model(arm, train), train, test)
    assert found.findings == ()
    assert all(one.share < 0.2 for one in found.unexplained)
    np.testing.assert_allclose(found.survey.presliding, 1.2e-4, rtol=0.2)
    assert np.all(found.evidence.after < 2.0 * NOISE)


def rise(share):
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def stop_and_go(arm, seed):
    """Joints that go to and fro, rest, and creep back a little before they do."""
    rng = np.random.default_rng(seed)
    pieces, at = [], np.zeros(2)
    for _ in range(10):
        to = rng.uniform(-0.5, 0.5, 2)
        for goal, rows in ((to, 200), (to - 1.5e-4 * np.sign(to - at) * rng.uniform(0, 1, 2), 100)):
            pieces.append(at + (goal - at) * rise(np.arange(rows) / rows)[:, None])
            at = goal
        pieces.append(np.tile(at, (120, 1)))
    q = np.concatenate(pieces)
    log = JointLog(t=np.arange(len(q)) / RATE, q=q, current=q)
    motion = derive(log, 20.0)
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
    torque += np.stack([DRY[j] * dahl(q[:, j], 1.2e-4) for j in range(2)], axis=1)
    torque += np.array([1.0, 0.5]) * dq + NOISE * rng.standard_normal(q.shape)
    return JointLog(t=motion.t, q=q + 1e-6 * rng.standard_normal(q.shape), current=torque, name=f"stops{seed}")


def test_a_saved_model_remembers_over_which_displacement(arm, tmp_path):
    found = found_in(arm, short)
    save_model(found.model, tmp_path)
    read = load_model(tmp_path, arm)
    log = record(arm, 9, short)
    np.testing.assert_array_equal(read.predict(log), found.model.predict(log))
    assert [term.effect for term in read.terms] == [term.effect for term in found.model.terms]


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


def test_a_touch_does_not_hide_which_joints_yield(arm):
    def touched(log):
        pushed = (np.abs(log.t[:, None] - [9.0, 21.0, 33.0]) < 1.0).any(axis=1)
        return log.replace(current=log.current + np.outer(pushed, [3.0, 1.5]))

    train = [touched(record(arm, seed, short)) for seed in (1, 2, 3)]
    found = find_gap(baseline_model(arm, train), train, [touched(record(arm, 9, short))])
    assert [one.effect for one in found.findings] == ["contact"]
    np.testing.assert_allclose(found.survey.presliding, 1.2e-4, rtol=0.2)
