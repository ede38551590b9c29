"""Standard deviations of the parameters when the residual is autocorrelated, as a robot's residual always is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.design import Design
from ident.effects.base import Coefficient, Context, Effect, Term
from ident.least_squares import Solution, factorise, independent, normal_inverse
from ident.walk import Block

if TYPE_CHECKING:
    from ident.robot import Robot

ROUNDING = 1e-12
"""Least variance in a direction, over the largest, that is no rounding."""

LAGS = 1024
"""Longest lag of the residual's autocovariance; the window that tapers it is chosen from the data, up to this."""


def covariance(terms: tuple[Term, ...], design: Design, solution: Solution, blocks: Sequence[Block]) -> FloatArray:
    """Covariance of the linear parameters and, after them, of the shape parameters, from blocks held in memory.

    Shape parameters enter through the tangent of the model at the estimate. With residual autocovariance ``gamma_k``
    (tapered by a Parzen window whose width follows the data, Andrews 1991) the covariance is
    ``B (sum_k gamma_k sum_t a_t a_{t+k}') B`` with ``B`` the inverse normal matrix. The middle is summed over
    frequencies (Parseval), block by block. Joints are taken as independent of each other.

    Args:
        terms: the design's terms with their estimated coefficients.
        design: the columns.
        solution: the estimate.
        blocks: rows; a sample of them will do, the caller scales the result to all rows.

    Returns:
        Covariance (p + s, p + s); nought where a parameter is not determined.
    """
    tangents = [Term(Tangent(t.effect.joint, t)) for t in terms if t.effect.shapes]
    full = replace(design, terms=(*design.terms, *tangents))
    # Where the design's parameters, then the shapes, stand among the full design's.
    place = np.zeros(design.count, dtype=np.int64)
    for k in range(len(design.terms)):
        place[design.columns_of_term(k)] = full.columns_of_term(k)
    shapes = [full.columns_of_term(len(design.terms) + k) for k in range(len(tangents))]
    parameters = np.zeros(full.count)
    parameters[place] = solution.parameters
    determined = np.ones(full.count, dtype=bool)
    determined[place] = solution.determined

    rows = [r for r in full.rows(blocks) if len(r.target) > 1]
    factors = factorise(full, rows)
    determined &= independent(full, factors)
    bread, _ = normal_inverse(full, factors, solution.weights, determined)
    meat = np.zeros_like(bread)
    for j in range(design.robot.n):
        columns = full.columns_of_joint(j)
        residuals = [r.target[:, j] - r.matrices[j] @ parameters[columns] for r in rows]
        gamma = autocovariance(residuals)
        gamma *= factors.rows / max(float(factors.counted[j]), 1.0)
        gamma *= parzen(len(gamma), bandwidth(gamma))
        middle = sum(_middle(r.matrices[j], gamma) for r in rows)
        meat[np.ix_(columns, columns)] += solution.weights[j] ** 2 * middle
    chosen = np.concatenate([place, *shapes])
    return np.asarray((bread @ meat @ bread)[np.ix_(chosen, chosen)])


def independent_errors(scatter: FloatArray) -> FloatArray:
    """Errors (p, k) that are independent of one another, each of one standard deviation, largest first.

    Args:
        scatter: covariance (p, p) of estimates; of one that is not known (NaN) there are none.
    """
    if not np.isfinite(scatter).all():
        return np.zeros((len(scatter), 0))
    size = np.sqrt(np.maximum(np.diag(scatter), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(scatter / np.outer(scale, scale))
    some = np.flatnonzero(values > ROUNDING * values.max(initial=0.0))[::-1]
    errors: FloatArray = scale[:, None] * vectors[:, some] * np.sqrt(values[some])
    return errors


@dataclass(frozen=True)
class Tangent(Effect):
    """How a term's current changes with its shape parameters; its coefficients are small changes of them."""

    term: Term

    @property
    def acts_on(self) -> int | None:
        """The rows that the term acts on."""
        return self.term.effect.acts_on

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return one coefficient a shape parameter."""
        return tuple(Coefficient(shape.name, shape.unit) for shape in self.term.effect.shapes)

    def start(self) -> FloatArray:
        """Return what the term remembers."""
        return self.term.effect.start()

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the derivative of the term's current by each shape parameter."""
        gradient = self.term.effect.gradient(context, self.term.shape)
        return np.moveaxis(gradient @ self.term.coefficients, 0, -1)


def autocovariance(residuals: list[FloatArray], lags: int = LAGS) -> FloatArray:
    """Autocovariance (lags,) of several stretches of a signal, pooled; not longer than half of the longest stretch.

    Args:
        residuals: stretches of the signal, (N_k,) each.
        lags: how many lags are wanted, from 0.
    """
    lags = min(lags, max(2, max(len(r) for r in residuals) // 2))
    total, counts = np.zeros(lags), np.zeros(lags)
    for residual in residuals:
        size = 2 ** int(np.ceil(np.log2(2 * len(residual))))
        spectrum = np.abs(np.fft.rfft(residual, size)) ** 2
        total[: len(residual)] += np.fft.irfft(spectrum, size)[: min(lags, len(residual))][: len(total)]
        counts += np.maximum(len(residual) - np.arange(lags), 0)
    gamma: FloatArray = total / np.maximum(counts, 1.0)
    return gamma


def bandwidth(gamma: FloatArray) -> int:
    """Width [samples] of the Parzen window for an autocovariance: Andrews' (1991) rule with a first-order fit.

    Args:
        gamma: autocovariance by lag, (lags,).
    """
    if gamma[0] <= 0:
        return 1
    # The first-order coefficient that has the autocovariance's own decay: its integral up to the first zero crossing.
    crossing = int(np.argmax(gamma <= 0)) or len(gamma)
    time = 0.5 + float(np.sum(gamma[1:crossing])) / gamma[0]
    return int(np.clip(np.ceil(6.0 * time), 2, len(gamma)))


def parzen(length: int, width: int) -> FloatArray:
    """Parzen lag window (length,), nought from ``width`` on.

    Args:
        length: of what is returned.
        width: from which the window is nought [samples].
    """
    x = np.arange(length) / width
    inner = 1 - 6 * x**2 + 6 * x**3
    outer = 2 * np.maximum(1 - x, 0.0) ** 3
    return np.where(x <= 0.5, inner, outer)


def correlation_time(residual: FloatArray) -> float:
    """Samples that one independent sample of a signal is worth: ``1 + 2 sum rho_k``, tapered; at least one.

    Args:
        residual: the signal, (N,).
    """
    gamma = autocovariance([residual])
    if gamma[0] <= 0:
        return 1.0
    taper = parzen(len(gamma), bandwidth(gamma))
    return max(1.0, float(1 + 2 * np.sum(taper[1:] * gamma[1:]) / gamma[0]))


def _middle(matrix: FloatArray, gamma: FloatArray) -> FloatArray:
    """Sum over t and k of ``gamma_|k| a_t a_{t+k}'`` for rows a_t of a matrix."""
    rows = len(matrix)
    lags = min(len(gamma), rows)
    size = 2 ** int(np.ceil(np.log2(rows + lags)))
    padded = np.zeros(size)
    padded[:lags] = gamma[:lags]
    padded[size - lags + 1 :] = gamma[1:lags][::-1]
    density = np.maximum(np.fft.rfft(padded).real, 0.0)
    spectrum = np.fft.rfft(matrix, size, axis=0)
    # Frequencies other than nought and Nyquist stand for two.
    density[1:-1] *= 2.0
    weighted = spectrum * density[:, None]
    middle: FloatArray = (spectrum.conj().T @ weighted).real / size
    return middle
