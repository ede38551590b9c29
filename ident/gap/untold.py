"""Step 8: which figures of a cause of the whole robot the logs hardly tell, as a load's mass where one joint moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import FloatArray
from ident.gap.on_all import TINY, Whole, left_by
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.uncertainty import correlation_time

HARDLY = 0.2
"""Standard error, as a share of the largest figure in the same unit, from which on one is hardly told."""

NONE, SEEN = 1e-6, 1e-3
"""Least eigenvalue of the figures' correlations, as a share of the largest, that logs tell anything of; share of a
figure that may lie where they tell nothing."""


def untold_warnings(panel: Panel, problems: Sequence[JointProblem], wholes: Sequence[Whole]) -> list[str]:
    """Name the figures of causes of the whole robot that the logs hardly tell, and what would.

    Args:
        panel: the rows.
        problems: every joint's regression.
        wholes: the causes.
    """
    said = []
    for whole in (w for w in wholes if len(w.coefficients) > 1):
        errors = _errors(panel, problems, whole.as_meant)
        figures = whole.effect.coefficients(panel.robot)
        largest = {f.unit: 0.0 for f in figures}
        for figure, value in zip(figures, whole.as_meant.coefficients.tolist(), strict=True):
            largest[figure.unit] = max(largest[figure.unit], abs(value))
        hardly = [f.name for f, e in zip(figures, errors, strict=True) if e > HARDLY * largest[f.unit]]
        if hardly:
            said.append(
                f"{whole.effect.name}: the logs hardly tell its {', '.join(hardly)}, and the figures given are one "
                f"choice of many; record {whole.effect.excitation}."
            )
    return said


def _errors(panel: Panel, problems: Sequence[JointProblem], whole: Whole) -> FloatArray:
    """Standard errors (k,) of a cause's figures by independent samples; infinite of what no row tells."""
    count = len(whole.coefficients)
    normal = np.zeros((count, count))
    for joint, problem in enumerate(problems):
        columns = problem.away(problem.of(panel.columns(whole.effect, whole.shape, joint)))
        left = left_by(panel, problem, whole, joint)
        normal += columns.T @ columns / max(float(np.mean(left**2)) * correlation_time(left), TINY)
    size = np.sqrt(np.maximum(np.diag(normal), TINY))
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    told = values > NONE * values[-1]
    errors = np.sqrt(np.sum(vectors[:, told] ** 2 / values[told], axis=1)) / size
    errors[np.sum(vectors[:, ~told] ** 2, axis=1) > SEEN] = np.inf
    return np.asarray(errors)
