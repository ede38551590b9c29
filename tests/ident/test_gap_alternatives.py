"""Names that logs leave open: laws that are one in slow logs, effects of a joint beside a cause of the whole robot."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ARM
from planar_arm import NOISE, RATE, friction, logs
from scipy.interpolate import CubicSpline

from ident.gap import baseline_model
from ident.gap.candidates import coefficients
from ident.gap.rows import gap_of, held_of, panel_of, survey_of
from ident.gap.search import search
from ident.gap.settle import BLOCKS, _beats, alternatives
from ident.gap.whole import _Judge
from ident.log import JointLog
from ident.robot import load_robot


def creep(arm, seed):
    """Both joints at 60 mrad/s and less, over which the second one's friction falls."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / RATE
    waves = (
        rng.uniform(0.02, 0.05, 2) * np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 6, 2))
        for f in (0.05, 0.11, 0.17)
    )
    spline = CubicSpline(t, sum(waves))
    q, dq, ddq = spline(t), spline(t, 1), spline(t, 2)
    torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
    torque += friction(dq)
    torque[:, 1] += np.tanh(dq[:, 1] / 2e-3) * np.exp(-((dq[:, 1] / 0.1) ** 2))
    return JointLog(t=t, q=q, current=torque + 0.2 * NOISE * rng.standard_normal(q.shape), name=f"creep{seed}")


@pytest.fixture(scope="module")
def crept(arm):
    """Rows, facts about the logs, and the search of the joint whose friction falls."""
    train = [creep(arm, seed) for seed in (1, 2, 3)]
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    survey = survey_of(model, panel)
    return panel, survey, search(panel, survey, gap_of(model, panel, 1))


def trials_of(found, name):
    return [trial for trial in found.trials if trial.effect.name == name]


def test_a_law_whose_shape_slow_logs_do_not_tell_is_sized_with_a_power_that_authors_use(crept):
    panel, _, found = crept
    name = found.winner(panel)
    assert any(trial.at_bound for trial in trials_of(found, "stribeck"))
    assert (name.effect.name, name.effect.power) == ("stribeck", 2.0)
    assert name.trial.shape == pytest.approx([0.1], rel=0.2)


def balancer(t, q, dq):
    """A spring between pins at nearly the same radius, with next to no free length."""
    x, lever, free = q[:, 1] - 0.1, 0.95, 0.05
    return -0.4 * np.sin(x) * (1.0 - free / np.sqrt(1.0 + lever**2 - 2.0 * lever * np.cos(x)))


def test_a_balancer_of_which_logs_do_not_tell_the_lever_is_sized_without_free_length(arm):
    train = logs(arm, 1, hidden=balancer)
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    found = search(panel, survey_of(model, panel), gap_of(model, panel, 1))
    trial = found.winner(panel).trial
    assert any(ended.at_bound for ended in trials_of(found, "gravity-balancer"))
    assert trial.effect.ideal
    (size,) = coefficients(panel, found.problem, trial, 1)
    assert (trial.shape, abs(size)) == (pytest.approx([0.1], abs=0.15), pytest.approx(0.35, rel=0.1))


@pytest.mark.parametrize(
    ("down", "name"), [((0.0, 0.0, -9.81), "gravity-balancer"), ((0.0, -9.81, 0.0), "cable-spring")]
)
def test_no_balancer_is_named_of_a_joint_without_weight_while_a_cable_does_as_well(write_card, down, name):
    arm = load_robot(write_card("arm", ARM, f'current_unit = "A"\ngravity = {list(down)}'))
    train = logs(arm, 1, hidden=lambda t, q, dq: np.sin(q[:, 1]))
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    found = search(panel, survey_of(model, panel), gap_of(model, panel, 1))
    assert found.winner(panel).effect.name == name
    assert {t.effect.idle for t in trials_of(found, "gravity-balancer")} == {name == "cable-spring"}


def test_a_law_that_fits_best_where_it_ends_is_open_if_a_usual_shape_of_it_does_as_well(crept):
    panel, _, found = crept
    name = found.winner(panel)
    open_names = alternatives(panel, found.gap, [name], name)
    assert all(trial.at_bound for trial in trials_of(found, "sigmoid"))
    assert not open_names["sigmoid"].at_bound


def test_all_effects_of_the_joint_on_which_alone_a_cause_shows_may_be_its_alternatives(crept):
    panel, survey, found = crept
    judge = _Judge(panel, survey, [found, found], False, None)
    own = judge._own(np.array([1]), np.array([0.0, 70.0]))
    assert [one.effect.name for one, _, _ in own] == [one.effect.name for one in found.trials]
    assert not any(one.at_bound for one, _, _ in own)
    best = len(found.problem) / 2 * np.log(found.before.total / found.winner(panel).trial.errors.total)
    assert [gained for one, gained, _ in own if one is found.winner(panel).trial] == pytest.approx([best])
    assert {by_cause for _, _, by_cause in own} == {70.0}
    assert judge._own(np.array([0, 1]), np.array([70.0, 70.0])) == []


@pytest.mark.parametrize(("worse", "beaten"), [(0.3, True), (0.0, False), (-0.3, False)])
def test_a_rival_is_beaten_by_what_most_blocks_say_however_much_two_of_them_do(worse, beaten):
    own = np.random.default_rng(5).standard_normal(100 * BLOCKS)
    rival = own + worse * np.random.default_rng(6).standard_normal(len(own))
    if worse < 0.0:
        own, rival = rival, own
    rival[:150] += 30.0
    assert _beats(own, rival) is beaten


def test_a_rival_that_leaves_the_same_is_not_beaten():
    assert not _beats(np.ones(1000), np.ones(1000))


def test_an_offset_of_a_joint_that_sticks_may_be_an_asymmetry_of_which_nothing_was_asked(arm):
    train = logs(arm, 1, hidden=lambda t, q, dq: np.full(len(t), 0.2))
    model = baseline_model(arm, logs(arm, 11))
    panel = panel_of(model, train)
    gap = held_of(model, panel, 1)
    for sticks in (False, True):
        found = search(panel, survey_of(model, panel, held=True), replace(gap, sticks=sticks))
        name = found.winner(panel)
        open_names = alternatives(panel, found.gap, [name], name)
        assert name.effect.name == "current-offset"
        assert (open_names.get("coulomb-asymmetry", name) is None) == sticks
