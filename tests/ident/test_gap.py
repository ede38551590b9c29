"""The gap workflow on a two-link arm: names what is hidden, keeps silent where nothing or something foreign is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import planar_arm
import pytest
from planar_arm import NOISE, RATE, delayed, logs, motion, record, structure
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from ident.card import Drive
from ident.effects import load_catalogue
from ident.effects.friction import LoadFriction, Viscous
from ident.gap import baseline_model, belief, find_gap, naming, reporter
from ident.gap.candidates import Trial, kind_of
from ident.gap.edge import edge_columns, with_less_edge
from ident.gap.joint_gap import JointGap, Named
from ident.gap.rows import panel_of
from ident.gap.velocity_lag import velocity_lag
from ident.identification import identify
from ident.model_file import load_model, save_model

PLAIN = ("coulomb", "viscous")


def test_nothing_is_named_where_nothing_is_hidden(arm):
    found = structure(arm)
    assert found.findings == ()
    assert found.unexplained == ()
    assert {u.effect for u in found.untestable} >= {"payload", "drive-gain"}
    np.testing.assert_allclose(found.evidence.before, NOISE, rtol=0.1)


def test_a_hidden_effect_is_named_sized_and_added(arm, tmp_path):
    # Not the catalogue's law: it falls with the power 1.5 of speed.
    found = structure(arm, hidden=falls_with_speed)
    (one,) = found.findings
    assert (one.effect, one.joints, one.family) == ("stribeck", (1,), "friction")
    assert one.parameters["speed"] == pytest.approx(0.04, rel=0.15)
    assert one.p_value < 0.01
    assert one.control is not None
    assert one.control < 0.01
    before, after = found.evidence.before[1], found.evidence.after[1]
    assert before > 1.4 * NOISE
    assert after < 1.06 * NOISE
    assert found.model.terms[-1].shape[0] == one.parameters["speed"]
    assert found.model.terms[-1].coefficients[0] == one.parameters["force"]
    save_model(found.model, tmp_path)
    log = record(arm, 9)
    np.testing.assert_allclose(load_model(tmp_path, arm).predict(log), found.model.predict(log))


def test_saturation_is_sized_although_links_have_bent_to_it(arm):
    def saturated(seed):
        log = record(arm, seed)
        missing = 0.5 * (log.current[:, 1] / 6.0) ** 2
        return log.replace(current=log.current * np.column_stack([np.ones(len(missing)), 1.0 + missing]))

    train = [saturated(seed) for seed in (1, 2, 3)]
    found = find_gap(baseline_model(arm, train), train, [saturated(9)])
    (one,) = found.findings
    assert (one.effect, one.joints) == ("torque-saturation", (1,))
    largest = max(np.abs(record(arm, seed).current[:, 1]).max() for seed in (1, 2, 3))
    missing = 0.5 * (largest / 6.0) ** 2
    assert one.parameters["share"] == pytest.approx(missing / (1.0 + missing), rel=0.1)
    assert one.parameters["power"] == pytest.approx(2.0, rel=0.1)
    assert found.evidence.after[1] < 0.6 * found.evidence.before[1]


def test_what_only_a_name_that_is_not_believed_explains_is_unexplained(arm):
    found = structure(arm, hidden=lambda t, q, dq: 0.35 * np.tanh(dq[:, 1] / 2e-3) * (t > 37.0))
    assert found.findings == ()
    assert [one.joints for one in found.unexplained] == [(1,)]


def test_friction_by_load_is_sized_although_links_have_bent_to_it(arm):
    def loaded(seed):
        log, (_, q, dq, ddq) = record(arm, seed), motion(seed)
        load = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))[:, 0]
        friction = 0.4 * (np.sqrt(load**2 + 0.5**2) - 0.5) * np.tanh(dq[:, 0] / 2e-3)
        return log.replace(current=log.current + friction[:, None] * np.array([1.0, 0.0]))

    train = [loaded(seed) for seed in (1, 2, 3)]
    found = find_gap(baseline_model(arm, train), train, [loaded(9)])
    assert [(one.effect, one.joints) for one in found.findings] == [("load-friction", (0,))]
    # With links as they were fitted without it, .404.
    assert found.findings[0].parameters["force"] == pytest.approx(0.4, rel=0.003)


def test_what_the_catalogue_does_not_have_is_not_named(arm):
    found = structure(arm, hidden=lambda t, q, dq: 0.15 * np.sin(2 * np.pi * 3.1 * t))
    assert found.findings == ()
    (one,) = found.unexplained
    assert one.joints == (1,)
    assert "Hz" in one.depends_on[0]


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_a_stop_is_no_spring(arm, power):
    found = structure(arm, hidden=lambda t, q, dq: np.maximum(q[:, 1] - 0.35, 0.0) ** power)
    assert found.findings == ()
    (one,) = found.unexplained
    assert (one.joints, one.depends_on[0]) == ((1,), "q2")


def falls_with_speed(t, q, dq):
    """Dry friction of the second joint that falls over 40 mrad/s."""
    return 0.4 * np.sign(dq[:, 1]) * np.exp(-(np.abs(dq[:, 1] / 0.04) ** 1.5))


def follows_nothing(seconds, size):
    """Noise that lasts for some seconds, another in every log."""

    def law(t, q, dq):
        rng, pole = np.random.default_rng(round(1e6 * abs(q[5, 0]))), np.exp(-1.0 / (seconds * RATE))
        return size * lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(len(t)))

    return law


def test_a_joint_is_given_one_spring():
    kinds = [kind_of(load_catalogue()[name](0)) for name in ("cable-spring", "gravity-balancer", "gear-ripple")]
    assert kinds[0] == kinds[1] != kinds[2]


def test_names_that_leave_what_lasts_are_withdrawn(arm, monkeypatch):
    # The same logs have it named elsewhere here; only what the residual remembers is another.
    monkeypatch.setattr(belief, "remembered", lambda *_: 0.5)
    found = structure(arm, hidden=falls_with_speed)
    assert found.findings == ()
    assert (1,) in [u.joints for u in found.unexplained]


def test_what_comes_as_a_joint_turns_is_said_to(arm):
    def after_turns(t, q, dq):
        turned = np.flatnonzero(np.diff(np.sign(dq[:, 1])) != 0) + 1
        force = np.zeros(len(t))
        for k, sign in enumerate(np.sign(dq[turned, 1])):
            force[turned[k] : turned[k] + 8] = (1.0 if k % 2 else 3.0) * sign
        return force

    (one,) = structure(arm, hidden=after_turns).unexplained
    assert (one.joints, one.depends_on[0]) == ((1,), "sign(dq2) (as it turns)")
    assert "sign(dq2)" not in one.depends_on


def test_what_lasts_and_follows_no_signal_is_unexplained(arm):
    found = structure(arm, hidden=follows_nothing(0.2, 0.3))
    assert found.findings == ()
    (one,) = found.unexplained
    assert one.joints == (1,)
    assert one.depends_on == ("t (its own past)",)


def test_a_name_of_which_the_model_delivered_has_nothing_is_withdrawn(arm, monkeypatch):
    # Other joints' rows deny no name here.
    monkeypatch.setattr(reporter, "is_nil", lambda finding: bool(finding.terms))
    found = structure(arm, hidden=falls_with_speed)
    assert (found.findings, found.warnings, len(found.model.terms)) == ((), (), len(found.before.terms))
    assert (1,) in [u.joints for u in found.unexplained]


@pytest.mark.parametrize(("share", "kept"), [(0.03, ["cogging", "stribeck"]), (None, [])])
def test_a_name_that_varies_is_withdrawn_and_the_others_stay_if_they_explain_enough(monkeypatch, share, kept):
    catalogue, varies = load_catalogue(), {"stribeck": 0.01, "viscous-nonlinear": 0.2, "cogging": 0.0}
    named = [
        Named(Trial(catalogue[name](0), np.ones(2), 0.0), 0.0, 0.0)
        for name in ("cogging", "viscous-nonlinear", "stribeck")
    ]
    monkeypatch.setattr(belief, "inconstancy", lambda panel, survey, gap, names: [varies[n.effect.name] for n in names])
    monkeypatch.setattr(belief, "_allowed", lambda panel, survey, gap, names: 0.03 if len(names) > 2 else share)
    assert [one.effect.name for one in belief.believed(None, None, None, named)] == kept


@pytest.mark.parametrize("holds", [True, False])
def test_another_form_of_a_law_that_varies_may_be_constant(monkeypatch, holds):
    forms = [Trial(effect, np.zeros(0), 0.0) for effect in (LoadFriction(0), Viscous(0), LoadFriction(0, driven=True))]
    named = [Named(forms[0], 0.0, 0.0, tuple(forms)), Named(forms[1], 0.0, 0.0, tuple(forms))]
    constant = [trial.effect for trial in forms[1:]]
    monkeypatch.setattr(naming, "believed", lambda panel, survey, gap, ns: [n for n in ns if n.effect in constant])
    monkeypatch.setattr(naming, "holds_beside", lambda panel, gap, one, ns: holds and one in ns)
    found, sure = naming._steadier(SimpleNamespace(panel=None, survey=None), None, named, named[1:])
    assert [one.effect for one in sure] == (constant[::-1] if holds else constant[:1])
    assert [one.effect for one in found] == [forms[2 if holds else 0].effect, forms[1].effect]


def hunts(t, q, dq):
    return 0.12 * np.exp(-((dq[:, 1] / 0.05) ** 2)) * np.sin(2 * np.pi * 3.3 * t)


def rattles(t, q, dq):
    return 0.3 * np.exp(-((dq[:, 1] / 0.03) ** 2)) * np.random.default_rng(len(t)).standard_normal(len(t))


def rumbles(t, q, dq):
    return 0.4 * np.abs(dq[:, 1]) * np.random.default_rng(len(t)).standard_normal(len(t))


@pytest.mark.parametrize(
    ("law", "depends_on"), [(hunts, "t (3.3 Hz)"), (rattles, "|dq2| (its size)"), (rumbles, "dq2^2 (its size)")]
)
def test_what_no_law_repeats_is_seen_where_it_happens_and_not_named(arm, law, depends_on):
    found = structure(arm, hidden=law)
    assert found.findings == ()
    (one,) = found.unexplained
    assert one.joints == (1,)
    assert one.depends_on == (depends_on,)


def test_play_that_knocks_as_the_load_changes_sides_is_seen_and_not_named(arm, monkeypatch):
    def knocks(t, q, dq):
        near = np.exp(-((np.cos(q[:, 0] + q[:, 1]) / 0.05) ** 2))
        return 0.6 * near * np.random.default_rng(len(t)).standard_normal(len(t))

    def upright(seed, plain=motion):
        t, q, dq, ddq = plain(seed)
        return t, q + np.array([0.0, 1.5]), dq, ddq

    monkeypatch.setattr(planar_arm, "motion", upright)
    found = structure(arm, hidden=knocks)
    assert found.findings == ()
    (one,) = found.unexplained
    assert (one.joints, one.depends_on) == ((1,), ("load2 (its size)",))


def test_friction_that_turns_slowly_is_no_edge(arm):
    model = baseline_model(arm, logs(arm, 1))
    panel = panel_of(model, logs(arm, 1))
    (dry,) = (t for t in model.terms if t.effect.name == "coulomb" and t.effect.joint == 1)
    edges = edge_columns(panel, model.terms, 1)
    for times, left in ((8.0, 2), (0.5, None)):
        slow = times * float(dry.coefficients[0]) * edges[:, 0]
        gap = JointGap(1, edges, slow, np.ones(len(panel), dtype=bool), (), 3)
        sharp = with_less_edge(panel, gap, model.terms)
        assert (None if sharp is None else sharp.nuisance) == left


def test_rows_whose_sign_of_velocity_is_noise_are_left_out_and_names_stay(arm):
    def noisy(seed):
        log = record(arm, seed, hidden=lambda t, q, dq: 0.8 * dq[:, 1] * np.abs(dq[:, 1]))
        return log.replace(q=log.q + 2e-4 * np.random.default_rng(seed).standard_normal(log.q.shape))

    train = [noisy(seed) for seed in (1, 2, 3)]
    model = baseline_model(arm, train, cutoff=identify(arm, train, effects=PLAIN).cutoff.hertz)
    found = find_gap(model, train)
    left_out = np.isnan(found.residuals[0]).mean(axis=0)
    assert np.all((left_out > 0.02) & (left_out < 0.5))
    assert [(one.effect, one.joints) for one in found.findings] == [("viscous-nonlinear", (1,))]
    clean = logs(arm, 1)
    assert not np.isnan(find_gap(baseline_model(arm, clean), clean).residuals[0]).any()


def test_rows_that_err_by_more_than_noise_of_the_velocity_makes_stay(arm):
    def late(seed):
        log, rng = delayed(record(arm, seed), 5e-3), np.random.default_rng(seed)
        return log.replace(q=log.q + 4e-5 * rng.standard_normal(log.q.shape))

    train = [late(seed) for seed in (1, 2, 3)]
    found = find_gap(baseline_model(arm, train), train)
    assert not np.isnan(found.residuals[0]).any()
    assert [one.effect for one in found.findings] == ["delay"]


def test_lagging_velocities_are_named_and_left_out(arm):
    train = []
    for seed in (1, 2):
        log = record(arm, seed)
        t, _, dq, _ = motion(seed)
        late = np.stack([np.interp(t - 0.006, t, v) for v in dq.T], axis=1)
        train.append(log.replace(dq=late))
    lag = velocity_lag(train, 8.0)
    assert lag.seconds == pytest.approx(0.006, rel=0.1)
    assert velocity_lag(logs(arm, 1), 8.0) is None
    found = find_gap(baseline_model(arm, train), train)
    assert found.findings[0].effect == "delay"
    assert found.model.positions_only


def test_velocities_that_always_lagged_are_no_change(arm):
    def lagging(seed, seconds):
        t, _, dq, _ = motion(seed)
        late = np.stack([np.interp(t - seconds, t, v) for v in dq.T], axis=1)
        return record(arm, seed).replace(dq=late)

    before, prompt, train = (
        [lagging(seed, seconds), lagging(seed + 1, seconds)] for seed, seconds in ((1, 6e-3), (3, 0.0), (5, 6e-3))
    )
    assert find_gap(baseline_model(arm, before), train, refit=False).findings == ()
    assert find_gap(baseline_model(arm, prompt), train, refit=False).findings[0].effect == "delay"


def test_a_spring_that_all_joints_feel_is_one_joints(arm):
    links = np.tile(arm.multibody.parameters, (2, 1))

    def sprung(seed):
        t, *moves = motion(seed)
        wind = CubicSpline(t, arm.rigid_body.inverse_dynamics(*moves, links)[:, 0] / 200.0)
        moved = [x - np.column_stack([wind(t, order), np.zeros(len(t))]) for order, x in enumerate(moves)]
        change = arm.rigid_body.inverse_dynamics(*moved, links) - arm.rigid_body.inverse_dynamics(*moves, links)
        log = record(arm, seed)
        return log.replace(current=log.current + change)

    train = [sprung(seed) for seed in (1, 2, 3)]
    found = find_gap(baseline_model(arm, train), train, [sprung(9)])
    (one,) = found.findings
    assert (one.effect, one.joints) == ("elasticity", (0,))
    assert one.parameters["stiffness"] == pytest.approx(200.0, rel=0.06)
    np.testing.assert_allclose(found.evidence.after, NOISE, rtol=0.1)
    assert find_gap(found.model, train).findings == ()


def test_a_wrong_torque_constant_is_told_by_the_links_that_rows_share(arm):
    def wrong(log):
        return log.replace(current=log.current * np.array([1.0, 1.15]))

    train = [wrong(log) for log in logs(arm, 1)]
    known = replace(arm, card=arm.card.model_copy(update={"drive": Drive(gain=[1.0, 1.0])}))
    found = find_gap(baseline_model(known, train), train, [wrong(record(arm, 9))])
    assert [(one.effect, one.joints) for one in found.findings] == [("drive-gain", (1,))]
    assert found.findings[0].parameters["scale"] == pytest.approx(1 / 1.15, rel=0.02)
    assert found.evidence.before.max() > 1.4 * NOISE
    np.testing.assert_allclose(found.evidence.after, NOISE * np.array([1.0, 1.15]), rtol=0.1)
    # The map shows it: rows fitted one joint at a time would bend their links to it and leave noise.
    assert np.nanmax(found.map_before.rms / found.map_after.rms) > 1.2


def test_a_cable_hangs_free_at_an_angle_of_its_own(arm):
    found = structure(arm, hidden=lambda t, q, dq: 0.2 * (q[:, 1] - 0.5) + 0.5 * (q[:, 1] - 0.5) ** 3)
    (one,) = found.findings
    assert (one.effect, one.joints) == ("cable-spring", (1,))
    assert one.parameters["neutral"] == pytest.approx(0.5, abs=0.05)
    assert one.parameters["stiffening"] == pytest.approx(0.5, rel=0.15)


def test_a_ripples_second_harmonic_is_part_of_it(arm):
    def ripple(t, q, dq):
        return 0.2 * np.sin(7 * q[:, 1] + 0.3) + 0.07 * np.sin(14 * q[:, 1] + 1.0)

    (one,) = structure(arm, hidden=ripple).findings
    assert one.effect in ("gear-ripple", "cogging")
    assert one.parameters["per_turn"] == pytest.approx(7.0, abs=0.1)
    assert one.parameters["second_harmonic"] == pytest.approx(0.07, rel=0.15)


def test_a_gears_ripple_grows_with_its_load(arm):
    def ripple(t, q, dq):
        still, links = np.zeros_like(q), np.tile(arm.multibody.parameters, (2, 1))
        load = np.abs(arm.rigid_body.inverse_dynamics(q, still, still, links)[:, 1])
        return 0.4 * load / load.max() * np.sin(7 * q[:, 1] + 0.3)

    found = structure(arm, hidden=ripple)
    (one,) = found.findings
    assert one.effect in ("gear-ripple", "cogging")
    assert one.parameters["per_turn"] == pytest.approx(7.0, abs=0.1)
    assert one.parameters["force"] > 1.5 * one.parameters["unloaded"]
    assert found.unexplained == ()


def test_a_force_that_grows_with_another_joints_speed_is_no_dry_friction(arm):
    found = structure(arm, hidden=lambda t, q, dq: 0.9 * dq[:, 0])
    assert found.findings == ()
    assert (1,) in [one.joints for one in found.unexplained]
