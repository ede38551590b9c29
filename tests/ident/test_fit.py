"""Fitting effects to logs: figures that went in come out, however the logs are cut; outliers; progress."""

import numpy as np
import pytest

from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, LoadFriction, Viscous
from ident.effects.friction_curve import Stribeck
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links, RotorInertia
from ident.fit import Drives, fit
from ident.log import concatenate
from ident.parameters import list_parameters

CUTOFF = 10.0
GAIN = np.array([0.71, 0.81, 0.403, 0.112, 0.144, 0.076])
KNOWN = Drives(GAIN, "N m")
UNKNOWN = Drives(np.ones(6), "%Use")


def baseline(shared=True):
    links = [Links(None)] if shared else [Links(j) for j in range(6)]
    own = [[CurrentOffset(j), Coulomb(j), Viscous(j)] + [RotorInertia(j)] * shared for j in range(6)]
    return [*links, *(e for effects in own for e in effects)]


def coefficient(found, name, joint):
    for term in found.model.terms:
        if term.effect.name == name and term.effect.joint == joint:
            return term.coefficients
    raise AssertionError(name)


def test_links_and_friction_come_back(vs060, recorded):
    logs = [recorded(20.0, seed=s, noise=0.05) for s in (1, 2, 3)]
    found = fit(vs060, baseline(), logs, CUTOFF, KNOWN)
    base = vs060.rigid_body.base_parameters()
    truth = base.projection @ vs060.multibody.parameters
    links = found.model.terms[0]
    wrist = np.array([name[-1] in "3456" for name in base.names])  # rotors of joints 1 and 2 act as their links do
    assert np.mean(np.abs(links.coefficients - truth)[wrist] < 2 * 1.96 * links.std[wrist]) > 0.9
    q, still = 0.4 * np.ones((1, 6)), np.zeros((1, 6))
    weight = vs060.rigid_body.inverse_dynamics(q, still, still, found.model.link_parameters)
    np.testing.assert_allclose(weight[0], vs060.multibody.gravity_torque(q[0]), atol=0.2)
    for j in range(6):
        assert coefficient(found, "coulomb", j)[0] / GAIN[j] == pytest.approx(5.0, rel=0.05)
        assert coefficient(found, "viscous", j)[0] / GAIN[j] == pytest.approx(3.0, rel=0.05)
    # Joint 2's rotor acts as one of the inertias of its link does, and is counted there.
    assert found.model.rotor_inertia[2:] == pytest.approx(0.05, abs=0.01)
    named = {p.name: p for p in list_parameters(found)}
    assert named["rotor-inertia.1.inertia"].determined is False
    assert named["coulomb.2.force"].unit == "N m"
    low, high = named["viscous.3.damping"].interval
    assert low < 3.0 * GAIN[2] < high


def test_segments_or_logs_make_no_difference(vs060, recorded):
    logs = [recorded(20.0, seed=s) for s in (1, 2)]
    apart = fit(vs060, baseline(shared=False), logs, CUTOFF, UNKNOWN)
    joined = fit(vs060, baseline(shared=False), [concatenate(logs)], CUTOFF, UNKNOWN)
    np.testing.assert_allclose(apart.model.predict(logs[0]), joined.model.predict(logs[0]), atol=1e-6)
    assert apart.factors.rows == joined.factors.rows


def test_load_friction_is_told_from_plain_friction(vs060, recorded):
    def added(motion):
        torque = vs060.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, vs060.multibody.parameters)
        return 0.1 * np.tanh(motion.dq / 5e-3) * np.abs(torque / GAIN) * (np.arange(6) == 1)

    log = recorded(30.0, noise=0.1, extra=added)
    found = fit(vs060, [*baseline(), LoadFriction(1)], [log], CUTOFF, KNOWN)
    assert coefficient(found, "load-friction", 1)[0] == pytest.approx(0.1, rel=0.1)
    assert coefficient(found, "coulomb", 1)[0] / GAIN[1] == pytest.approx(5.0, rel=0.1)


def test_shapes_and_linear_parameters_together(vs060, recorded):
    log = recorded(30.0, noise=0.1, extra=lambda m: 4.0 * np.tanh(m.dq / 5e-3) * np.exp(-((m.dq / 0.15) ** 2)))
    effects = [*baseline(shared=False), *(Stribeck(j) for j in (1, 4))]
    found = fit(vs060, effects, [log], CUTOFF, UNKNOWN)
    for term in found.model.terms:
        if term.effect.name == "stribeck":
            assert term.shape[0] == pytest.approx(0.15, rel=0.1)
            assert term.coefficients[0] == pytest.approx(4.0, rel=0.1)
            assert abs(term.shape[0] - 0.15) < 4 * term.shape_std[0]
    assert found.covariance.shape == (found.design.count + 2,) * 2


def test_robust_fits_hold_contacts_down(vs060, recorded):
    log = recorded(30.0, noise=0.1)
    current = np.array(log.current)
    current[::10] += 10.0
    clean = fit(vs060, baseline(shared=False), [log], CUTOFF, UNKNOWN)
    plain, robust = (
        fit(vs060, baseline(shared=False), [log.replace(current=current)], CUTOFF, UNKNOWN, robust=r)
        for r in (False, True)
    )
    truth = clean.model.predict(log)
    errors = [np.sqrt(np.mean((f.model.predict(log) - truth) ** 2)) for f in (plain, robust)]
    assert errors[1] < 0.5 * errors[0]


def test_progress_rises_to_one(vs060, recorded):
    told = []
    effects = [*baseline(shared=False), MaxwellSlip(0)]
    fit(vs060, effects, [recorded(10.0, seed=s) for s in (1, 2)], CUTOFF, UNKNOWN, robust=True, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert 0 < told[0] < 1
