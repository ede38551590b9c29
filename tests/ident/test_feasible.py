"""Feasible parameters: bodies that can exist, the cost of that, and what the prior settles."""

from dataclasses import replace

import numpy as np
import pytest

from ident.design import Design, Rows, Seen
from ident.effects.base import initial_term
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import Links, RotorInertia
from ident.errors import InputError
from ident.feasible import EQUAL, feasible_parameters
from ident.least_squares import factorise, solve
from ident.pseudo_inertia import body_parameters, pseudo_inertia
from ident.signals import Motion

FRICTION = 2.0  # [N m], and N m s/rad
ROTOR = 0.3  # [kg m^2]


@pytest.fixture(scope="module")
def design(vs060):
    own = [effect(j) for j in range(6) for effect in (RotorInertia, Coulomb, Viscous)]
    return Design(vs060, tuple(initial_term(e) for e in [Links(None), *own]), np.ones(6))


@pytest.fixture(scope="module")
def truth(vs060):
    """Link parameters that differ from CAD by a tenth, joint for joint feasible."""
    rng = np.random.default_rng(3)
    bodies = []
    for body in vs060.multibody.parameters.reshape(6, 10):
        change = np.eye(4) + 0.05 * rng.normal(size=(4, 4))
        bodies.append(body_parameters(change @ pseudo_inertia(body) @ change.T))
    return np.concatenate(bodies)


def fitted(design, truth, noise, seed=0, samples=400):
    """Factors and free fit of noisy torques along random motion."""
    rng = np.random.default_rng(seed)
    motion = Motion(np.arange(samples) * 0.01, *rng.normal(size=(3, samples, 6)))
    body = design.robot.rigid_body
    torque = body.inverse_dynamics(motion.q, motion.dq, motion.ddq, truth) + ROTOR * motion.ddq
    torque += FRICTION * (np.tanh(motion.dq / 5e-3) + motion.dq) + noise * rng.normal(size=motion.q.shape)
    seen = Seen.of(design.context(motion), np.ones(samples, dtype=bool))
    factors = factorise(design, [Rows(design.matrices(seen, design.start()), torque)])
    return factors, solve(design, factors)


def test_pseudo_inertia_is_the_second_moment_of_point_masses(rng):
    masses, points = rng.uniform(0.1, 1.0, 5), rng.normal(size=(5, 3))
    lifted = np.column_stack([points, np.ones(5)])
    moment = (lifted.T * masses) @ lifted
    parameters = body_parameters(moment)
    inertia = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    np.testing.assert_allclose(parameters[:4], [masses.sum(), *(masses @ points)])
    np.testing.assert_allclose(parameters[4:], inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])
    np.testing.assert_allclose(pseudo_inertia(parameters), moment)


def test_where_the_free_fit_is_feasible_nothing_is_paid_and_the_prior_settles_the_rest(design, truth):
    factors, solution = fitted(design, truth, noise=0.01)
    feasible = feasible_parameters(design, factors, solution, truth)
    assert feasible.nearest.overall_rise < 0.01
    assert feasible.preferred.overall_rise < 100 * EQUAL
    assert feasible.prior == "CAD"
    # Masses and inertias that no motion shows come from the prior, which here is the truth.
    np.testing.assert_allclose(feasible.preferred.parameters, truth, rtol=0.01, atol=0.01)
    rotor = [
        k for k, (term, _) in enumerate(design.coefficients()) if design.terms[term].effect.name == "rotor-inertia"
    ]
    np.testing.assert_allclose(feasible.preferred.coefficients[rotor], ROTOR, atol=0.02)


@pytest.mark.parametrize("with_prior", [True, False])
def test_noise_that_breaks_physics_is_mended_at_a_cost(design, truth, vs060, with_prior):
    factors, solution = fitted(design, truth, noise=5.0, samples=150)
    prior = vs060.multibody.parameters if with_prior else None
    feasible = feasible_parameters(design, factors, solution, prior)
    assert feasible.prior == ("CAD" if with_prior else "generic")
    assert feasible.nearest.held
    for estimate in (feasible.nearest, feasible.preferred):
        bodies = estimate.parameters.reshape(6, 10)
        assert np.linalg.eigvalsh(pseudo_inertia(bodies)).min() > 0.0
        assert bodies[:, 0].min() > 0.0
        base = vs060.rigid_body.base_parameters().projection
        np.testing.assert_allclose(estimate.coefficients[design.columns_of_term(0)], base @ estimate.parameters)
        assert estimate.coefficients[len(base) :].min() >= 0.0
        rms = np.sqrt(factors.residual_variance(design, estimate.coefficients))
        free = np.sqrt(factors.residual_variance(design, solution.parameters))
        np.testing.assert_allclose(estimate.rise, 100 * (rms / free - 1))
        assert 0.1 < estimate.overall_rise < 20.0
    assert feasible.preferred.overall_rise < feasible.nearest.overall_rise + 100 * EQUAL


def test_no_feasible_model_in_reach_fits_better(design, truth):
    """The nearest is the least: mixing in any other feasible body raises the residual."""
    factors, solution = fitted(design, truth, noise=5.0, samples=150)
    nearest = feasible_parameters(design, factors, solution).nearest

    def cost(coefficients):
        return float(solution.weights @ factors.residual_variance(design, coefficients))

    base = design.robot.rigid_body.base_parameters().projection
    others = np.full(design.count - len(base), 1.0)
    for share in (1e-3, 1e-2, 0.1):
        for bodies in (truth, design.robot.multibody.parameters, 1.2 * truth):
            other = np.concatenate([base @ bodies, others])
            assert cost(nearest.coefficients + share * (other - nearest.coefficients)) > cost(nearest.coefficients)


def test_links_in_units_of_each_joint_are_refused(design, vs060):
    own = replace(design, terms=tuple(initial_term(Links(j)) for j in range(6)))
    factors, solution = fitted(own, vs060.multibody.parameters, noise=0.1)
    with pytest.raises(InputError, match="links that all joints share"):
        feasible_parameters(own, factors, solution)
