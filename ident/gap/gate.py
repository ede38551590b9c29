"""Step 4, gate: how large the best of all candidates looks where there is nothing, on the data set's own surrogates.

A surrogate is the residual with its phases drawn anew (Theiler et al. 1992): its spectrum, and so its
autocorrelation, is the residual's own, but it has nothing to do with the motion. Where the joint rests, creeps or
runs it is as large as the residual is there: a residual that is large at rest alone would else be matched by anything
that is large at rest (cf. the wild bootstrap, Wu 1986). Every candidate at every shape from which its search starts
is fitted to every surrogate, as to the residual; the p-value of the best candidate is where it stands among the
surrogates' best (max-T, Westfall and Young 1993), extrapolated by a Gumbel law beyond them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.gap.problem import Float32Array, JointProblem, sizes

SURROGATES = 50
EULER = 0.5772156649

PACES = (0.003, 0.03, 0.3)
"""Speeds, over the mean speed, at which classes of rows part in which the residual is of one size."""

MOVING, FAST = 2, 3
"""First class of speed that is motion, if slow, and that is fast."""

TOLERATED = 0.02
"""Share of the RMS residual by which a candidate may lower it where there is nothing but small errors of the model."""

LEAST = 1e-6
"""Least p-value that is said: no law of extremes is known so far out."""

ABSORBED = 1e-3
"""Share of a column's length that the baseline must leave for it to count."""


class Gate:
    """Surrogates of one joint's residual, and the largest statistic that any candidate reached on each of them."""

    def __init__(self, problem: JointProblem, starts: IntArray, speed: FloatArray, seed: int = 0) -> None:
        self.problem = problem
        self.starts = starts
        self.classes = speed_classes(speed)
        rng = np.random.default_rng([seed, len(problem)])
        drawn = self._surrogates(problem.residual, rng)
        self.targets = np.column_stack([problem.residual.astype(np.float32), drawn])
        self.largest = np.zeros(SURROGATES)

    def look(self, tried: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Fit columns to the residual and to every surrogate.

        Args:
            tried: columns (N, k) of each form that is tried, k the same for all.

        Returns:
            The fall of the squared residual with each, and how many times that of the mean surrogate it is.
        """
        k = tried[0].shape[1]
        if k == 0:
            return np.zeros(len(tried)), np.zeros(len(tried))
        own = np.empty((len(tried), k, len(self.problem)), dtype=np.float32)
        for form, columns in zip(own, tried, strict=True):
            whole = sizes(columns)
            np.divide(columns.T, np.where(whole > 0, whole, 1.0)[:, None], out=form, casting="same_kind")
        flat, basis = own.reshape(len(tried) * k, -1), self.problem.coarse_basis
        flat -= (flat @ basis) @ basis.T
        size = sizes(flat.T)
        # What the baseline absorbs keeps its length of nearly nought, and so takes no part.
        flat /= np.where(size > ABSORBED, size, np.float32(np.inf))[:, None]
        parts = (flat @ self.targets).reshape(len(tried), k, -1).astype(np.float64)
        gram = (own @ own.transpose(0, 2, 1)).astype(np.float64) + 1e-6 * np.eye(k)
        falls = np.einsum("ikr,ikr->ir", parts, np.linalg.solve(gram, parts))
        drop, chance = falls[:, 0], falls[:, 1:]
        mean = chance.mean(axis=1, keepdims=True)
        relative = np.divide(chance, mean, out=np.zeros_like(chance), where=mean > 0.0)
        np.maximum(self.largest, relative.max(axis=0), out=self.largest)
        return drop, np.divide(drop, mean[:, 0], out=np.zeros_like(drop), where=mean[:, 0] > 0.0)

    def statistic(self, columns: FloatArray) -> float:
        """The statistic of columns (N, k) against surrogates of what is left with them fitted.

        No model is exact, and in long logs every error of it is significant: what a candidate would explain of errors
        that are tolerated does not count (an interval instead of a point as the hypothesis, Hodges and Lehmann 1954).
        A constant or a trend is all of its own surrogate's spectrum at the lowest frequencies: surrogates of the
        residual that still holds it would hide it.
        """
        own = self.problem.away(columns)
        size = sizes(own)
        used = size > 1e-6 * np.maximum(sizes(columns), 1e-300)
        if not used.any():
            return 0.0
        own = np.linalg.qr(own[:, used] / size[used])[0]
        part = own.T @ self.problem.residual
        rng = np.random.default_rng(len(columns))
        drawn = self._surrogates(self.problem.residual - own @ part, rng)
        chance = np.sum((own.T.astype(np.float32) @ drawn) ** 2, axis=0)
        tolerated = np.sqrt(1.0 - (1.0 - TOLERATED) ** 2) * np.linalg.norm(self.problem.residual)
        beyond = max(float(np.linalg.norm(part) - tolerated), 0.0) ** 2
        return beyond / max(float(chance.mean()), 1e-300)

    def _surrogates(self, residual: FloatArray, rng: np.random.Generator) -> Float32Array:
        size = np.zeros(len(residual))
        for k in range(len(PACES) + 1):
            rows = self.classes == k
            if rows.any():
                size[rows] = np.sqrt(np.mean(residual[rows] ** 2))
        size = np.maximum(size, 1e-6 * max(float(size.max()), 1e-300))
        return surrogates(residual / size, self.starts, SURROGATES, rng) * size[:, None].astype(np.float32)

    def p_value(self, statistic: float) -> float:
        """Chance that the best candidate looks as good as ``statistic`` where there is nothing."""
        beyond = int(np.sum(self.largest >= statistic))
        if beyond >= 5 or not np.any(self.largest):
            return (1.0 + beyond) / (1.0 + SURROGATES)
        scale = max(float(self.largest.std()) * np.sqrt(6.0) / np.pi, 1e-9)
        place = float(self.largest.mean()) - EULER * scale
        tail = float(-np.expm1(-np.exp(-(statistic - place) / scale)))
        return max(tail, LEAST)


def speed_classes(speed: FloatArray) -> IntArray:
    """Number of the class (N,) in which each row's absolute speed (N,) is: at rest, creeping, slow, fast."""
    edges = np.array(PACES) * max(float(speed.mean()), 1e-300)
    classes: IntArray = np.digitize(speed, edges)
    return classes


def surrogates(residual: FloatArray, starts: IntArray, count: int, rng: np.random.Generator) -> Float32Array:
    """Residuals (N, count) with the phases of each stretch drawn anew; float32."""
    drawn = np.empty((len(residual), count), dtype=np.float32)
    edges = np.append(starts, len(residual))
    for first, end in itertools.pairwise(edges.tolist()):
        rows = end - first
        if rows == 0:
            continue
        spectrum = np.fft.rfft(residual[first:end])
        turned = np.exp(2j * np.pi * rng.random((len(spectrum), count)))
        turned[0] = rng.choice([-1.0, 1.0], count)
        if rows % 2 == 0:
            turned[-1] = rng.choice([-1.0, 1.0], count)
        drawn[first:end] = np.fft.irfft(spectrum[:, None] * turned, rows, axis=0)
    return drawn
