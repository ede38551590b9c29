"""Linear least squares on triangular factors: any number of rows, bounds, and what is not determined."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dgeqrf
from scipy.optimize import lsq_linear

from ident.arrays import BoolArray, FloatArray
from ident.base_parameters import ROUNDING
from ident.design import Design, Rows


@dataclass(frozen=True, eq=False)
class Factors:
    """Triangular factors of the regression, one a joint: all that least squares needs of any number of rows.

    Attributes:
        triangles: per joint the upper triangle R of [matrix, target], (p + 1, p + 1).
        rows: rows gone in.
        counted: of them, those that count for each joint, (n,).
    """

    triangles: list[FloatArray]
    rows: int
    counted: FloatArray

    def residual_variance(self, design: Design, parameters: FloatArray) -> FloatArray:
        """Return the mean squared residual (n,) of each joint at given parameters."""
        squares = [
            np.sum((upper @ np.append(parameters[design.columns_of_joint(j)], -1.0)) ** 2)
            for j, upper in enumerate(self.triangles)
        ]
        return np.asarray(np.array(squares) / np.maximum(self.counted, 1.0))


def factorise(design: Design, rows: Iterable[Rows], weigh: Callable[[Rows], FloatArray] | None = None) -> Factors:
    """Reduce regression rows to triangular factors, block by block (sequential QR).

    Args:
        design: the columns.
        rows: regression rows.
        weigh: gives the weights (N, n) of rows; equal where not given.
    """
    n = design.robot.n
    triangles = [np.zeros((0, len(design.columns_of_joint(j)) + 1)) for j in range(n)]
    count, counted = 0, np.zeros(n)
    for block in rows:
        w = None if weigh is None else weigh(block)
        for j in range(n):
            stacked = np.column_stack([block.matrices[j], block.target[:, j]])
            if w is not None:
                stacked *= np.sqrt(w[:, j])[:, None]
            triangles[j] = triangle(np.vstack([triangles[j], stacked]))
        count += len(block.target)
        counted += block.counted
    return Factors([_padded(t) for t in triangles], count, counted)


@dataclass(frozen=True, eq=False)
class Solution:
    """A least-squares estimate.

    Attributes:
        parameters: estimates (p,); nought where not determined.
        determined: which parameters the data determine, (p,).
        bread: inverse of the normal matrix of the weighted rows, (p, p), nought where not determined.
        weights: weight of each joint's rows, (n,): one over the residual variance.
        condition_number: of the determined columns, each scaled to unit length.
        variance: mean squared residual of each joint, (n,), corrected for the number of parameters.
    """

    parameters: FloatArray
    determined: BoolArray
    bread: FloatArray
    weights: FloatArray
    condition_number: float
    variance: FloatArray


def solve(design: Design, factors: Factors, weights: FloatArray | None = None) -> Solution:
    """Estimate the linear parameters, weighting joints by their residual variance and keeping to lower bounds.

    Args:
        design: the columns.
        factors: their triangular factors.
        weights: of the joints, (n,); found from the residuals, and renewed twice, where not given.
    """
    lower = np.array([coefficient.lower for _, coefficient in design.coefficients()])
    reweight = 2 if weights is None else 0
    weights = np.ones(design.robot.n) if weights is None else weights
    parameters = np.zeros(design.count)
    # A joint whose current is constant must not get an infinite weight.
    floor = 1e-12 * max(np.max(factors.residual_variance(design, parameters)), 1e-300)
    # Weights must not make information of a rounding in the rows of a joint whose noise is small.
    told = independent(design, factors)
    for _ in range(reweight + 1):
        matrix, target = _stack(design, factors, weights)
        determined = told.copy()
        determined[told] = _independent(matrix[:, told])
        parameters = np.zeros(design.count)
        parameters[determined] = _bounded(matrix[:, determined], target, lower[determined])
        variance = np.maximum(factors.residual_variance(design, parameters), floor)
        variance *= factors.counted / np.maximum(factors.counted - determined.sum() / design.robot.n, 1.0)
        weights = 1.0 / variance if reweight else weights
    bread, condition = normal_inverse(design, factors, weights, determined)
    return Solution(parameters, determined, bread, weights, condition, variance)


def normal_inverse(
    design: Design, factors: Factors, weights: FloatArray, determined: BoolArray
) -> tuple[FloatArray, float]:
    """Inverse normal matrix (p, p), nought where not determined, and the condition number of the scaled columns."""
    matrix, _ = _stack(design, factors, weights)
    scale = np.linalg.norm(matrix[:, determined], axis=0)
    upper = triangle(matrix[:, determined] / scale)
    inverse = solve_triangular(upper, np.eye(len(upper))) / scale[:, None]
    bread = np.zeros((design.count, design.count))
    bread[np.ix_(determined, determined)] = inverse @ inverse.T
    condition = float(np.linalg.cond(upper)) if len(upper) else 1.0
    return bread, condition


def triangle(matrix: FloatArray) -> FloatArray:
    """Return the upper triangle R of a matrix's QR factorisation."""
    # NumPy's takes twice as long, and keeps Python's lock meanwhile.
    factored = dgeqrf(matrix)[0] if len(matrix) > 0 else matrix
    upper: FloatArray = np.triu(factored[: matrix.shape[1]])
    return upper


def independent(design: Design, factors: Factors) -> BoolArray:
    """Columns (p,) that are no combination of the columns before them."""
    return _independent(_stack(design, factors, np.ones(design.robot.n))[0])


def _stack(design: Design, factors: Factors, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All joints' factors as one small regression in all parameters."""
    blocks, targets = [], []
    for j, upper in enumerate(factors.triangles):
        block = np.zeros((len(upper), design.count))
        block[:, design.columns_of_joint(j)] = upper[:, :-1]
        blocks.append(block * np.sqrt(weights[j]))
        targets.append(upper[:, -1] * np.sqrt(weights[j]))
    return np.vstack(blocks), np.concatenate(targets)


def _independent(matrix: FloatArray) -> BoolArray:
    """Columns that are no combination of those before them, but for the rounding of a URDF's angles."""
    norms = np.linalg.norm(matrix, axis=0)
    largest = norms.max(initial=0.0)
    scaled = matrix / np.where(norms > 1e-12 * largest, norms, np.inf)
    independent = np.zeros(len(norms), dtype=bool)
    basis = np.zeros((len(matrix), 0))
    for k in range(len(norms)):
        # Twice: one Gram-Schmidt pass leaves rounding of the order of the threshold.
        rest = scaled[:, k] - basis @ (basis.T @ scaled[:, k])
        rest -= basis @ (basis.T @ rest)
        length = np.linalg.norm(rest)
        if length > ROUNDING:
            independent[k] = True
            basis = np.column_stack([basis, rest / length])
    return independent


def _bounded(matrix: FloatArray, target: FloatArray, lower: FloatArray) -> FloatArray:
    scale = np.linalg.norm(matrix, axis=0)
    free: FloatArray = np.linalg.lstsq(matrix / scale, target)[0]
    if not np.all(free >= lower * scale):
        free = lsq_linear(matrix / scale, target, bounds=(lower * scale, np.inf), method="bvls").x
    scaled: FloatArray = free / scale
    return scaled


def _padded(upper: FloatArray) -> FloatArray:
    """Fewer rows than columns would leave the triangle short."""
    missing = upper.shape[1] - len(upper)
    return np.vstack([upper, np.zeros((missing, upper.shape[1]))]) if missing > 0 else upper
