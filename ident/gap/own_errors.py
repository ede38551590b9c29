"""What a model that is held fixed does not know of itself: its parameters' errors, as columns of a joint's rows."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.gap.fold_sums import products
from ident.gap.problem import NONE, JointProblem
from ident.uncertainty import correlation_time

BETTER = 10.0
"""How many times better than the logs that a model was identified from those held against it must tell an error."""

MOST = 3.0
"""Standard deviations that an error has at most: what is further off has changed."""


def own_errors(errors: FloatArray, left: FloatArray, edge: FloatArray, fold: IntArray) -> tuple[FloatArray, FloatArray]:
    """Columns (N, k) of errors that a joint's parameters may have, and what each of them squared costs (k,).

    By its covariance, which the logs held against it have not seen, a model is known in advance, though poorly where it
    had little to be identified from (a ridge, or generalised least squares): one squared standard deviation costs as
    much as the noise of one independent sample.

    Args:
        errors: force (N, p) on the joint of every error, independent of the others, of one standard deviation.
        left: what the model leaves of the joint (N,).
        edge: columns (N, e) by which its sign of velocity may turn otherwise.
        fold: number of each row's fold (N,).
    """
    if errors.shape[1] == 0:
        return errors, NONE

    def beside(columns: FloatArray, prior: FloatArray = NONE) -> JointProblem:
        return JointProblem(np.hstack([columns, edge]), left, fold, np.ones(len(left), dtype=bool), prior)

    # With any errors at all: what has changed may be larger than the noise by far.
    noise = beside(errors).residual
    cost = correlation_time(noise) * float(np.mean(noise**2))
    values, vectors = np.linalg.eigh(products(errors, errors))
    columns = errors @ vectors[:, values > BETTER * cost]
    while columns.shape[1] > 0:
        size = np.abs(beside(columns, np.full(columns.shape[1], cost)).fit()[: columns.shape[1]])
        if size.max() <= MOST:
            break
        columns = np.delete(columns, int(np.argmax(size)), axis=1)
    return columns, np.full(columns.shape[1], cost)


def share_within(problem: JointProblem) -> float:
    """Share of the squared gap that lies within the errors that the model's own parameters may have."""
    left = float(problem.residual @ problem.residual)
    raw = problem.residual + problem.within_prior
    return max(1.0 - left / max(float(raw @ raw), 1e-300), 0.0)
