"""Touches: found where the model suits and where it bent to them, told from what repeats, rings or jumps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planar_arm import NOISE, RATE, logs, motion, record, structure

from ident.gap import baseline_model, find_gap, touch
from ident.gap.panel import Panel
from ident.gap.report import ITS_SIZE, Unexplained
from ident.gap.reporter import _clear
from ident.gap.rows import panel_of
from ident.gap.touch import SHORTEST, Touches, _pieces, find_touches, unpredicted_touches


def test_contact_is_cut_out_also_where_links_had_bent_to_it(arm):
    def pushes(t, q, dq):
        sizes = {8.0: 30.0, 20.0: 3.0, 31.0: 14.0, 42.0: 3.0, 51.0: -24.0}
        return sum(size * np.exp(-0.5 * ((t - at) / 0.3) ** 2) for at, size in sizes.items())

    train, clean = logs(arm, 1, hidden=pushes), [record(arm, 9)]
    found = find_gap(baseline_model(arm, train), train, clean)
    (one,) = found.findings
    assert (one.effect, one.joints) == ("contact", (1,))
    assert one.parameters["episodes"] == 15.0
    t = motion(1)[0]
    pushed = len(train) * np.sum(np.abs(pushes(t, None, None)) > 4.0 * NOISE) / RATE
    assert one.parameters["seconds"] == pytest.approx(pushed, rel=0.15)
    assert found.evidence.before[1] > 2.0 * NOISE
    np.testing.assert_allclose(found.evidence.after, NOISE, rtol=0.1)


def test_touches_so_many_that_they_bend_the_model_are_found(arm):
    def pushes(t, q, dq):
        return 0.8 * np.sum([np.tanh((t - s) / 0.05) - np.tanh((t - s - 2.0) / 0.05) for s in range(3, 58, 9)], axis=0)

    found = structure(arm, hidden=pushes)
    (one,) = found.findings
    assert (one.effect, one.joints) == ("contact", (1,))
    assert one.parameters["episodes"] == 3 * 7
    assert one.parameters["seconds"] == pytest.approx(3 * 7 * 2.0, rel=0.15)
    assert found.unexplained == ()


def test_a_burst_is_held_against_what_is_usual_in_motion(arm, monkeypatch):
    log, rng = record(arm, 1), np.random.default_rng(0)
    panel = panel_of(baseline_model(arm, [log]), [log])
    survey = SimpleNamespace(smoothing=np.full(2, 2e-3), holds=np.array([0.5, 0.3]))
    move, place = np.divmod(np.arange(len(panel)), 500)
    moving = place < 100
    monkeypatch.setattr(Panel, "velocity", np.where(moving, 0.5, 0.0)[:, None] * np.ones(2))
    nothing = np.zeros((len(panel), 2))
    residuals = 0.01 * rng.standard_normal((len(panel), 2))
    residuals[:, 1] += moving * 0.1 * rng.choice([-1.0, 1.0], 50)[move]
    assert find_touches(panel, survey, residuals, nothing).episodes == 0
    # A joint that stands holds .3 by friction alone, unless the other shows it.
    residuals[2200:2250, 1] += 0.25
    assert find_touches(panel, survey, residuals, nothing).episodes == 0
    felt = residuals + np.where((move == 4) & (place >= 200) & (place < 250), 0.25, 0.0)[:, None] * np.array([1.0, 0.0])
    assert find_touches(panel, survey, felt, nothing).joints == (0, 1)
    residuals[2200:2250, 1] += 0.25
    assert find_touches(panel, survey, residuals, nothing).episodes == 1
    residuals[2200:2250, 1] -= 0.5
    residuals[2510:2560, 1] += 1.2
    assert find_touches(panel, survey, residuals, nothing).episodes == 1


def test_what_joints_hold_together_until_they_move_on_is_no_touch_and_a_push_between_is(arm, monkeypatch):
    log, rng = record(arm, 1), np.random.default_rng(0)
    panel = panel_of(baseline_model(arm, [log]), [log])
    survey = SimpleNamespace(smoothing=np.full(2, 2e-3), holds=np.array([0.5, 0.3]))
    place = np.arange(len(panel)) % 500
    velocity = np.where(place < 300, 0.5, 0.0)[:, None] * np.ones(2)
    monkeypatch.setattr(Panel, "velocity", velocity)
    nothing, noise = np.zeros((len(panel), 2)), 0.01 * rng.standard_normal((len(panel), 2))
    for first, end, moves, episodes in ((2300, 2500, 0.0, 0), (2370, 2430, 0.0, 1), (2300, 2500, 0.5, 1)):
        held = np.zeros((len(panel), 1))
        held[first:end] = 0.25
        velocity[2300:2500, 0] = moves  # what one joint shows that moves, another may feel as it stands
        assert find_touches(panel, survey, noise + held, nothing).episodes == episodes


def test_what_comes_back_with_an_angle_is_no_touch(arm):
    log, rng = record(arm, 1), np.random.default_rng(0)
    model = baseline_model(arm, [log])
    panel = panel_of(model, [log])
    survey = SimpleNamespace(smoothing=np.full(2, 2e-3), holds=np.array([0.5, 0.3]))
    nothing, noise = np.zeros((len(panel), 2)), 0.01 * rng.standard_normal((len(panel), 2))
    q = panel.gather(lambda block: block.motion.q)[:, 1]
    tooth = np.abs(q - np.quantile(q, 0.8)) < 0.06
    _, first, end = max(_pieces(tooth[:, None], np.array([0, len(q)])), key=lambda one: one[2] - one[1])
    passed = np.arange(len(q))
    once = noise + 1.0 * ((passed >= first) & (passed < end))[:, None] * np.array([0.0, 1.0])
    assert find_touches(panel, survey, once, nothing).episodes == 1
    often = noise + 1.0 * tooth[:, None] * np.array([0.0, 1.0])
    assert find_touches(panel, survey, often, nothing).episodes == 0
    kicks = often.copy()  # a broken one, which kicks either way
    for number, (_, a, b) in enumerate(_pieces(tooth[:, None], np.array([0, len(q)]))):
        kicks[a:b, 1] *= (1.0, -0.6, -1.0, 0.5)[number % 4]
    assert find_touches(panel, survey, kicks, nothing).episodes == 0


def test_what_rings_is_no_touch(arm):
    def slosh(t, q, dq):
        since = np.maximum(t - 10.0, 0.0)
        return 1.5 * (since > 0.0) * np.exp(-since / 3.0) * np.sin(2.0 * np.pi * 1.3 * since)

    found = structure(arm, hidden=slosh)
    assert found.findings == ()
    assert [one.joints for one in found.unexplained] == [(1,)]


def test_what_stands_out_no_more_than_the_rest_is_no_touch(arm):
    log, rng = record(arm, 1), np.random.default_rng(0)
    model = baseline_model(arm, [log])
    panel = panel_of(model, [log])
    survey = SimpleNamespace(smoothing=np.full(2, 2e-3), holds=np.array([0.5, 0.3]))
    nothing, noise = np.zeros((len(panel), 2)), 0.01 * rng.standard_normal((len(panel), 2))
    rows = np.arange(len(panel))
    for shorter, episodes in ((2.0, 1), (5.0, 0)):
        bursts = 1.0 * (np.abs(rows - 2000) < 20) + shorter * (np.abs(rows[:, None] - rows[500::900]) < 2).any(axis=1)
        found = find_touches(panel, survey, noise + bursts[:, None] * np.array([0.0, 1.0]), nothing)
        assert found.episodes == episodes


def test_what_friction_remembers_as_a_log_begins_is_no_touch(arm):
    # How the joints came to where the log finds them bends their friction until they have gone some milliradians.
    log, rng = record(arm, 1), np.random.default_rng(0)
    model = baseline_model(arm, [log])
    setting_out = np.minimum(log.t / 3.0, 1.0)[:, None] ** 3
    panel = panel_of(model, [replace(log, q=log.q[0] + setting_out * (log.q - log.q[0]))])
    survey = SimpleNamespace(smoothing=np.full(2, 2e-3), holds=np.full(2, 0.02))
    nothing, noise = np.zeros((len(panel), 2)), 0.01 * rng.standard_normal((len(panel), 2))
    begins = int(np.argmax(np.abs(panel.motion.q - panel.motion.q[0]).max(axis=1) > 4e-3))
    assert begins * panel.step > SHORTEST
    for first, rows, episodes in ((0, begins, 0), (5, begins - 5, 0), (2000, begins, 1), (0, 5 * begins, 1)):
        burst = np.zeros((len(panel), 1))
        burst[first : first + rows] = 1.0
        assert find_touches(panel, survey, noise + burst, nothing).episodes == episodes


def test_faint_touches_do_not_hide_those_of_several_joints(arm):
    log, rng = record(arm, 1), np.random.default_rng(0)
    panel = panel_of(baseline_model(arm, [log]), [log])
    survey = SimpleNamespace(smoothing=np.full(2, 2e-3), holds=np.full(2, 0.02))
    nothing, noise = np.zeros((len(panel), 2)), 0.1 * rng.standard_normal((len(panel), 2))
    rows = np.arange(len(panel))
    push = 0.23 * (np.abs(rows - 1000) < 40) + 0.13 * (np.abs(rows - 3000) < 40)
    assert find_touches(panel, survey, noise + push[:, None], nothing).episodes == 2
    # A law unknown of one joint makes both as well.
    assert find_touches(panel, survey, noise + push[:, None] * np.array([0.0, 1.0]), nothing).episodes == 0


def test_touches_that_the_motion_happens_to_predict_are_touches_if_another_joint_shows_them(arm, monkeypatch):
    log, rng = record(arm, 1), np.random.default_rng(0)
    panel = panel_of(baseline_model(arm, [log]), [log])
    survey = SimpleNamespace(smoothing=np.full(2, 2e-3), holds=np.full(2, 0.02))
    nothing, rows = np.zeros((len(panel), 2)), np.arange(len(panel))
    push = 2.0 * (np.abs(rows - 1000) < 40)[:, None] + 0.1 * rng.standard_normal((len(panel), 2))

    def predicts(share):
        def explainable(panel, survey, joint, residual, kept):
            everywhere = len(kept) == len(panel)
            return SimpleNamespace(share=0.0 if joint == 0 else 0.5 if everywhere else share)

        monkeypatch.setattr(touch, "explainable", explainable)
        return unpredicted_touches(panel, survey, push, nothing)

    assert predicts(0.0).joints == (0, 1)
    assert predicts(0.5).joints == (0,)


def test_bursts_among_much_that_follows_the_motion_are_no_contact():
    touches = Touches(np.zeros(0, dtype=bool), (3,), 1.8, 3)
    sticks, small, wanders, elsewhere = (
        Unexplained((joint,), depends_on, share)
        for joint, depends_on, share in (
            (3, ("dq4^2" + ITS_SIZE,), 0.65),
            (3, ("dq4",), 0.2),
            (3, ("t (wanders)",), 0.8),
            (2, ("q3",), 0.9),
        )
    )
    assert not _clear(touches, [small, sticks])
    assert all(_clear(touches, [one]) for one in (small, wanders, elsewhere))
    assert _clear(Touches(touches.rows, (2, 3), 1.8, 3), [sticks])
