"""Step 8, evidence: the gap on logs that played no part, before and after each finding, and what noise leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.gap.candidates import coefficients
from ident.gap.gate import surrogates
from ident.gap.joint_gap import JointGap, Named, starts_of
from ident.gap.panel import Panel
from ident.gap.problem import gain
from ident.gap.rests import Rests
from ident.log import LogSource
from ident.log_set import path_of
from ident.model import CurrentModel

DRAWS = 9
"""Draws of the negative control."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """RMS errors on test logs, in the current's unit.

    Attributes:
        steps: (n,) for the model before, then with one finding more each, to the model with all of them.
        moving: the same without the rests of joints that stick, which no model of them tells.
        rows: rows that were predicted.
    """

    steps: tuple[FloatArray, ...]
    moving: tuple[FloatArray, ...]
    rows: int

    @property
    def before(self) -> FloatArray:
        """RMS error (n,) of the model before."""
        return self.steps[0]

    @property
    def after(self) -> FloatArray:
        """RMS error (n,) of the model with everything that was found."""
        return self.steps[-1]


def evidence(models: Sequence[CurrentModel], test: Sequence[LogSource], rests: Rests | None = None) -> Evidence:
    """Predict logs with a model and with each of its extensions.

    Args:
        models: the model, and its extensions.
        test: the logs.
        rests: which joints stick.

    Raises:
        InputError: a log is too short to be predicted.
    """
    n = models[0].n
    sums, counts = np.zeros((2, len(models), 2, n))
    for source in test:
        already = counts[0, 0].max()
        for k, model in enumerate(models):
            for block, predicted in model.predict_walk(source):
                left = block.log.current - predicted
                known = np.repeat(np.isfinite(left).all(axis=1, keepdims=True), n, axis=1)
                moving = known if rests is None else known & rests.counts(block)
                for part, rows in enumerate((known, moving)):
                    sums[k, part] += np.sum(np.where(rows, left, 0.0) ** 2, axis=0)
                    counts[k, part] += rows.sum(axis=0)
        if counts[0, 0].max() == already:
            raise InputError("no row that can be predicted", path_of(source), "give a longer log")
    errors = np.sqrt(sums / np.maximum(counts, 1))
    return Evidence(tuple(errors[:, 0]), tuple(errors[:, 1]), int(counts[0, 0].max()))


def negative_control(panel: Panel, gap: JointGap, named: Sequence[Named], one: Named) -> float:
    """Share by which the effect's force, with its phases drawn anew, lowers the held-out RMS residual; the median draw.

    It has the same spectrum but nothing to do with the motion any more, even of logs that repeat one: anything above
    nought is chance.
    """
    problem = gap.problem(panel, [n.trial for n in named if n is not one])
    columns = panel.columns(one.effect, one.trial.shape, gap.joint)[problem.keep]
    force = columns @ coefficients(panel, problem, one.trial, gap.joint)
    drawn = surrogates(force, starts_of(panel, problem), DRAWS, np.random.default_rng(0)).astype(float)
    before = problem.errors().total
    return float(np.median([gain(before, problem.errors(column).total) for column in np.hsplit(drawn, DRAWS)]))
