"""Triangular factors against dense least squares; bounds, dependence, weights, robustness."""

import numpy as np
import pytest

from ident.design import Design, Rows
from ident.effects.base import initial_term
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links, RotorInertia
from ident.fit import huber
from ident.least_squares import factorise, independent, solve, triangle
from ident.log import JointLog
from ident.robot import load_robot
from ident.walk import walk

CUTOFF = 10.0
CROSSED = """<robot name="crossed"><link name="base"/>
<link name="upper"><inertial><origin xyz=".02 0 .1"/><mass value="2"/>
<inertia ixx=".02" iyy=".03" izz=".04" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz=".2 .01 0"/><mass value="1"/>
<inertia ixx=".01" iyy=".05" izz=".05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="90"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 .1" rpy="-1.5708 0 0"/>
<axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" velocity="3" effort="50"/></joint></robot>"""


def make(robot, *effects, scale=None):
    return Design(robot, tuple(initial_term(e) for e in effects), np.ones(6) if scale is None else scale)


@pytest.fixture(scope="module")
def log(recorded):
    return recorded(20.0)


@pytest.fixture(scope="module")
def design(vs060):
    own = [e for j in range(6) for e in (CurrentOffset(j), Coulomb(j), Viscous(j))]
    return make(vs060, *[Links(j) for j in range(6)], *own)


def dense(design, log, joint):
    (rows,) = design.rows(walk(log, CUTOFF, 10**6))
    return rows.matrices[joint], rows.target[:, joint]


def test_factors_block_by_block_solve_the_dense_problem(design, log):
    factors = factorise(design, design.rows(walk(log, CUTOFF, 333)))
    solution = solve(design, factors)
    for j in range(6):
        matrix, target = dense(design, log, j)
        expected, squares, _, _ = np.linalg.lstsq(matrix, target)
        found = solution.parameters[design.columns_of_joint(j)]
        np.testing.assert_allclose(matrix @ found, matrix @ expected, atol=1e-6 * np.abs(target).max())
        assert factors.residual_variance(design, solution.parameters)[j] == pytest.approx(
            float(squares[0]) / len(target), rel=1e-6
        )
    assert factors.rows == len(matrix)


@pytest.mark.parametrize("noise", [(0.02, 0.02), (5e-4, 0.02)])
def test_what_an_angle_of_six_figures_tells_apart_is_not_told(write_card, swinging, noise):
    """Two axes at a right angle, but for the rounding of 1.5708: the second link's inertia and rotor are one factor."""
    robot, motion = load_robot(write_card("crossed", CROSSED, 'current_unit = "N*m"')), swinging(n=2)
    torque = robot.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, robot.multibody.parameters)
    torque += np.array([0.1, 0.2]) * motion.ddq + np.array(noise) * np.random.default_rng(1).normal(size=torque.shape)
    log = JointLog(motion.t, motion.q, torque, name="log")
    design = make(robot, Links(None), RotorInertia(0), RotorInertia(1), scale=np.ones(2))
    solution = solve(design, factorise(design, design.rows(walk(log, CUTOFF))))
    assert np.abs(solution.parameters).max() < 2.0


def test_shared_links_weigh_joints_by_their_noise(vs060, recorded):
    own = [e for j in range(6) for e in (CurrentOffset(j), Coulomb(j), Viscous(j), RotorInertia(j))]
    gain = np.array([0.71, 0.81, 0.403, 0.112, 0.144, 0.076])
    design = make(vs060, Links(None), *own, scale=gain)
    log = recorded(20.0)
    factors = factorise(design, design.rows(walk(log, CUTOFF)))
    solution = solve(design, factors)
    stacked, targets = [], []
    for j in range(6):
        matrix, target = dense(design, log, j)
        full = np.zeros((len(matrix), design.count))
        full[:, design.columns_of_joint(j)] = matrix
        weight = np.sqrt(solution.weights[j])
        stacked.append(weight * full)
        targets.append(weight * target)
    expected = np.linalg.lstsq(np.vstack(stacked), np.concatenate(targets))[0]
    np.testing.assert_allclose(
        np.vstack(stacked) @ solution.parameters, np.vstack(stacked) @ expected, atol=1e-3 * np.abs(expected).max()
    )
    np.testing.assert_allclose(solution.weights * factors.residual_variance(design, solution.parameters), 1, rtol=0.02)
    bread = np.linalg.pinv(np.vstack(stacked).T @ np.vstack(stacked), rcond=1e-16, hermitian=True)
    kept = np.ix_(solution.determined, solution.determined)
    reference = np.linalg.inv((np.vstack(stacked).T @ np.vstack(stacked))[kept])
    np.testing.assert_allclose(np.diag(solution.bread[kept]), np.diag(reference), rtol=0.05)
    assert bread.shape == solution.bread.shape


