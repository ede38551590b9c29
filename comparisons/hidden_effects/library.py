"""The candidate columns that rival methods choose among: the catalogue's, at the starting shapes that fit best.

Rivals get what the gap workflow gets: the same rows of the same logs, the same baseline (with the same nuisance columns
for how the sign of velocity turns) and the same effects. They differ in how they choose.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Effect
from ident.effects.survey import Survey
from ident.gap.candidates import best_start, forms
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.rows import gap_of, held_of, panel_of, survey_of
from ident.log import LogSource
from ident.model import CurrentModel


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect at its best starting shape, its columns (N, k) in one joint's rows, and all its coefficients' use."""

    effect: Effect
    shape: FloatArray
    columns: FloatArray


@dataclass(frozen=True, eq=False)
class JointLibrary:
    """One joint's regression and the candidates for it; `problem` holds the baseline and the target."""

    joint: int
    problem: JointProblem
    candidates: tuple[Candidate, ...]

    @cached_property
    def matrix(self) -> FloatArray:
        """All candidates' columns side by side (N, p), without what the baseline absorbs, of length one."""
        own = self.problem.away(np.hstack([c.columns for c in self.candidates]))
        size = np.linalg.norm(own, axis=0)
        whole = np.concatenate([np.linalg.norm(c.columns, axis=0) for c in self.candidates])
        kept = size > 1e-6 * np.maximum(whole, 1e-300)
        return np.asarray(np.where(kept, own / np.where(size > 0, size, 1.0), 0.0))

    @cached_property
    def owner(self) -> list[int]:
        """Number of the candidate that each column of `matrix` belongs to."""
        return [k for k, c in enumerate(self.candidates) for _ in range(c.columns.shape[1])]


@dataclass(frozen=True, eq=False)
class Library:
    """What rivals see of a case: the model, its rows, and every joint's candidates.

    Attributes:
        model: the model before.
        refit: whether its parameters are fitted again with the candidates.
        panel, survey: the rows and facts about them.
        joints: one regression a joint.
    """

    model: CurrentModel
    refit: bool
    panel: Panel
    survey: Survey
    joints: tuple[JointLibrary, ...]


def library(model: CurrentModel, train: Sequence[LogSource], refit: bool) -> Library:
    """Build the candidates' columns for the logs of a case."""
    panel = panel_of(model, train)
    survey = survey_of(model, panel)
    joints = tuple(_joint(model, panel, survey, refit, joint) for joint in range(model.n))
    return Library(model, refit, panel, survey, joints)


def _joint(model: CurrentModel, panel: Panel, survey: Survey, refit: bool, joint: int) -> JointLibrary:
    gap = (gap_of if refit else held_of)(model, panel, joint)
    problem = gap.problem(panel)
    return JointLibrary(joint, problem, tuple(_candidates(panel, survey, problem, joint, gap.present)))


def _candidates(
    panel: Panel, survey: Survey, problem: JointProblem, joint: int, present: Sequence[Effect]
) -> Iterator[Candidate]:
    """Yield the joint's candidates; those of the whole robot as columns of this joint's row, if it has no such."""
    single = forms(survey, joint, present)
    names = {effect.name for effect in single}
    whole = [effect for effect in forms(survey, None, present) if effect.name not in names]
    for effect in [*single, *whole]:
        best = best_start(panel, problem, effect, joint)
        if best.drop > 0.0:
            yield Candidate(effect, best.shape, problem.of(panel.columns(effect, best.shape, joint)))
