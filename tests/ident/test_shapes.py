"""Variable projection: known shapes come back, and the search's gradient is a gradient."""

from dataclasses import replace

import numpy as np
import pytest

from ident.design import Design
from ident.effects.base import Context, Term, initial_term
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.friction_curve import Sigmoid, Stribeck, ViscousNonlinear
from ident.effects.hysteresis import Backlash, MaxwellSlip
from ident.effects.ripple import GearRipple
from ident.effects.transmission import CrossJointFriction
from ident.log import JointLog
from ident.shapes import _Projection, optimise_shapes, orthonormal
from ident.walk import Block


def problem(robot, motion, effects, shapes, coefficients, noise=0.0, joint=1):
    """A design, and rows whose current is what the effects with known figures make."""
    terms = tuple(initial_term(e) for e in effects)
    design = Design(robot, terms, np.ones(6))
    context = design.context(motion)
    current = np.zeros_like(motion.q)
    for effect, shape, own in zip(effects, shapes, coefficients, strict=True):
        current[:, joint] += effect.current(context, np.array(shape), np.array(own), effect.start())
    current += noise * np.random.default_rng(0).normal(size=current.shape)
    log = JointLog(motion.t, motion.q, current)
    return design, [Block(log, motion, True, np.ones(len(log), dtype=bool))]


@pytest.fixture(scope="module")
def motion(swinging):
    return swinging(20.0)


CASES = [
    ([CurrentOffset(1), Coulomb(1), Stribeck(1)], [[], [], [0.08]], [[1.0], [5.0], [3.0]], 2),
    ([CurrentOffset(1), MaxwellSlip(1, spread=(1.0,))], [[], [3e-3]], [[1.0], [4.0]], 1),
    ([Viscous(1), Sigmoid(1)], [[], [0.06, 0.02]], [[2.0], [6.0]], 1),
    ([Coulomb(1), ViscousNonlinear(1)], [[], [0.6]], [[2.0], [6.0]], 1),
    ([Viscous(1), CrossJointFriction(1, source=2)], [[], [-0.7, 0.03]], [[2.0], [3.0, 1.0]], 1),
    ([Viscous(1), CrossJointFriction(1, source=2)], [[], [1.55, 0.03]], [[2.0], [3.0, 1.0]], 1),
    ([Viscous(1), GearRipple(1)], [[], [13.3]], [[2.0], [0.8, -0.5]], 1),
]


@pytest.mark.parametrize(("effects", "shapes", "coefficients", "shaped"), CASES, ids=[c[0][c[3]].name for c in CASES])
def test_known_shapes_come_back(vs060, motion, effects, shapes, coefficients, shaped):
    design, blocks = problem(vs060, motion, effects, shapes, coefficients, noise=0.05)
    found = optimise_shapes(design, blocks).terms[shaped].shape
    np.testing.assert_allclose(found, shapes[shaped], rtol=0.05)
    exact, blocks = problem(vs060, motion, effects, shapes, coefficients)
    np.testing.assert_allclose(optimise_shapes(exact, blocks).terms[shaped].shape, shapes[shaped], rtol=1e-3)


def test_what_all_rows_feel_of_one_joint_is_searched_in_its_own(vs060, motion):
    links = np.tile(vs060.multibody.parameters, (6, 1))
    load = vs060.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, links)
    context, joint, shape = Context(vs060, motion, load, links), 2, np.array([3e-3, 20.0, 0.2])
    play = Backlash(joint, flies=True, everywhere=True)
    current = play.current(context, shape, np.ones(1), play.start())
    design = Design(vs060, (Term(play, np.array([3.3e-3, 17.0, 0.3])),), np.ones(6), known=lambda _: context)
    block = Block(JointLog(motion.t, motion.q, current), motion, True, np.ones(len(motion), dtype=bool))
    found = optimise_shapes(design, [block], dependent=True).terms[0].shape
    np.testing.assert_allclose(found, shape, rtol=1e-3)


def test_two_shapes_of_one_joint_are_searched_together(vs060, motion):
    effects = [Coulomb(1), Stribeck(1), ViscousNonlinear(1)]
    design, blocks = problem(vs060, motion, effects, [[], [0.1], [0.7]], [[5.0], [4.0], [3.0]], 0.01)
    _, stribeck, power = (term.shape for term in optimise_shapes(design, blocks).terms)
    assert stribeck[0] == pytest.approx(0.1, rel=0.05)
    assert power[0] == pytest.approx(0.7, rel=0.05)


def test_only_the_joints_asked_for_are_searched(vs060, motion):
    design, blocks = problem(vs060, motion, [Coulomb(1), Stribeck(1)], [[], [0.2]], [[5.0], [4.0]])
    assert optimise_shapes(design, blocks, [0, 2]).terms[1].shape[0] == design.terms[1].shape[0]
    assert optimise_shapes(design, blocks, [1]).terms[1].shape[0] == pytest.approx(0.2, rel=1e-3)


def test_rows_that_are_not_kept_do_not_count(vs060, motion):
    design, blocks = problem(vs060, motion, [Coulomb(1), Stribeck(1)], [[], [0.2]], [[5.0], [4.0]])
    current = np.array(blocks[0].log.current)
    current[500:900] = 100.0
    keep = np.ones(len(current), dtype=bool)
    keep[500:900] = False
    spoilt = replace(blocks[0], log=blocks[0].log.replace(current=current), keep=keep)
    assert optimise_shapes(design, [spoilt]).terms[1].shape[0] == pytest.approx(0.2, rel=1e-3)


def test_the_gradient_of_the_squares_is_exact(vs060, motion):
    # Kaufman's jacobian is not the residual's own, but its product with the residual is.
    effects = [CurrentOffset(1), Viscous(1), Stribeck(1), Sigmoid(1)]
    figures = [[], [], [0.08], [0.2, 0.01]], [[1.0], [2.0], [3.0], [4.0]]
    design, blocks = problem(vs060, motion, effects, *figures, noise=0.5)
    projection = _Projection.of(design, blocks, [design.seen(block) for block in blocks], 1, [2, 3])
    shape = np.array([0.05, 0.1, 0.02])
    slope = 2 * projection.residual(shape) @ projection.jacobian(shape)
    for k in range(3):
        step = 1e-5 * np.eye(3)[k]
        squares = [float(np.sum(projection.residual(shape + sign * step) ** 2)) for sign in (1, -1)]
        assert slope[k] == pytest.approx((squares[0] - squares[1]) / 2e-5, rel=1e-3)


def test_orthonormal_basis_of_dependent_columns(rng):
    matrix = rng.normal(size=(200, 4)) * np.array([1.0, 1e6, 1e-5, 1.0])
    matrix = np.column_stack([matrix, matrix[:, 0] + matrix[:, 3], np.zeros(200)])
    basis = orthonormal(matrix)
    assert basis.shape == (200, 4)
    np.testing.assert_allclose(basis.T @ basis, np.eye(4), atol=1e-12)
    scaled = matrix[:, :5] / np.linalg.norm(matrix[:, :5], axis=0)
    np.testing.assert_allclose(basis @ (basis.T @ scaled), scaled, atol=1e-7)
    assert orthonormal(np.zeros((5, 2))).shape == (5, 0)