def test_a_column_that_others_make_up_is_dropped_and_named(vs060, log):
    # Joint 1 is vertical: its link's inertia and its rotor's cannot be told apart.
    design = make(vs060, Links(0), RotorInertia(0), CurrentOffset(1), CurrentOffset(1))
    factors = factorise(design, design.rows(walk(log, CUTOFF)))
    solution = solve(design, factors)
    rotor = int(design.columns_of_term(1)[0])
    second_offset = int(design.columns_of_term(3)[0])
    assert sorted(np.flatnonzero(~solution.determined)) == sorted([rotor, second_offset])
    np.testing.assert_array_equal(solution.determined, independent(design, factors))
    assert solution.parameters[rotor] == 0.0
    assert np.all(solution.bread[rotor] == 0.0)
    assert np.isfinite(solution.condition_number)


def test_fewer_rows_than_columns_leave_parameters_open(vs060, log):
    design = make(vs060, *[Links(j) for j in range(6)])
    rows = next(iter(design.rows(walk(log, CUTOFF))))
    few = Rows([m[:4] for m in rows.matrices], rows.target[:4])
    solution = solve(design, factorise(design, [few]))
    assert solution.determined.sum() <= 4 * 6
    assert np.all(np.isfinite(solution.parameters))


def test_lower_bounds_hold(vs060, recorded):
    # Elements that push along with the motion do not exist; the best that is left for them is nothing.
    log = recorded(10.0, extra=lambda motion: -8.0 * np.tanh(motion.dq / 5e-3))
    design = make(vs060, *[CurrentOffset(j) for j in range(6)], MaxwellSlip(3))
    solution = solve(design, factorise(design, design.rows(walk(log, CUTOFF))))
    forces = solution.parameters[design.columns_of_term(6)]
    assert np.all(forces >= 0.0)
    matrix, target = dense(design, log, 3)
    free = np.linalg.lstsq(matrix, target)[0]
    assert free.min() < 0.0
    found = solution.parameters[design.columns_of_joint(3)]
    lengths = np.linalg.norm(matrix, axis=0)
    gradient = matrix.T @ (matrix @ found - target) / (lengths * np.linalg.norm(target))
    active = found <= 1e-9
    assert active.any()
    assert np.all(gradient[active] >= -1e-6)  # every parameter at its bound would rather go below
    assert np.abs(gradient[~active]).max() < 1e-6


def test_a_constant_current_gets_no_infinite_weight(vs060, log):
    design = make(vs060, *[CurrentOffset(j) for j in range(6)])
    current = np.array(log.current)
    current[:, 2] = 3.0
    solution = solve(design, factorise(design, design.rows(walk(log.replace(current=current), CUTOFF))))
    assert solution.parameters[2] == pytest.approx(3.0)
    assert np.all(np.isfinite(solution.weights))
    assert np.all(np.isfinite(solution.bread))


def test_huber_weights_hold_outliers_down(design, log, rng):
    current = np.array(log.current)
    hit = rng.choice(len(log), 100, replace=False)
    current[hit, 1] += 150.0
    clean = solve(design, factorise(design, design.rows(walk(log, CUTOFF))))
    spoilt = log.replace(current=current)

    def rows():
        return design.rows(walk(spoilt, CUTOFF))

    plain = robust = solve(design, factorise(design, rows()))
    for _ in range(6):
        robust = solve(design, factorise(design, rows(), huber(design, robust)))
    matrix, _ = dense(design, log, 1)
    columns = design.columns_of_joint(1)
    errors = [np.linalg.norm(matrix @ (s.parameters - clean.parameters)[columns]) for s in (plain, robust)]
    assert errors[1] < 0.3 * errors[0]


@pytest.mark.parametrize("rows", [0, 3, 50])
def test_triangle_has_the_matrix_products(rng, rows):
    matrix = rng.normal(size=(rows, 5))
    upper = triangle(matrix)
    np.testing.assert_allclose(upper.T @ upper, matrix.T @ matrix, atol=1e-10)
    np.testing.assert_array_equal(upper, np.triu(upper))
