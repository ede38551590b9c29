"""What has changed since a model of the two-link arm was identified, and what its own errors are."""

from dataclasses import replace

import numpy as np
import pytest
from planar_arm import NOISE, logs, record

from ident.effects.friction import Coulomb
from ident.effects.friction_curve import Stribeck
from ident.fit import Drives, fit
from ident.gap import baseline_model, find_gap
from ident.gap.gate import Gate
from ident.gap.joint_gap import JointGap
from ident.gap.problem import JointProblem
from ident.gap.search import Search
from ident.gap.subject import Subject
from ident.log import JointLog


def test_a_change_is_named_against_a_model_held_fixed(arm):
    model = baseline_model(arm, logs(arm, 1))
    found = find_gap(model, logs(arm, 4, mass=0.5), [record(arm, 9, mass=0.5)], refit=False)
    assert found.findings[0].effect == "payload"
    assert found.findings[0].joints == ()
    assert found.findings[0].parameters["mass"] == pytest.approx(0.5, rel=0.2)
    assert np.all(found.evidence.after < 0.5 * found.evidence.before)


def test_what_the_logs_do_not_tell_of_a_payload_is_said(arm):
    found = find_gap(baseline_model(arm, logs(arm, 1)), logs(arm, 4, mass=0.5), refit=False)
    (said,) = (warning for warning in found.warnings if warning.startswith("payload: "))
    assert "hardly tell its my, and" in said  # along the axes that both joints turn about


@pytest.mark.parametrize("inertia", [0.0, 0.12])
def test_a_payload_has_the_inertia_that_shows(arm, inertia):
    model = baseline_model(arm, logs(arm, 1))
    found = find_gap(model, logs(arm, 4, mass=0.5, inertia=inertia), refit=False)
    assert [one.effect for one in found.findings] == ["payload"]
    term = found.findings[0].terms[0]
    assert term.effect.inertia == (inertia > 0.0)
    assert found.findings[0].parameters["mass"] == pytest.approx(0.5, rel=0.2)
    if inertia:
        assert term.coefficients[6] == pytest.approx(inertia, rel=0.15)


def test_a_cold_start_is_one_name_against_a_model_of_the_warm_joint(arm):
    model = baseline_model(arm, logs(arm, 1))
    cold = logs(arm, 4, hidden=lambda t, q, dq: 0.25 * np.exp(-t / 25.0) * np.tanh(dq[:, 1] / 2e-3))
    found = find_gap(model, cold, refit=False)
    assert [(one.effect, one.joints) for one in found.findings] == [("thermal-friction", (1,))]
    assert found.findings[0].terms[0].effect.warm
    assert found.findings[0].parameters["seconds"] == pytest.approx(25.0, rel=0.3)


def test_a_term_that_a_model_lacks_is_named_before_laws_that_contain_it(arm):
    train = logs(arm, 1)
    model = baseline_model(arm, train)
    effects = [t.effect for t in model.terms if not (isinstance(t.effect, Coulomb) and t.effect.joint == 1)]
    poorer = fit(arm, effects, train, model.cutoff, Drives(model.gain, model.force_unit)).model
    found = find_gap(poorer, train)
    assert [(one.effect, one.joints) for one in found.findings] == [("coulomb", (1,))]
    assert found.findings[0].parameters["force"] == pytest.approx(0.8, rel=0.05)


def test_friction_that_changed_is_named(arm):
    model = baseline_model(arm, logs(arm, 1))
    stiffer = logs(arm, 4, hidden=lambda t, q, dq: 0.16 * np.tanh(dq[:, 1] / 2e-3))
    found = find_gap(model, stiffer, refit=False)
    assert [(one.effect, one.joints) for one in found.findings] == [("coulomb", (1,))]
    assert found.findings[0].parameters["force"] == pytest.approx(0.16, rel=0.1)


def test_a_tenth_more_damping_is_named_beside_noise(arm):
    model = baseline_model(arm, logs(arm, 1))
    found = find_gap(model, logs(arm, 4, hidden=lambda t, q, dq: 0.05 * dq[:, 1]), refit=False)
    assert [(one.effect, one.joints) for one in found.findings] == [("viscous", (1,))]
    assert found.findings[0].parameters["damping"] == pytest.approx(0.05, rel=0.1)


def test_what_a_model_may_err_by_is_no_change(arm):
    little = record(arm, 1)
    rows = slice(1500, 3000)
    slow = JointLog(t=little.t[rows], q=little.q[rows], current=little.current[rows], name="slow")
    model, now = baseline_model(arm, [slow]), logs(arm, 4)
    found = find_gap(model, now, refit=False)
    assert not found.findings
    assert not found.unexplained
    assert "Joint 1 (a): 98 % of the squared gap that is left lies within the errors" in found.warnings[0]
    assert np.nanmax(found.map_before.rms[0]) > 0.5  # the map shows it all the same
    assert found.noise_floor == pytest.approx(NOISE, rel=0.05)
    sure = replace(model, terms=tuple(replace(term, errors=np.zeros((0, 0))) for term in model.terms))
    assert find_gap(sure, now, refit=False).findings


def test_a_model_identified_from_as_much_is_known_well(arm):
    subject = Subject(baseline_model(arm, logs(arm, 1)), logs(arm, 4, mass=0.5), refit=False)
    subject.look()
    assert [len(gap.prior) for gap in subject.gaps] == [0, 0]


@pytest.mark.parametrize(("change", "share"), [(0.02, 1.0), (0.2, 1.0 - 0.85**2)])
def test_small_errors_of_a_models_own_friction_are_tolerated(change, share):
    force = np.sign(np.sin(np.arange(2000) / 50.0))
    keep = np.ones(2000, bool)
    gap = JointGap(0, np.zeros((2000, 0)), change * force, keep, (), friction=force[:, None])
    problem = JointProblem(gap.matrix, gap.target, np.arange(2000) // 500, keep)
    gate = Gate(problem, np.array([0]), np.ones(2000))
    found = Search(gap, (), problem, problem.errors(), gate, ())
    square = float(gap.target @ gap.target)
    assert found.tolerated == pytest.approx(share * square, rel=1e-3)
    # Half of that besides, or of the rest where that is less: an effect that leaves nothing can always be named.
    assert found.least(Stribeck(0)) == pytest.approx(min(1.5 * share, 0.5 + 0.5 * share) * square, rel=1e-3)
    # Noise is nothing that an effect could leave.
    noisy = replace(found, predictable=0.5)
    assert noisy.least(Stribeck(0)) == pytest.approx(max(0.25 + 0.5 * share, share) * square, rel=1e-3)
