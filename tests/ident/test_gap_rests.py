"""Joints that stick: what dry friction holds while they stand bends no fit, hides no effect and is none."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planar_arm import delayed

from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb
from ident.fit import Drives, fit
from ident.gap import baseline_model, find_gap, smoothing
from ident.gap import rests as rests_module
from ident.gap.edge import edge_columns, with_slight_edge
from ident.gap.evidence import evidence
from ident.gap.joint_gap import JointGap
from ident.gap.rests import Rests, _hunts, _rattles, find_rests, in_company
from ident.gap.rows import panel_of, survey_of
from ident.gap.search import search
from ident.identification import identify
from ident.log import JointLog

RATE, NOISE, DRY = 100.0, 0.08, np.array([1.5, 0.8])
MOVE, STOP = 1.6, 0.8  # seconds


def record(arm, seed, hidden=None, held=1.0, hum=0.0, moves=28, still=(), count=0.0):
    """Point-to-point moves; while a joint stands its friction holds a level drawn anew (times ``held``), or hums.

    Joints in ``still`` stand throughout; positions are logged in multiples of ``count``, if any.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(moves * (MOVE + STOP) * RATE)) / RATE
    number, phase = np.divmod(t, MOVE + STOP)
    x = np.clip(phase / MOVE, 0.0, 1.0)
    points = np.cumsum(rng.choice([-1.0, 1.0], (moves + 1, 2)) * rng.uniform(0.2, 0.9, (moves + 1, 2)), axis=0)
    points = 1.6 * np.sin(points)
    points[:, list(still)] = 0.3
    first, step = points[number.astype(int)], np.diff(points, axis=0)[number.astype(int)]
    q = first + step * (x**3 * (10 - 15 * x + 6 * x**2))[:, None]
    dq = step * (30 * x**2 * (1 - x) ** 2 / MOVE)[:, None]
    ddq = step * (60 * x * (1 - x) * (1 - 2 * x) / MOVE**2)[:, None]
    stands = (phase >= MOVE)[:, None] | (step == 0.0)
    levels = rng.uniform(-1.0, 1.0, (moves, 2))[number.astype(int)]
    friction = np.where(stands, held * levels * DRY, DRY * np.tanh(dq / 2e-3))
    torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
    torque += friction + np.array([1.0, 0.5]) * dq + NOISE * rng.standard_normal(q.shape)
    torque += stands * hum * np.sin(2 * np.pi * 3.3 * t)[:, None]
    if hidden is not None:
        torque[:, 1] += hidden(q, dq, stands[:, 1])
    seen = np.round(q / count) * count if count else q
    return JointLog(t=t, q=seen, current=torque, name=f"log{seed}")


def logs(arm, **options):
    return [record(arm, seed, **options) for seed in (1, 2, 3)]


def found_in(arm, **options):
    train = logs(arm, **options)
    return find_gap(baseline_model(arm, train), train, [record(arm, 9, **options)])


def test_what_friction_holds_at_rest_is_left_out_and_bends_nothing(arm):
    found = found_in(arm)
    assert found.rests == (0, 1)
    assert found.findings == ()
    assert found.unexplained == ()
    assert np.all(found.evidence.after > 2.0 * NOISE)
    np.testing.assert_allclose(found.evidence.moving[-1], NOISE, rtol=0.1)


@pytest.mark.parametrize("power", [1, 2])
def test_an_effect_is_named_beside_rests_eight_times_the_noise(arm, power):
    def lower(q, dq, stands):
        return 0.25 * np.sign(dq[:, 1]) * np.exp(-((np.abs(dq[:, 1]) / 0.06) ** power))

    found = found_in(arm, hidden=lower)
    assert found.rests == (0, 1)
    (one,) = found.findings
    assert (one.effect, one.joints) == ("stribeck", (1,))
    assert one.parameters["speed"] == pytest.approx(0.06, rel=0.15)
    assert found.evidence.moving[-1][1] < 1.1 * NOISE


def test_what_a_joint_lacks_in_motion_does_not_hide_that_it_sticks(arm):
    found = found_in(arm, hidden=lambda q, dq, stands: 0.9 * np.linspace(0.0, 1.0, len(q)))
    assert found.rests == (0, 1)
    assert [(one.effect, one.joints) for one in found.findings] == [("sensor-drift", (1,))]


def test_rests_that_nothing_holds_count(arm):
    found = found_in(arm, held=0.0)
    assert found.rests == ()
    assert found.findings == ()


