"""A joint's regression: what columns explain besides the baseline's, against least squares on all rows."""

import numpy as np
import pytest

from ident.gap.problem import JointProblem

FOLD = np.arange(4000) // 1000


@pytest.fixture
def baseline():
    """Columns of which two say the same."""
    matrix = np.random.default_rng(1).standard_normal((4000, 6))
    matrix[:, 5] = 2.0 * matrix[:, 1]
    return matrix


def left(matrix, target):
    return target - matrix @ np.linalg.lstsq(matrix, target)[0]


@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e8])
def test_columns_explain_what_least_squares_says(baseline, scale):
    rng = np.random.default_rng(2)
    columns = scale * (rng.standard_normal((4000, 2)) + baseline[:, :2])
    keep = rng.random(4000) < 0.7
    target = baseline @ rng.standard_normal(6) + columns @ [0.3, -0.2] / scale + rng.standard_normal(4000)
    problem = JointProblem(baseline, target, FOLD, keep)
    both, own = np.hstack([baseline, columns])[keep], columns[keep]
    np.testing.assert_array_equal(problem.of(columns), own)
    np.testing.assert_array_equal(problem.left_out_of(columns), columns[~keep])
    before, after = left(baseline[keep], target[keep]), left(both, target[keep])
    assert problem.drop(own) == pytest.approx(before @ before - after @ after, rel=1e-6)
    np.testing.assert_allclose(problem.left(own), after, atol=1e-6)
    found = np.linalg.lstsq(both / np.where(np.arange(8) < 6, 1.0, scale), target[keep])[0][6:] / scale
    np.testing.assert_allclose(problem.beyond(own).coefficients, found, rtol=1e-6)
    np.testing.assert_allclose(problem.fit(own)[6:], found, rtol=1e-6)
    each = [left(np.hstack([baseline, columns[:, [k]]])[keep], target[keep]) for k in range(2)]
    np.testing.assert_allclose(problem.drops(own)[0], [before @ before - x @ x for x in each], rtol=1e-6)


def test_known_coefficients_are_told_by_rows_that_say_so(baseline):
    rng = np.random.default_rng(5)
    column, keep = rng.standard_normal((4000, 1)), rng.random(4000) < 0.7
    target = baseline @ rng.standard_normal(6) + 0.4 * column[:, 0] + rng.standard_normal(4000)
    prior = np.array([2000.0, 300.0, 0.5])
    problem, own = JointProblem(baseline, target, FOLD, keep, prior), column[keep]
    said = np.diag(np.sqrt(np.append(prior, np.zeros(4))))[:3]
    rows = np.vstack([np.hstack([baseline[keep], own]), said])
    wanted = np.append(target[keep], np.zeros(3))
    found = np.linalg.lstsq(rows, wanted)[0]
    np.testing.assert_allclose(problem.left(own), target[keep] - rows[:-3] @ found, atol=1e-6)
    np.testing.assert_allclose(problem.beyond(own).coefficients, found[6:], rtol=1e-6)
    before, after = left(rows[:, :6], wanted), wanted - rows @ found
    assert problem.drop(own) == pytest.approx(before @ before - after @ after, rel=1e-6)
    plain = np.linalg.lstsq(rows[:, :6], wanted)[0]
    np.testing.assert_allclose(problem.residual, (wanted - rows[:, :6] @ plain)[:-3], atol=1e-6)
    np.testing.assert_allclose(problem.within_prior, baseline[keep, :3] @ plain[:3], atol=1e-6)


def test_a_fold_held_out_is_told_by_the_others(baseline):
    rng = np.random.default_rng(3)
    column = rng.standard_normal((4000, 1))
    target = baseline @ rng.standard_normal(6) + 0.4 * column[:, 0] + rng.standard_normal(4000)
    problem = JointProblem(baseline, target, FOLD, np.ones(4000, dtype=bool))
    both, held = np.hstack([baseline, column]), problem.held_out(column)
    for k in range(4):
        others, own = k != FOLD, k == FOLD
        found = np.linalg.lstsq(both[others], target[others])[0]
        # The baseline's parameters lean on the rows held out by next to nothing where the others tell them.
        np.testing.assert_allclose(held[own], target[own] - both[own] @ found, atol=0.02)
        assert problem.errors(column).held_out[k] == pytest.approx(held[own] @ held[own])


def test_what_the_baseline_absorbs_and_what_is_nought_explain_nothing(baseline):
    rng = np.random.default_rng(4)
    target = baseline @ rng.standard_normal(6) + rng.standard_normal(4000)
    problem = JointProblem(baseline, target, FOLD, np.ones(4000, dtype=bool))
    nothing = np.stack([baseline @ np.arange(6.0), np.zeros(4000)], axis=1)
    assert problem.drop(nothing) == 0.0
    assert problem.beyond(nothing).coefficients.tolist() == [0.0, 0.0]
    np.testing.assert_allclose(problem.errors(nothing).held_out, problem.errors().held_out, rtol=1e-6)
    useful = rng.standard_normal(4000)
    alone = problem.drop(useful[:, None])
    assert problem.drop(np.column_stack([nothing, useful])) == pytest.approx(alone, rel=1e-6)
