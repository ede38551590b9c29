"""Products of a joint's columns over each fold's rows: all that fits to the other folds need, without their rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import FloatArray

RIDGE = 1e-10
"""Share of a column's square added to the normal matrix, so that columns that say the same do no harm."""

ROUNDING = 1e-12
"""Least eigenvalue of a normal matrix, as a share of the largest, that is solved for."""

NOUGHT = 1e-300
"""Where no eigenvalue is larger there is nothing to solve for: the solution is nought."""

LEANING = 0.05
"""Weight with which rows held out tell the baseline's own parameters. One that the other rows hardly tell, as of links
in poses that no other log has, would else make errors of any size, with an effect as without."""


def products(left: FloatArray, right: FloatArray) -> FloatArray:
    """Products (p, q) of columns (N, p) with others (N, q), or with one of them (N,).

    Where its result is small, ``@`` keeps Python's lock all the while that it goes through long columns; ``dot`` lets
    other threads go on.
    """
    found: FloatArray = np.dot(left.T, right)
    return found


def products_of(left: Sequence[FloatArray], right: Sequence[FloatArray]) -> FloatArray:
    """Products (folds, p, q) of columns whose folds' rows are given apart."""
    return np.stack([products(a, b) for a, b in zip(left, right, strict=True)])


def whole(parts: FloatArray, without: int | None = None, leaning: float = 0.0) -> FloatArray:
    """Sum of parts (folds, ...), of one fold's only as much as it leans on it."""
    total: FloatArray = parts.sum(axis=0)
    return total if without is None else total - (1.0 - leaning) * parts[without]


class Normal:
    """Normal equations (p, p) in which columns may say the same, to be solved for many right sides."""

    def __init__(self, matrix: FloatArray) -> None:
        values, vectors = np.linalg.eigh(matrix + RIDGE * np.diag(np.diag(matrix)))
        good = values > max(ROUNDING * values.max(initial=0.0), NOUGHT)
        self._inverse, self._vectors = 1.0 / values[good], vectors[:, good]

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution (p,) or (p, k)."""
        found: FloatArray = self._vectors @ ((right.T @ self._vectors) * self._inverse).T
        return found


@dataclass(frozen=True, eq=False)
class FoldSums:
    """A problem's own columns X (N, p) and what they are fitted to, y (N,), as products over each fold's rows.

    Attributes:
        own: X'X (folds, p, p).
        target: X'y (folds, p).
        squares: y'y (folds,).
        prior: what the square of each of their coefficients costs (p,), whichever folds they are fitted to.
    """

    own: FloatArray
    target: FloatArray
    squares: FloatArray
    prior: FloatArray

    @cached_property
    def _normals(self) -> dict[tuple[int | None, float], Normal]:
        return {}

    def normal(self, without: int | None = None, leaning: float = 0.0) -> Normal:
        """Normal equations from all folds but one; decomposed once, whatever is tried beside them."""
        key = without, leaning
        if key not in self._normals:
            self._normals[key] = Normal(whole(self.own, without, leaning) + np.diag(self.prior))
        return self._normals[key]


@dataclass(frozen=True, eq=False)
class Further:
    """Further columns Z (N, k) beside a problem's own, as products over each fold's rows.

    Attributes:
        sums: the problem's own.
        across: X'Z (folds, p, k).
        inside: Z'Z (folds, k, k).
        target: Z'y (folds, k).
    """

    sums: FoldSums
    across: FloatArray
    inside: FloatArray
    target: FloatArray

    def reduced(self, without: int | None = None) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and right side for Z with X eliminated, from all folds but one."""
        across, inside, target = (whole(x, without) for x in (self.across, self.inside, self.target))
        right = whole(self.sums.target, without)
        absorbed = self.sums.normal(without).solve(np.column_stack([across, right]))
        ridge = RIDGE * np.diag(np.diag(inside))
        return inside + ridge - across.T @ absorbed[:, :-1], target - across.T @ absorbed[:, -1]

    def fitted(self, without: int | None = None) -> FloatArray:
        """Z's coefficients (k,), fitted with X's to all folds but one."""
        normal, right = self.reduced(without)
        return Normal(normal).solve(right)

    def own(self, coefficients: FloatArray, without: int | None = None) -> FloatArray:
        """X's coefficients (p,) beside Z's, fitted to all folds; to one of them, held out, they only lean."""
        right = whole(self.sums.target - self.across @ coefficients, without, LEANING)
        return self.sums.normal(without, LEANING).solve(right)

    def held_out(self, fold: int, coefficients: FloatArray) -> float:
        """Squared residual of a fold held out, with Z's coefficients given."""
        mine, sums = self.own(coefficients, fold), self.sums
        square = sums.squares[fold] - 2.0 * (mine @ sums.target[fold] + coefficients @ self.target[fold])
        square += mine @ sums.own[fold] @ mine + coefficients @ self.inside[fold] @ coefficients
        return float(max(square + 2.0 * mine @ self.across[fold] @ coefficients, 0.0))