def test_a_drive_that_hunts_at_rest_is_unexplained_and_not_left_out(arm):
    found = found_in(arm, held=0.0, hum=0.5)
    assert found.rests == ()
    assert {one.joints for one in found.unexplained} == {(0,), (1,)}


@pytest.mark.parametrize(("late", "sticks"), [(0.03, ()), (-0.03, (0, 1))])
def test_rests_into_which_a_late_current_reaches_count(arm, monkeypatch, late, sticks):
    """Dry friction that comes late shows in short stops; a sign of velocity chosen wide to blur it hides its law."""
    for what, value in (("NOISE", 0.02), ("STOP", 0.1)):
        monkeypatch.setitem(globals(), what, value)
    train = [delayed(log, late) for log in logs(arm, held=0.0)]
    model = baseline_model(arm, train)
    wide = (replace(t.effect, smoothing=8e-3) if hasattr(t.effect, "smoothing") else t.effect for t in model.terms)
    terms = tuple(replace(term, effect=effect) for term, effect in zip(model.terms, wide, strict=True))
    assert find_rests(replace(model, terms=terms), train).joints == sticks


@pytest.mark.parametrize(("count", "sticks", "named"), [(0.0, (), [("maxwell-slip", (1,))]), (1.5e-3, (1,), [])])
def test_rests_that_remember_where_the_joint_came_from_count_if_the_encoder_shows_it(arm, count, sticks, named):
    def kept(q, dq, stands):
        # Dahl's law instead of the sign of velocity: at rest it stays.
        z = np.zeros(len(q))
        for k, step in enumerate(np.diff(q[:, 1]) / 1e-3, start=1):
            z[k] = np.sign(step) + (z[k - 1] - np.sign(step)) * np.exp(-abs(step))
        return DRY[1] * (z - np.where(stands, 0.0, np.tanh(dq[:, 1] / 2e-3)))

    found = found_in(arm, held=0.0, hidden=kept, count=count)
    assert found.rests == sticks
    assert [(one.effect, one.joints) for one in found.findings] == named


@pytest.mark.parametrize("least", [0.0, 0.5])
def test_friction_that_holds_a_part_of_what_the_joint_stopped_with_is_no_hysteresis(arm, least):
    def stopped(q, dq, stands):
        rng = np.random.default_rng(len(q) + int(1e6 * abs(q[5, 0])))
        kept = np.sign(np.diff(q[:, 1], prepend=0.0))
        for k in np.flatnonzero(stands):
            kept[k] = kept[k - 1] * (1.0 if stands[k - 1] else rng.uniform(least, 1.0))
        return stands * DRY[1] * kept

    found = found_in(arm, held=0.0, hidden=stopped)
    assert found.rests == (1,)
    assert found.findings == ()
    assert found.unexplained == ()


def test_a_drive_that_rattles_at_rest_is_unexplained_and_not_left_out(arm):
    rng = np.random.default_rng(0)
    found = found_in(arm, held=0.0, hidden=lambda q, dq, stands: stands * 0.4 * rng.standard_normal(len(q)))
    assert found.rests == ()
    assert [one.joints for one in found.unexplained] == [(1,)]


@pytest.mark.parametrize(("standing", "rattles"), [(24, False), (8, True)])
def test_how_a_joint_stops_and_starts_is_no_rattling(standing, rattles):
    rng, rows = np.random.default_rng(0), np.arange(2000)
    rest, slow = rows % 100 < 40, rows % 100 < standing
    slow &= rest & (rows < 100 if rattles else True)
    force = rng.standard_normal(2000) * np.where(slow, 1.0, 20.0)
    assert _rattles(force, rng.standard_normal(2000), rest, slow) is rattles


def test_a_load_at_rest_is_more_than_dry_friction_holds(arm):
    found = found_in(arm, held=0.0, hidden=lambda q, dq, stands: stands * 4.0 * np.sign(q[:, 1]))
    assert found.rests == ()


def test_bursts_at_rest_beyond_what_friction_holds_are_unexplained(arm):
    def bursts(q, dq, stands):
        return 4.0 * DRY[1] * (stands & ~np.append(stands[8:], np.ones(8, dtype=bool)))

    found = found_in(arm, hidden=bursts)
    assert (found.rests, found.findings) == ((0, 1), ())
    (one,) = found.unexplained
    assert (one.joints, one.depends_on) == ((1,), ("dq2 (about rests, more than friction holds)",))
    np.testing.assert_allclose(found.noise_floor, NOISE, rtol=0.1)


