"""What logs tell of a hidden effect: how much nearer its own law is to it than rivals are, and with which figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.effects import load_catalogue
from ident.effects.base import Effect
from ident.effects.survey import Survey
from ident.gap.candidates import forms, grid, lower_bounds
from ident.gap.climb import climb
from ident.gap.panel import Panel
from ident.gap.problem import Beyond, JointProblem, sizes
from ident.gap.rows import gap_of, held_of, panel_of, survey_of

if TYPE_CHECKING:
    from comparisons.hidden_effects.cases import Case, Made
    from ident.log import JointLog
    from ident.model import CurrentModel

ROWS = 4000
"""Rows of a case's logs that laws are compared on."""

SURE = 11.0
"""Log-likelihood by which the true law must be ahead of its rivals: noise makes that differ by twice as much, in the
square, so that the wrong one is the likelier in one case of a hundred."""


@dataclass(frozen=True)
class Told:
    """What logs tell of a hidden effect, if all else were known.

    Attributes:
        margin: log-likelihood by which its law is nearer to it than its rivals are, negative where one of these is
            nearer; None of an effect that the catalogue does not have, or that has no rivals.
        nearest: the figures of the catalogue's law of its name that is nearest to it, by the contract's keys: where the
            law that hides is another, none that is fitted to these logs comes nearer to its own figures.
    """

    margin: float | None = None
    nearest: Mapping[str, float | list[float]] = field(default_factory=dict)


def told(model: CurrentModel, refit: bool, case: Case, made: Made, number: int) -> Told:
    """Return what the logs of a case tell of one of its effects.

    What is hidden is known exactly: it is the difference of logs with and without it. The catalogue's law of that
    name and those that are known to be taken for it are each fitted to it, with the model's own columns beside them.
    What the nearest rival leaves of it, less what its own law leaves, is held against the noise.

    Args:
        model: the model before.
        refit: whether its own parameters are fitted again with the effect.
        case: what is hidden.
        made: its logs.
        number: which of the hidden effects is asked about.
    """
    catalogue, hidden = load_catalogue(), case.hidden[number]
    own = catalogue.get(hidden.effect)
    if own is None:
        return Told()
    rivals = {name for name, entry in catalogue.items() if name in own.rivals or own.name in entry.rivals}
    sight = _Sight.of(model, refit, made, made.alone[number])
    present = [term.effect for term in model.terms] if refit else []
    best: dict[str, _Nearest] = {}
    for joint in dict.fromkeys((hidden.joint, None)):
        for effect in forms(sight.survey, joint, present):
            if effect.name in rivals or (effect.name == own.name and joint == hidden.joint):
                found = sight.nearest(effect)
                if effect.name not in best or found.left < best[effect.name].left:
                    best[effect.name] = found
    if own.name not in best:
        return Told()
    rival = min((best[name].left for name in rivals if name in best), default=None)
    law = best[own.name]
    figures = law.effect.summary(model.robot, law.shape, law.coefficients)
    return Told(None if rival is None else rival - law.left, figures)


@dataclass(frozen=True, eq=False)
class _Nearest:
    """A law at the shape and coefficients that are nearest to what is hidden, and the log-likelihood that it misses."""

    effect: Effect
    shape: FloatArray
    coefficients: FloatArray
    left: float


@dataclass(frozen=True, eq=False)
class _Sight:
    """What logs show of what is hidden in them.

    Attributes:
        panel, survey: rows of the logs, and facts about them.
        problems: every joint's regression, whose target is the hidden force.
        weights: square roots (n,) of the samples that a row stands for, over the noise [1 / force unit].
    """

    panel: Panel
    survey: Survey
    problems: Sequence[JointProblem]
    weights: FloatArray

    @classmethod
    def of(cls, model: CurrentModel, refit: bool, made: Made, logs: Sequence[JointLog]) -> _Sight:
        """Logs of a case, of whose current only what differs from its plain ones counts: the hidden one."""
        pairs = zip(logs, made.plain, strict=False)  # those of the test logs come last
        panel = panel_of(model, [replace(log, current=log.current - plain.current) for log, plain in pairs], ROWS)
        gaps = [(gap_of if refit else held_of)(model, panel, j) for j in range(model.n)]
        # How large its friction is now, a model that was identified before does not know.
        own = [g.matrix if g.friction is None else np.hstack([g.matrix, g.friction]) for g in gaps]
        problems = [JointProblem(m, panel.force[:, j], panel.fold, gaps[j].keep) for j, m in enumerate(own)]
        samples = sum(len(log.t) for log in logs) / made.correlation / len(panel)
        return cls(panel, survey_of(model, panel), problems, np.sqrt(samples) / (made.noise * model.gain))

    @cached_property
    def target(self) -> FloatArray:
        """The hidden force (n N,) of all joints beyond what the model's own columns absorb, over the noise."""
        return np.concatenate([w * p.residual for w, p in zip(self.weights, self.problems, strict=True)])

    def nearest(self, effect: Effect) -> _Nearest:
        """An effect at its best shape, in place of what is hidden."""

        def explained(shape: FloatArray) -> float:
            return self._fit(effect, shape)[1]

        best = max(((shape, explained(shape)) for shape in grid(effect.shapes)), key=lambda one: one[1])
        if effect.shapes:
            best = climb(explained, effect.shapes, [best])
        coefficients, drop = self._fit(effect, best[0])
        return _Nearest(effect, best[0], coefficients, 0.5 * (float(self.target @ self.target) - drop))

    def _fit(self, effect: Effect, shape: FloatArray) -> tuple[FloatArray, float]:
        """An effect's coefficients (k,) at a shape, within their bounds, and by how much the square of what is hidden
        falls."""
        (columns, size), meant = self._columns(effect, shape), effect.plain(shape)
        if meant is not None:
            force = columns @ meant
            return meant, float(2.0 * self.target @ force - force @ force)
        beyond = Beyond(columns.T @ columns / np.outer(size, size), columns.T @ self.target / size, size)
        used = beyond.admissible(lower_bounds(self.panel, effect))
        coefficients = np.zeros(len(used))
        coefficients[used] = beyond.among(used).coefficients
        return coefficients, beyond.among(used).drop

    def _columns(self, effect: Effect, shape: FloatArray) -> tuple[FloatArray, FloatArray]:
        """An effect's columns (n N, k) in all joints' rows beyond the model's own, and their whole lengths (k,)."""
        every = self.panel.all_columns(effect, shape)
        beyond, square = [], np.zeros(every.shape[-1])
        for joint, (weight, problem) in enumerate(zip(self.weights, self.problems, strict=True)):
            if every.ndim == 2 and effect.acts_on != joint:
                beyond.append(np.zeros((len(problem), every.shape[1])))
                continue
            own = weight * problem.of(every[:, joint] if every.ndim == 3 else every)
            beyond.append(problem.away(own))
            square += sizes(own) ** 2
        return np.concatenate(beyond), np.sqrt(np.where(square > 0.0, square, 1.0))
