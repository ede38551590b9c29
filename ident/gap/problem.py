"""One joint's rows as a regression to which columns of candidate effects can be added cheaply."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.gap.fold_sums import FoldSums, Further, products, products_of

Float32Array = npt.NDArray[np.float32]

SAME = 1e-9
"""Share of a column's square added to it, so that candidates' columns that say the same do no harm."""

LEAST = 1e-11
"""Least eigenvalue of the normal equations, as a share of the largest, that is no rounding."""

OWN = 1e-6
"""Share of a column's size that the baseline must leave, for the rest is rounding."""

NONE = np.zeros(0)

NOTHING = 1e-6
"""Share of a column's size in all rows below which what the rows that count have of it is rounding."""


def sizes(columns: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Lengths (k,) of columns (N, k)."""
    lengths: npt.NDArray[Any] = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    return lengths


def costs(prior: FloatArray, size: FloatArray) -> FloatArray:
    """What the square of each coefficient (p,) costs of columns divided by sizes (p,): of the first k, before that."""
    found = np.zeros(len(size))
    found[: len(prior)] = prior / size[: len(prior)] ** 2
    return found


def gain(before: float, after: float) -> float:
    """Share by which an RMS residual falls when its sum of squares does."""
    return float(1.0 - np.sqrt(after / max(before, 1e-300)))


@dataclass(frozen=True, eq=False)
class Errors:
    """Sums of squared residuals (folds,) of rows held out of the fit."""

    held_out: FloatArray

    @property
    def total(self) -> float:
        """Sum over the held-out folds."""
        return float(self.held_out.sum())


@dataclass(frozen=True, eq=False)
class Beyond:
    """Columns (N, k) of length one, without what the baseline absorbs of them: normal equations of what is left.

    Attributes:
        gram: products (k, k) with one another.
        product: products (k,) with the baseline's residual.
        size: lengths (k,) that the columns had; one of those that are nought.
    """

    gram: FloatArray
    product: FloatArray
    size: FloatArray

    @cached_property
    def _length(self) -> FloatArray:
        """What is left (k,) of each column's length; infinite where that is rounding."""
        square = np.diag(self.gram)
        return np.sqrt(np.where(square > OWN**2, square, np.inf))

    @property
    def coefficients(self) -> FloatArray:
        """The columns' coefficients (k,), fitted with the baseline's."""
        return self._scaled / (self._length * self.size)

    @property
    def drop(self) -> float:
        """Fall of the squared residual by all of them."""
        return float(self.product @ (self._scaled / self._length))

    def alone(self) -> tuple[FloatArray, FloatArray]:
        """Fall (k,) of the squared residual by each of them alone, and its coefficient (k,)."""
        along = self.product / self._length
        return along**2, along / (self._length * self.size)

    def among(self, used: BoolArray) -> Beyond:
        """The same of some of the columns (k,)."""
        return self if used.all() else Beyond(self.gram[np.ix_(used, used)], self.product[used], self.size[used])

    def admissible(self, lower: FloatArray) -> BoolArray:
        """Which (k,) of the columns have coefficients that keep to their lower bounds (k,), fitted without the rest."""
        used = np.ones(len(lower), dtype=bool)
        while (used & np.isfinite(lower)).any():
            found = np.zeros(len(used))
            found[used] = self.among(used).coefficients
            wrong = used & (found < lower)
            if not wrong.any():
                break
            used[int(np.argmin(np.where(wrong, found * self.size, np.inf)))] = False
        return used

    @property
    def _scaled(self) -> FloatArray:
        """Solution (k,) with every column's rest scaled to length one."""
        gram = self.gram / np.outer(self._length, self._length)
        np.fill_diagonal(gram, 1.0 + SAME)
        return np.asarray(np.linalg.solve(gram, self.product / self._length))


class JointProblem:
    """One joint's rows: a target and the columns that are fitted whatever else is tried.

    Args:
        matrix: columns (N, p) of the baseline; p may be nought.
        target: what they are fitted to, (N,).
        fold: number of each row's fold (N,).
        keep: rows that count, (N,).
        prior: what the square of each of the first coefficients costs, in squares of the target (k,); others are free.
    """

    def __init__(
        self, matrix: FloatArray, target: FloatArray, fold: IntArray, keep: BoolArray, prior: FloatArray = NONE
    ) -> None:
        self.keep, self._left_out = np.flatnonzero(keep), np.flatnonzero(~keep)
        size, whole = sizes(matrix[self.keep]), sizes(matrix)
        # Where a joint moves alone, others' columns are rounding: what that is fitted to is no force elsewhere.
        self.norm = np.where(size > NOTHING * whole, size, np.where(whole > 0, whole, 1.0))
        self.matrix = matrix[self.keep] / self.norm
        self._cost, self.prior = prior, costs(prior, self.norm)
        self.target = target[self.keep]
        self.fold = fold[self.keep]
        # A fold none of whose rows counts is one still: all joints have as many.
        self.labels = np.unique(fold)
        self.folds = [np.flatnonzero(self.fold == k) for k in self.labels]
        self._parts, self._targets = self._split(self.matrix), self._split(self.target[:, None])
        own, target, square = (
            products_of(x, y)
            for x, y in ((self._parts, self._parts), (self._parts, self._targets), (self._targets, self._targets))
        )
        self._sums = FoldSums(own, target[:, :, 0], square[:, 0, 0], self.prior)

    def __len__(self) -> int:
        return len(self.target)

    def among(self, rows: BoolArray) -> JointProblem:
        """The same with some (M,) of the rows that count."""
        return JointProblem(self.matrix * self.norm, self.target, self.fold, rows, self._cost)

    def of(self, columns: FloatArray) -> FloatArray:
        """The rows that count of columns (M, k) in all rows."""
        return columns.take(self.keep, axis=0) if len(self._left_out) > 0 else columns

    def left_out_of(self, columns: FloatArray) -> FloatArray:
        """The rows that do not count of columns (M, k) in all rows."""
        return columns.take(self._left_out, axis=0)

    @cached_property
    def basis(self) -> FloatArray:
        """Basis B of the baseline's columns by which they absorb BB'y of y: orthonormal where coefficients are free."""
        if self.matrix.shape[1] == 0:
            return np.zeros((len(self.target), 0))
        values, vectors = np.linalg.eigh(products(self.matrix, self.matrix) + np.diag(self.prior))
        good = values > LEAST * max(values[-1], 1e-300)
        scaled = vectors[:, good] / np.sqrt(values[good])
        first = self.matrix @ scaled
        # Once more, for the digits that the first pass lost; a QR of all rows takes nine times as long.
        lower = np.linalg.cholesky(products(first, first) + products(scaled, self.prior[:, None] * scaled))
        return np.asarray(first @ np.linalg.inv(lower).T, dtype=np.float64)

    @cached_property
    def coarse_basis(self) -> Float32Array:
        """The basis in single precision, enough to screen candidates."""
        return self.basis.astype(np.float32)

    @cached_property
    def residual(self) -> FloatArray:
        """What the baseline leaves of the target."""
        return self.away(self.target[:, None])[:, 0]

    @cached_property
    def within_prior(self) -> FloatArray:
        """What (N,) columns take up of the target whose coefficients cost something."""
        known = self.prior > 0.0
        found: FloatArray = self.matrix[:, known] @ (self.fit() * self.norm)[known]
        return found

    def away(self, columns: FloatArray) -> FloatArray:
        """Part of columns (N, k) that the baseline's cannot absorb."""
        left: FloatArray = columns - self.basis @ products(self.basis, columns)
        return left

    def beyond(self, columns: FloatArray) -> Beyond:
        """What columns (N, k) say that the baseline's do not."""
        gram = products(columns, columns)
        size = np.sqrt(np.where(np.diag(gram) > 0.0, np.diag(gram), 1.0))
        absorbed = products(self.basis, columns) / size
        left = gram / np.outer(size, size) - products(absorbed, absorbed)
        return Beyond(left, products(columns, self.residual) / size, size)

    def drop(self, columns: FloatArray) -> float:
        """Fall of the squared residual when columns (N, k) are fitted besides the baseline."""
        return self.beyond(columns).drop

    def fit(self, columns: FloatArray | None = None) -> FloatArray:
        """Coefficients (p + k,) of the baseline's columns and of columns (N, k), fitted to all rows."""
        unit, size = self._unit(columns)
        further = self.further(unit)
        found = further.fitted()
        return np.concatenate([further.own(found) / self.norm, found / size])

    def drops(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fall (k,) of the squared residual with each of columns (N, k) fitted alone, and its coefficient (k,)."""
        return self.beyond(columns).alone()

    def left(self, columns: FloatArray) -> FloatArray:
        """Residual (N,) with columns (N, k) fitted besides the baseline, all rows together."""
        left: FloatArray = self.target - np.column_stack([self.matrix * self.norm, columns]) @ self.fit(columns)
        return left

    def errors(self, columns: FloatArray | None = None) -> Errors:
        """Squared residuals with columns (N, k) fitted besides the baseline, each fold predicted from the others."""
        further = self.further(self._unit(columns)[0])
        return Errors(np.array([further.held_out(k, further.fitted(k)) for k in range(len(self.folds))]))

    def held_out(self, columns: FloatArray) -> FloatArray:
        """Residuals (N,) of each fold's rows, predicted from the others with columns (N, k) besides the baseline."""
        unit, _ = self._unit(columns)
        further, left = self.further(unit), self.target.copy()
        for k, rows in enumerate(self.folds):
            found = further.fitted(k)
            left[rows] -= self._parts[k] @ further.own(found, k) + unit[rows] @ found
        return left

    def further(self, columns: FloatArray) -> Further:
        """Columns (N, k) beside the baseline's, fold by fold."""
        parts = self._split(columns)
        across, inside = products_of(self._parts, parts), products_of(parts, parts)
        return Further(self._sums, across, inside, products_of(parts, self._targets)[:, :, 0])

    def _unit(self, columns: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Columns (N, k), by default none, of length one, and what their lengths were (k,); those of none are kept."""
        if columns is None:
            return np.zeros((len(self), 0)), np.zeros(0)
        size = sizes(columns)
        size = np.where(size > 0, size, 1.0)
        return columns / size, size

    def _split(self, columns: FloatArray) -> list[FloatArray]:
        """Each fold's rows of columns (N, k)."""
        return [columns[f] for f in self.folds]