def test_a_joint_that_stands_while_others_are_moved_sticks(arm):
    def lower(q, dq, stands):
        return 0.25 * np.sign(dq[:, 1]) * np.exp(-np.abs(dq[:, 1]) / 0.06)

    train = [*logs(arm, hidden=lower), record(arm, 4, hidden=lower, still=(1,))]
    found = find_gap(baseline_model(arm, train), train)
    assert found.rests == (0, 1)
    assert [(one.effect, one.joints) for one in found.findings] == [("stribeck", (1,))]


def test_dry_friction_that_breaks_away_hard_holds_more_than_in_motion(arm):
    def higher_at_rest(q, dq, stands):
        lower = 0.8 * np.sign(dq[:, 1]) * np.exp(-np.abs(dq[:, 1]) / 0.03)
        return np.where(stands, 1.6 * np.sign(np.sin(37.0 * q[:, 1])), lower)

    found = found_in(arm, hidden=higher_at_rest, held=0.0)
    assert found.rests == (1,)
    assert [(one.effect, one.joints) for one in found.findings] == [("stribeck", (1,))]


def test_one_long_rest_is_told_by_nothing(arm):
    long = record(arm, 4, still=(1,), moves=20)
    held = long.current[:, 1].copy()
    held += 0.7 - np.median(held)
    train = [*logs(arm, moves=6, held=0.0), long.replace(current=np.column_stack([long.current[:, 0], held]))]
    assert find_rests(baseline_model(arm, train), train).joints[-1:] == (1,)


def test_a_row_of_its_own_is_no_rest(arm):
    log = record(arm, 1)
    segment = np.zeros(len(log.t), dtype=np.int64)
    segment[-1] = 1
    train = [log.replace(segment=segment), record(arm, 2), record(arm, 3)]
    assert find_gap(baseline_model(arm, train), train, train[:1]).rests == (0, 1)


def test_rows_that_do_not_count_are_as_good_as_cut_out(arm):
    log, half = record(arm, 1, held=0.0), 33.6
    model = baseline_model(arm, [log])
    effects, drives = [t.effect for t in model.terms], Drives(model.gain, model.force_unit)
    kept = fit(arm, effects, [log], 10.0, drives, counts=lambda b: np.repeat(b.log.t[:, None] < half, 2, axis=1))
    cut = fit(arm, effects, [log[log.t < half]], 10.0, drives)
    for one, other in zip(kept.model.terms, cut.model.terms, strict=True):
        np.testing.assert_allclose(one.coefficients, other.coefficients, rtol=0.02, atol=1e-3)
        np.testing.assert_allclose(one.std, other.std, rtol=0.2)


def test_identify_learns_nothing_from_what_friction_holds(arm):
    found = identify(arm, logs(arm))
    assert found.rests.joints == (0, 1)
    names = {term.effect.name for term in found.model.terms}
    assert names.isdisjoint({"maxwell-slip", "sigmoid", "stribeck", "coulomb-asymmetry"})
    force = [t.coefficients[0] for t in found.model.terms if t.effect.name == "coulomb"]
    np.testing.assert_allclose(force, DRY, rtol=0.03)
    (moving,) = evidence([found.model], [record(arm, 9)], found.rests).moving
    np.testing.assert_allclose(moving, NOISE, rtol=0.05)


def test_shapes_are_searched_without_what_friction_holds(arm):
    train = logs(arm, hidden=lambda q, dq, stands: 0.5 * np.sign(dq[:, 1]) * np.exp(-((dq[:, 1] / 0.06) ** 2)))
    found = identify(arm, train, effects=["coulomb", "viscous", "stribeck"])
    assert found.rests.joints == (0, 1)
    (one,) = (term for term in found.model.terms if term.effect.name == "stribeck" and term.effect.joint == 1)
    assert one.coefficients[0] == pytest.approx(0.5, rel=0.1)
    assert one.shape[0] == pytest.approx(0.06, rel=0.15)


def test_who_names_friction_with_memory_means_what_it_holds_at_rest(arm):
    train = logs(arm)
    found = identify(arm, train, effects=["viscous", "maxwell-slip"])
    assert found.rests.joints == ()
    without = identify(arm, train, effects=["viscous", "coulomb"])
    assert without.rests.joints == (0, 1)
    assert np.all(found.fit.factors.counted > 1.3 * without.fit.factors.counted)


