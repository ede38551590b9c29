"""Currents of joints with unknown gains that share one set of links: bilinear least squares on triangular factors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ident.arrays import FloatArray, IntArray
from ident.least_squares import triangle

WIDE = 1e4
"""Factor either way within which gains are searched where no bounds are given."""

NEGLIGIBLE = 1e-9
"""Share of the largest below which a column, or a singular value of unit columns, is rounding."""


@dataclass(frozen=True, eq=False)
class GainPrior:
    """What is known of the logarithms of the gains beforehand: ``mean`` (n,), ``std`` (n,), inf where nothing is."""

    mean: FloatArray
    std: FloatArray


@dataclass(frozen=True, eq=False)
class Bilinear:
    """The regression ``i_j = (S_j sigma) / k_j + noise`` with each joint's own columns projected away.

    Noise is in the currents alone, so this is the maximum-likelihood problem for Gaussian noise, where total least
    squares would put errors in the motion as well.

    Attributes:
        triangles: per joint the triangle of [shared columns, current], own columns projected away, (s + 1, s + 1).
        known: number of the shared column whose coefficient is one (the payload's); None where there is none, and
            the gains then have no common scale: their geometric mean is kept at one.
        weights: weight (n,) of each joint's rows: one over variance times correlation time.
    """

    triangles: list[FloatArray]
    known: int | None
    weights: FloatArray

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.triangles)

    @property
    def directions(self) -> FloatArray:
        """Orthonormal directions (n, d) in which the logarithms of the gains may move."""
        if self.known is not None:
            return np.eye(self.n)
        return np.linalg.svd(np.ones((1, self.n)))[2][1:].T

    @property
    def _unknown(self) -> IntArray:
        columns = np.arange(self.triangles[0].shape[1] - 1)
        return columns if self.known is None else np.delete(columns, self.known)

    def start(self) -> FloatArray:
        """Gains (n,) by total least squares with columns scaled to unit length (Gautier and Briot 2014).

        The null vector of ``[i_1 .. i_n, -S]`` holds the gains and the shared coefficients. Gains that come out
        negative, as unexcited ones may, are replaced by the geometric mean of the others.
        """
        rows = []
        for j, (upper, weight) in enumerate(zip(self.triangles, self.weights, strict=True)):
            currents = np.zeros((len(upper), self.n))
            currents[:, j] = upper[:, -1]
            rows.append(np.column_stack([currents, -upper[:, :-1]]) * np.sqrt(weight))
        matrix = np.vstack(rows)
        norms = lengths(matrix)
        used = np.isfinite(norms)
        null = np.zeros(len(norms))
        null[used] = np.linalg.svd(matrix[:, used] / norms[used])[2][-1] / norms[used]
        gains = null[: self.n]
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = np.sign(np.median(gains)) if self.known is None else 1.0 / null[self.n + self.known]
            gains = gains * unit
        good = np.isfinite(gains) & (gains > 0.0)
        gains = np.where(good, gains, np.exp(np.mean(np.log(gains[good]))) if good.any() else 1.0)
        return gains if self.known is not None else gains / np.exp(np.mean(np.log(gains)))

    def solve(self, start: FloatArray, prior: GainPrior | None, bounds: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Gains (n,) of maximum likelihood (with a prior: of maximum posterior) within bounds, by variable projection.

        The shared coefficients are eliminated; the gradient is Kaufman's (1975).
        """
        directions = self.directions
        if self.known is None:
            low, high = np.full(self.n - 1, -np.log(WIDE)), np.full(self.n - 1, np.log(WIDE))
        else:
            low, high = np.log(bounds[0]), np.log(bounds[1])
        inside = np.clip(directions.T @ np.log(start), low + 1e-9, high - 1e-9)
        found = least_squares(
            lambda z: self._residual(directions @ z, prior)[0],
            inside,
            jac=lambda z: self._residual(directions @ z, prior)[1] @ directions,
            bounds=(low, high),
            x_scale="jac",
            xtol=1e-10,
        )
        return np.asarray(np.exp(directions @ found.x))

    def shared(self, gains: FloatArray) -> FloatArray:
        """Coefficients (s,) of the shared columns at given gains; the shortest where not determined."""
        return self._eliminate(gains)[0]

    def _eliminate(self, gains: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shared coefficients (s,), residual (rows,) and an orthonormal basis of the shared columns."""
        unknown = self._unknown
        blocks, targets = [], []
        for upper, weight, gain in zip(self.triangles, self.weights, gains, strict=True):
            blocks.append(np.sqrt(weight) / gain * upper[:, unknown])
            known = 0.0 if self.known is None else upper[:, self.known] / gain
            targets.append(np.sqrt(weight) * (upper[:, -1] - known))
        matrix, target = np.vstack(blocks), np.concatenate(targets)
        norms = lengths(matrix)
        left, size, right = np.linalg.svd(matrix / norms, full_matrices=False)
        good = size > NEGLIGIBLE * size.max(initial=0.0)
        left, size, right = left[:, good], size[good], right[good]
        shared = np.ones(self.triangles[0].shape[1] - 1)
        shared[unknown] = (right.T @ ((left.T @ target) / size)) / norms
        return shared, target - left @ (left.T @ target), left

    def _residual(self, logarithms: FloatArray, prior: GainPrior | None) -> tuple[FloatArray, FloatArray]:
        """Residual and its Jacobian by the logarithms of the gains; a prior adds rows."""
        gains = np.exp(logarithms)
        shared, residual, basis = self._eliminate(gains)
        jacobian = np.zeros((len(residual), self.n))
        first = 0
        for j, (upper, weight) in enumerate(zip(self.triangles, self.weights, strict=True)):
            rows = slice(first, first + len(upper))
            jacobian[rows, j] = np.sqrt(weight) / gains[j] * (upper[:, :-1] @ shared)
            first = rows.stop
        jacobian -= basis @ (basis.T @ jacobian)
        if prior is not None:
            known = np.isfinite(prior.std)
            residual = np.append(residual, ((logarithms - prior.mean) / prior.std)[known])
            jacobian = np.vstack([jacobian, np.diag(1.0 / prior.std)[known]])
        return residual, jacobian


def without_own(upper: FloatArray, shared: int) -> FloatArray:
    """Triangle (s + 1, s + 1) of [shared, current] once a joint's own columns are projected away.

    Args:
        upper: triangle of [shared, own, current].
        shared: number of shared columns.
    """
    own = upper[:, shared:-1]
    left, size, _ = np.linalg.svd(own / lengths(own), full_matrices=False)
    basis = left[:, size > NEGLIGIBLE * size.max(initial=0.0)]
    rest = np.column_stack([upper[:, :shared], upper[:, -1]])
    return triangle(rest - basis @ (basis.T @ rest))


def least(matrix: FloatArray, target: FloatArray) -> FloatArray:
    """Least squares on columns of unit length, the shortest answer where not determined."""
    norms = lengths(matrix)
    solved: FloatArray = np.linalg.lstsq(matrix / norms, target, rcond=NEGLIGIBLE)[0] / norms
    return solved


def lengths(matrix: FloatArray) -> FloatArray:
    """Lengths of a matrix's columns; inf where a column is rounding beside the longest."""
    norms = np.linalg.norm(matrix, axis=0)
    return np.where(norms > NEGLIGIBLE * norms.max(initial=0.0), norms, np.inf)
