"""One joint's rows as a regression to which columns of candidate effects can be added cheaply."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ident.arrays import BoolArray, FloatArray, IntArray

Float32Array = npt.NDArray[np.float32]

RIDGE = 1e-10
"""Share of a column's square added to the normal matrix, so that columns that say the same do no harm."""

LEAST = 1e-11
"""Least eigenvalue of the normal equations, as a share of the largest, that is no rounding."""

OWN = 1e-7
"""Share of a column's size that the baseline must leave, for the rest is rounding."""

NOTHING = 1e-6
"""Share of a column's size in all rows below which what the rows that count have of it is rounding."""

LEANING = 0.05
"""Weight with which rows held out tell the baseline's own parameters. One that the other rows hardly tell, as of links
in poses that no other log has, would else make errors of any size, with an effect as without."""


def sizes(columns: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Lengths (k,) of columns (N, k)."""
    lengths: npt.NDArray[Any] = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    return lengths


def gain(before: float, after: float) -> float:
    """Share by which an RMS residual falls when its sum of squares does."""
    return float(1.0 - np.sqrt(after / max(before, 1e-300)))


@dataclass(frozen=True, eq=False)
class Errors:
    """Sums of squared residuals: with all rows fitted, and (folds,) of rows held out of the fit."""

    fitted: float
    held_out: FloatArray

    @property
    def total(self) -> float:
        """Sum over the held-out folds."""
        return float(self.held_out.sum())


@dataclass(frozen=True, eq=False)
class Sums:
    """Products over each fold's rows, leading axis folds: of the baseline's columns X, further ones Z, the target y."""

    own: FloatArray
    own_target: FloatArray
    squares: FloatArray
    across: FloatArray
    inside: FloatArray
    target: FloatArray

    def reduced(self, without: int | None) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and right side for Z with X eliminated, from all folds but one."""
        own, own_target, across, inside, target = (
            x.sum(axis=0) - (0.0 if without is None else x[without])
            for x in (self.own, self.own_target, self.across, self.inside, self.target)
        )
        own_of = _solved(own, np.column_stack([across, own_target]))
        return inside - across.T @ own_of[:, :-1], target - across.T @ own_of[:, -1]

    def held_out(self, fold: int, coefficients: FloatArray) -> float:
        """Squared residual of a fold with Z's coefficients given, X's fitted to the others and leaning on its own."""
        own, own_target, across = (
            x.sum(axis=0) - (1.0 - LEANING) * x[fold] for x in (self.own, self.own_target, self.across)
        )
        mine = _solved(own, own_target - across @ coefficients)
        square = self.squares[fold] - 2.0 * (mine @ self.own_target[fold] + coefficients @ self.target[fold])
        square += mine @ self.own[fold] @ mine + coefficients @ self.inside[fold] @ coefficients
        return float(max(square + 2.0 * mine @ self.across[fold] @ coefficients, 0.0))


class JointProblem:
    """One joint's rows: a target and the columns that are fitted whatever else is tried.

    Args:
        matrix: columns (N, p) of the baseline; p may be nought.
        target: what they are fitted to, (N,).
        fold: number of each row's fold (N,).
        keep: rows that count, (N,).
    """

    def __init__(self, matrix: FloatArray, target: FloatArray, fold: IntArray, keep: BoolArray) -> None:
        self.keep = np.flatnonzero(keep)
        self._all = len(keep)
        size, whole = sizes(matrix[self.keep]), sizes(matrix)
        # Where a joint moves alone, others' columns are rounding: what that is fitted to is no force elsewhere.
        self.norm = np.where(size > NOTHING * whole, size, np.where(whole > 0, whole, 1.0))
        self.matrix = matrix[self.keep] / self.norm
        self.target = target[self.keep]
        self.fold = fold[self.keep]
        # A fold none of whose rows counts is one still: all joints have as many.
        self.labels = np.unique(fold)
        self.folds = [np.flatnonzero(self.fold == k) for k in self.labels]
        self._own = self._products(self.matrix, self.matrix)
        self._own_target = self._products(self.matrix, self.target[:, None])
        self._squares = np.array([self.target[f] @ self.target[f] for f in self.folds])
        self._normal, self._right = self._own.sum(axis=0), self._own_target.sum(axis=0)[:, 0]

    def __len__(self) -> int:
        return len(self.target)

    def of(self, columns: FloatArray) -> FloatArray:
        """The rows that count of columns (M, k) in all rows."""
        return columns if len(self) == self._all else columns.take(self.keep, axis=0)

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal basis of the baseline's columns."""
        if self.matrix.shape[1] == 0:
            return np.zeros((len(self.target), 0))
        values, vectors = np.linalg.eigh(self.matrix.T @ self.matrix)
        good = values > LEAST * max(values[-1], 1e-300)
        first = self.matrix @ (vectors[:, good] / np.sqrt(values[good]))
        # Once more, for the digits that the first pass lost; a QR of all rows takes nine times as long.
        lower = np.linalg.cholesky(first.T @ first)
        return np.asarray(first @ np.linalg.inv(lower).T, dtype=np.float64)

    @cached_property
    def coarse_basis(self) -> Float32Array:
        """The basis in single precision, enough to screen candidates."""
        return self.basis.astype(np.float32)

    @cached_property
    def residual(self) -> FloatArray:
        """What the baseline leaves of the target."""
        return self.away(self.target[:, None])[:, 0]

    def away(self, columns: FloatArray) -> FloatArray:
        """Part of columns (N, k) that the baseline's cannot absorb."""
        left: FloatArray = columns - self.basis @ (self.basis.T @ columns)
        return left

    def admissible(self, columns: FloatArray, lower: FloatArray) -> BoolArray:
        """Which (k,) of columns (N, k) have coefficients that keep to their lower bounds (k,)."""
        used = np.ones(columns.shape[1], dtype=bool)
        while (used & np.isfinite(lower)).any():
            found = np.zeros(len(used))
            found[used] = self.fit(columns[:, used])[self.matrix.shape[1] :]
            wrong = used & (found < lower)
            if not wrong.any():
                break
            used[int(np.argmin(np.where(wrong, found * sizes(columns), np.inf)))] = False
        return used

    def drop(self, columns: FloatArray) -> float:
        """Fall of the squared residual when columns (N, k) are fitted besides the baseline."""
        own = self.away(columns)
        size = sizes(own)
        used = size > OWN * np.maximum(sizes(columns), 1e-300)
        if not used.any():
            return 0.0
        own = own[:, used] / size[used]
        product = own.T @ self.residual
        gram = own.T @ own + 1e-9 * np.eye(own.shape[1])
        return float(product @ np.linalg.solve(gram, product))

    def fit(self, columns: FloatArray | None = None) -> FloatArray:
        """Coefficients (p + k,) of the baseline's columns and of columns (N, k), fitted to all rows."""
        extra = np.zeros((len(self), 0)) if columns is None else columns
        size = sizes(extra)
        size = np.where(size > 0, size, 1.0)
        scaled = extra / size
        across = self.matrix.T @ scaled
        gram = np.block([[self._normal, across], [across.T, scaled.T @ scaled]])
        right = np.concatenate([self._right, scaled.T @ self.target])
        return np.asarray(_solved(gram, right) / np.concatenate([self.norm, size]))

    def drops(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fall (k,) of the squared residual with each of columns (N, k) fitted alone, and its coefficient (k,)."""
        own = self.away(columns)
        square = np.maximum(sizes(own), OWN * np.maximum(sizes(columns), 1e-140)) ** 2
        coefficients = self.residual @ own / square
        return coefficients**2 * square, coefficients

    def left(self, columns: FloatArray) -> FloatArray:
        """Residual (N,) with columns (N, k) fitted besides the baseline, all rows together."""
        left: FloatArray = self.target - np.column_stack([self.matrix * self.norm, columns]) @ self.fit(columns)
        return left

    def errors(self, columns: FloatArray | None = None) -> Errors:
        """Squared residuals with columns (N, k) fitted besides the baseline, each fold predicted from the others."""
        if columns is None or columns.shape[1] == 0:
            gram, product = self._own, self._own_target[:, :, 0]
        else:
            size = sizes(columns)
            extra = columns / np.where(size > 0, size, 1.0)
            across = self._products(self.matrix, extra)
            inside = self._products(extra, extra)
            gram = np.concatenate(
                [np.concatenate([self._own, across], 2), np.concatenate([across.transpose(0, 2, 1), inside], 2)], 1
            )
            product = np.concatenate([self._own_target, self._products(extra, self.target[:, None])], 1)[:, :, 0]
        whole, target = gram.sum(axis=0), product.sum(axis=0)
        held = [
            self._squared(gram[k], product[k], self._squares[k], self._others(whole, target, gram[k], product[k]))
            for k in range(len(self.folds))
        ]
        fitted = self._squared(whole, target, self._squares.sum(), _solved(whole, target))
        return Errors(fitted, np.array(held))

    def held_out(self, columns: FloatArray) -> FloatArray:
        """Residuals (N,) of each fold's rows, predicted from the others with columns (N, k) besides the baseline."""
        size = sizes(columns)
        both = np.column_stack([self.matrix, columns / np.where(size > 0, size, 1.0)])
        left = self.target.copy()
        if both.shape[1] == 0:
            return left
        whole, product = both.T @ both, both.T @ self.target
        for rows in self.folds:
            part = both[rows]
            left[rows] -= part @ self._others(whole, product, part.T @ part, part.T @ self.target[rows])
        return left

    def sums(self, columns: FloatArray) -> Sums:
        """Products of columns (M, k) with the baseline's and the target, fold by fold."""
        return Sums(
            self._own,
            self._own_target[:, :, 0],
            self._squares,
            self._products(self.matrix, columns),
            self._products(columns, columns),
            self._products(columns, self.target[:, None])[:, :, 0],
        )

    def _others(self, whole: FloatArray, target: FloatArray, own: FloatArray, own_target: FloatArray) -> FloatArray:
        """Coefficients (p + k,) fitted to all rows but a fold's, of which ``own`` are the products.

        Of the baseline's alone they lean on the fold's rows, too.
        """
        found, p = _solved(whole - own, target - own_target), self.matrix.shape[1]
        lean, right = whole[:p] - (1.0 - LEANING) * own[:p], target[:p] - (1.0 - LEANING) * own_target[:p]
        found[:p] = _solved(lean[:, :p], right - lean[:, p:] @ found[p:])
        return found

    @staticmethod
    def _squared(gram: FloatArray, product: FloatArray, square: float, found: FloatArray) -> float:
        return max(float(square - 2.0 * found @ product + found @ gram @ found), 0.0)

    def _products(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Products (folds, p, q) of columns, fold by fold."""
        return np.stack([left[f].T @ right[f] for f in self.folds])


def _solved(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Solution (p,) or (p, k) of normal equations in which columns may say the same."""
    if len(right) == 0:
        return np.zeros(right.shape)
    ridge = RIDGE * np.diag(np.diag(normal) + 1e-300)
    return np.asarray(np.linalg.lstsq(normal + ridge, right, rcond=1e-12)[0])