def test_a_sign_that_turns_slowly_is_no_friction_that_holds(arm):
    # Moves without stops: whatever the sign of velocity does not tell there belongs to how it turns.
    def slowly(q, dq, stands):
        return DRY[1] * (np.tanh(dq[:, 1] / 1e-2) - np.tanh(dq[:, 1] / 2e-3))

    assert identify(arm, logs(arm, held=0.0, hidden=slowly), effects=["coulomb", "viscous"]).rests.joints == ()


def test_a_joint_that_turns_round_does_not_stick(arm):
    def turning(seed):
        rng = np.random.default_rng(seed)
        t = np.arange(6000) / RATE
        w, phase = 2 * np.pi * np.array([0.1, 0.14]), rng.uniform(0, 6, 2)
        q, dq, ddq = (0.5 * w**k * np.sin(w * t[:, None] + phase + 0.5 * k * np.pi) for k in range(3))
        torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
        turn = np.floor((w * t[:, None] + phase) / np.pi).astype(int)  # one level a turn
        levels = rng.uniform(-1.0, 1.0, (turn.max() + 1, 2))
        held = np.take_along_axis(levels, turn, axis=0)
        friction = DRY * np.where(np.abs(dq) < 1.5e-2, held, np.sign(dq))
        return JointLog(t=t, q=q, current=torque + friction + NOISE * rng.standard_normal(q.shape), name=f"log{seed}")

    assert identify(arm, [turning(seed) for seed in (1, 2, 3)], effects=["coulomb"]).rests.joints == ()


def test_a_joint_that_stands_for_a_moment_at_every_turn_sticks(arm):
    def sticking(seed):
        rng = np.random.default_rng(seed)
        t = np.arange(6000) / RATE
        half = np.array([1.9, 2.6])  # seconds from turn to turn, of which it stands the last
        turn, since = np.divmod(t[:, None] + rng.uniform(0, 2, 2), half)
        moves = half - 0.08
        phase, stands = np.pi * np.minimum(since / moves, 1.0), since > moves
        w, side = np.pi / moves, 0.5 * (-1.0) ** turn
        q, dq, ddq = side * np.cos(phase), -side * w * np.sin(phase), -side * w**2 * np.cos(phase) * ~stands
        torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
        torque += DRY * np.sign(dq)
        # While it stands its drive goes from what was needed to what will be, sooner or later.
        pace = 5.0 ** np.take_along_axis(rng.uniform(-1.0, 1.0, (40, 2)), turn.astype(int), axis=0)
        gone = t[:, None] - since + moves + 0.08 * np.clip((since - moves) / 0.08, 0.0, 1.0) ** pace
        for j, rest in enumerate(stands.T):
            torque[rest, j] = np.interp(gone[rest, j], t[~rest], torque[~rest, j])
        return JointLog(t=t, q=q, current=torque + NOISE * rng.standard_normal(q.shape), name=f"log{seed}")

    found = identify(arm, [sticking(seed) for seed in (1, 2, 3)], cutoff=20.0, effects=["coulomb"])
    assert found.rests.joints == (0, 1)


def test_further_joints_are_left_out_only_if_they_rest_and_move():
    nobody, speed = np.zeros(2, dtype=bool), np.full(2, 5e-3)
    rests = Rests(nobody, np.array([True, False]), speed, DRY, 0.1)
    assert rests.joints == ()
    assert rests.also([0, 1]).joints == (0,)


def test_where_nearly_all_joints_stick_the_others_do(vs060, monkeypatch, recorded):
    log = recorded(20.0)
    quiet = log.replace(q=np.where(log.t[:, None] < 5.0, log.q[:1], log.q))
    model = identify(vs060, [quiet], effects=["coulomb", "viscous"], cutoff=10.0).model
    for hidden in ((4,), (2, 4), (1, 2, 4)):
        monkeypatch.setattr(
            rests_module, "_sticks", lambda panel, survey, gap, *_, hidden=hidden: gap.joint not in hidden
        )
        found = find_rests(model, [quiet])
        assert found.may.sum() == 6
        others = set(range(6)) - set(hidden)
        assert set(found.joints) == (set(range(6)) if len(hidden) == 1 else others)


def test_what_is_held_at_rest_does_not_say_how_the_sign_turns_in_motion():
    # A joint that creeps both ways, no row slower than 3 mrad/s, and rests, at which the sign is any.
    rng = np.random.default_rng(1)
    speed = np.concatenate([np.tile([0.004, -0.004, 0.01, -0.01], 300), np.full(800, 1e-3)])
    force = np.where(np.arange(2000) < 1200, np.sign(speed), 0.1) + 0.02 * rng.standard_normal(2000)
    fold = np.arange(2000) % 4
    panel = SimpleNamespace(
        velocity=speed[:, None],
        force=force[:, None],
        fold=fold,
        columns=lambda effect, shape, joint: (
            np.tanh(speed / effect.smoothing)[:, None] if effect.name == "coulomb" else np.ones((2000, 1))
        ),
    )
    terms = [SimpleNamespace(effect=e, shape=np.zeros(0)) for e in (CurrentOffset(0), Coulomb(0))]
    friction, _ = smoothing._turning(SimpleNamespace(terms=terms), panel, np.arange(2000) < 1200, 0)
    assert friction.smoothing < 2e-3


def test_noise_of_the_velocity_counts_only_where_the_sign_turns(arm, monkeypatch):
    train = logs(arm)
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    survey, seen = survey_of(model, panel), []
    monkeypatch.setattr(
        rests_module, "_sticks", lambda panel, survey, gap, rest, slow, noise, times: seen.append(noise) or False
    )
    monkeypatch.setattr(rests_module, "shaken", lambda model, panel, survey: np.ones((len(panel), 2)))
    rests_module.rests_of(model, panel, survey)
    turns = np.abs(panel.velocity) < 3.0 * survey.smoothing
    np.testing.assert_array_equal(np.stack(seen[:2], axis=1) > 0.0, turns)


@pytest.mark.parametrize(("hertz", "hunts"), [(1.2, False), (3.3, True)])
def test_a_drive_hunts_more_than_once_in_a_rest(hertz, hunts):
    # Friction that holds what an integrator builds up swings once in each rest.
    t = np.arange(6000) / RATE
    rest = t % 3.0 < 1.0
    left = np.where(rest, np.sin(2 * np.pi * hertz * t), 0.0)
    assert _hunts(SimpleNamespace(start=np.array([0]), step=1.0 / RATE), left, rest) == hunts


@pytest.mark.parametrize(("slow", "named"), [(9e-3, False), (6e-2, True)])
def test_what_turns_the_sign_otherwise_beside_rests_is_no_effect(arm, slow, named):
    train = logs(arm)
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    v, rng = panel.velocity[:, 1], np.random.default_rng(0)
    own = [replace(t, effect=replace(t.effect, smoothing=5e-3)) for t in model.terms if t.effect.name == "coulomb"]
    edges = edge_columns(panel, [t for t in own if t.effect.joint == 1], 1)
    left = 0.4 * np.sign(v) * np.exp(-((np.abs(v) / slow) ** 1.3)) + 0.005 * rng.standard_normal(len(panel))
    everything = np.ones(len(panel), dtype=bool)
    gap = JointGap(1, np.column_stack([v, edges]), left, everything, (), 3).moving(panel, np.abs(v) < 5e-3)
    survey = survey_of(model, panel)
    bare, slight = replace(gap, edge=None), with_slight_edge(panel, gap, own)
    assert search(panel, survey, bare).winner(panel) is not None
    assert (search(panel, survey, slight).winner(panel) is not None) == named


@pytest.mark.parametrize(("known", "sticks"), [(0, False), (1, True)])
def test_friction_that_yields_over_a_displacement_holds_so_that_others_stick_sooner(known, sticks):
    gaps = [SimpleNamespace(joint=joint) for joint in range(3)]
    yields = np.arange(3) < known
    found = in_company(lambda gap, times: gap.joint == 2 and times <= 4.3, gaps, np.full(3, 9.0), yields)
    assert found.tolist() == [False, False, sticks]


@pytest.mark.parametrize("noise", [4e-5, 1e-4])
def test_friction_larger_in_one_direction_is_told_by_what_rests_lack_of_it(arm, noise):
    # Noise of the positions shakes the model's sign of velocity, and makes most of what single rows of a rest err by.
    def shaken(seed):
        log = record(arm, seed, held=0.0, hidden=lambda q, dq, still: 0.3 * ~still)
        return replace(log, q=log.q + noise * np.random.default_rng(seed).standard_normal(log.q.shape))

    train = [shaken(seed) for seed in (1, 2, 3)]
    (found,) = find_gap(baseline_model(arm, train), train, [shaken(9)]).findings
    assert (found.effect, found.joints) == ("coulomb-asymmetry", (1,))
    assert found.parameters["force"] == pytest.approx(0.3, rel=0.1)
