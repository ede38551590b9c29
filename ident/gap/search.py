"""Step 5, attribute: all candidates of a joint beside what is named, and what the best must satisfy to be named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import lsq_linear

from ident.arrays import FloatArray
from ident.effects.base import Effect
from ident.effects.survey import Survey
from ident.gap.abstain import explainable
from ident.gap.agreement import AGREES, Predicted, agrees, agrees_at_any_pace
from ident.gap.candidates import Trial, admissible, best_trials, coefficients, force_of, forms
from ident.gap.gate import MOVING, Gate
from ident.gap.joint_gap import JointGap, Named, classes_of, gate_of, nested_errors
from ident.gap.panel import Panel
from ident.gap.problem import Errors, JointProblem, gain
from ident.uncertainty import correlation_time

GAIN = 0.05
"""An effect must lower the held-out RMS residual of its joint by this share."""

LEVEL = 0.01
"""Chance of a false name on a whole robot that the gate allows."""

PRICE = 1.5
"""How far beyond Schwarz's criterion a gain must be: correlation times of short logs are themselves uncertain."""

PARSIMONY = 0.004
"""Share of the held-out RMS residual by which a parameter more must be better."""

LAW, RIVAL_LAW = 0.03, 0.15
"""No law is exact: another effect must explain more than this share of what one named before did, a rival more."""

OWN, BEYOND = 0.03, 0.5
"""Share by which a model's own friction may be wrong; share of what that explains, or leaves to be explained if that is
less, that an effect must explain besides."""

PLAIN = 0.85
"""Share of what an effect explains that one of its limits must, to be named first."""

ITSELF = 0.95
"""Share of what an effect explains from which on it is not its law, if columns that only come with that explain it."""

FEW, RESTS = 0.02, 0.1
"""Share of rows without which motion, and rest, are not asked: a log whose joint stands for less is one of
reversals."""

AT_REST = ("coulomb-asymmetry",)
"""Effects that motion alone does not tell from those that a joint has: not asked of one whose rests are left out."""

WORSE = 0.05
"""Share of what is gained over all folds that may be lost on some."""


@dataclass(frozen=True, eq=False)
class Beside:
    """What a joint lacks beside what is named.

    Attributes:
        gap: the joint's rows.
        named: what is named already.
        problem: the regression to which effects are added.
        before: squared residuals without any of them.
    """

    gap: JointGap
    named: tuple[Named, ...]
    problem: JointProblem
    before: Errors

    @classmethod
    def of(cls, panel: Panel, gap: JointGap, named: Sequence[Named]) -> Beside:
        """A joint's rows with effects named among the baseline's."""
        problem = gap.problem(panel, [n.trial for n in named])
        return cls(gap, tuple(named), problem, problem.errors())

    @property
    def joint(self) -> int:
        """The joint."""
        return self.gap.joint

    def explained(self, trial: Trial) -> float:
        """By how much a candidate lowers the held-out squared residual."""
        return self.before.total - (trial.errors.total if trial.errors is not None else np.inf)

    def gains(self, trial: Trial) -> bool:
        """Whether a candidate lowers the residual by enough, with a shape that is its law's."""
        assert trial.errors is not None
        return gain(self.before.total, trial.errors.total) > GAIN and not trial.at_bound

    def law_error(self, effect: Effect) -> float:
        """What an effect must explain so that it is not the error of the laws by which others were named.

        Of causes of the whole robot those of bodies are exact; one that is the effect's rival need not be.
        """
        known = [*((n.effect, n.explained) for n in self.named), *self.gap.wholes]
        rivals = [RIVAL_LAW * explained for other, explained in known if effect.rivals_with(other)]
        return max([*(LAW * n.explained for n in self.named), *rivals], default=0.0)

    def passes(self, panel: Panel, trial: Trial) -> bool:
        """Whether a candidate gains enough and holds."""
        return self.gains(trial) and self.holds(panel, trial, self.columns(panel, trial))

    def holds(self, panel: Panel, trial: Trial, columns: FloatArray) -> bool:
        """Whether a candidate helps on all folds, at rest and in motion, without nuisance, and by any fold's shape."""
        assert trial.errors is not None
        moving = classes_of(panel, self.problem, self.joint) >= MOVING
        groups = [rows for rows, share in ((moving, FEW), (~moving, RESTS)) if rows.mean() > share]
        everywhere = falls(self.before.held_out - trial.errors.held_out) and agrees(self.problem, columns, groups)
        everywhere = everywhere and self._is_no_noise(panel, trial)
        everywhere = everywhere and self._is_on_time(panel, trial, columns)
        everywhere = everywhere and self._is_itself(panel, trial, columns)
        return everywhere and self._shrinks(panel, trial) and self._repeats(panel, trial)

    def columns(self, panel: Panel, trial: Trial) -> FloatArray:
        """Columns (N, k) of a candidate in the rows that count."""
        return admissible(panel, self.problem, trial.effect, trial.shape, self.joint)

    def _is_no_noise(self, panel: Panel, trial: Trial) -> bool:
        """Whether it explains more than noise of the accelerations makes, which laws that soften force take away."""
        return not trial.effect.softens or self.explained(trial) > len(self.problem) * float(panel.jolted[self.joint])

    def _is_on_time(self, panel: Panel, trial: Trial, columns: FloatArray) -> bool:
        """Whether what a delay or a filter predicts is there at any pace; of other laws that is not asked."""
        if trial.effect.family != "timing":
            return True
        force = columns @ self.problem.beyond(columns).coefficients
        return agrees_at_any_pace([Predicted.of(panel, self.problem, self.joint, force)], AGREES)

    def _is_itself(self, panel: Panel, trial: Trial, columns: FloatArray) -> bool:
        """Whether what explains the joint is more than what comes with the law: damping alone is no dry friction."""
        if trial.effect.leads and coefficients(panel, self.problem, trial, self.joint)[0] == 0.0:
            return False
        besides = trial.effect.besides
        if besides == 0:
            return True
        alone = self.problem.of(panel.columns(trial.effect, trial.shape, self.joint))[:, -besides:]
        return self.problem.drop(alone) < ITSELF * self.problem.drop(columns)

    def _shrinks(self, panel: Panel, trial: Trial) -> bool:
        """Whether the model gains by the effect as well as it will be delivered, and if its sign turns otherwise.

        A law that softens force must explain enough beside what the filter cuts away, too.
        """
        if trial.effect.softens and not self.gains_by(panel, force_of(panel, self.problem, trial, self.joint)):
            return False
        others = [gap for gap in (self.gap.bare(), self.gap.edged()) if gap.matrix.shape != self.gap.matrix.shape]
        return all(self._gains_in(panel, gap, trial) for gap in others)

    def gains_by(self, panel: Panel, force: FloatArray) -> bool:
        """Whether a force (N,) in the joint's rows explains enough beside what the filter cuts away, too."""
        gap, named = self.gap.beside(panel.cut_away[:, self.joint]), [n.trial for n in self.named]
        without = replace(gap, target=gap.target - force)
        before, after = (one.problem(panel, named).errors().total for one in (gap, without))
        return gain(before, after) > GAIN

    def _gains_in(self, panel: Panel, gap: JointGap, trial: Trial) -> bool:
        problem = gap.problem(panel, [n.trial for n in self.named])
        with_it = problem.errors(admissible(panel, problem, trial.effect, trial.shape, self.joint))
        return gain(problem.errors().total, with_it.total) > 0.5 * GAIN

    def _repeats(self, panel: Panel, trial: Trial) -> bool:
        """Whether it predicts the folds with its shape, too, found on the others: a shape may fit by chance."""
        before, after = nested_errors(panel, self.gap, [n.trial for n in self.named], trial)
        return falls(before - after) and gain(float(before.sum()), float(after.sum())) > GAIN


def falls(by: FloatArray) -> bool:
    """Whether what is left falls in every fold, by (folds,), or rises next to nothing where an effect hardly shows."""
    return bool(-by[by < 0.0].sum() <= WORSE * by.sum())


@dataclass(frozen=True, eq=False)
class Search(Beside):
    """All candidates tried on a joint beside what is named.

    Attributes:
        gate: its surrogates, which have seen all of them.
        trials: the candidates, best first.
        predictable: share of the squared residual that anything could explain; the rest of it is noise.
        shown: best starts, in its own row, of causes of the whole robot that this joint has, as written, if known.
        refined: the shape to which they lead there, from which those are searched for in all rows.
    """

    gate: Gate
    trials: tuple[Trial, ...]
    predictable: float = 1.0
    shown: dict[str, list[Trial]] = field(default_factory=dict)
    refined: dict[str, list[FloatArray]] = field(default_factory=dict)

    @cached_property
    def closest(self) -> Trial | None:
        """The candidate that predicts held-out rows best."""
        judged = ((t.errors.total, t) for t in self.trials if t.errors is not None)
        return min(judged, key=lambda one: one[0], default=(0.0, None))[1]

    @property
    def best_error(self) -> float:
        """Smallest held-out squared residual of all candidates."""
        best = self.closest
        return self.before.total if best is None or best.errors is None else best.errors.total

    @property
    def most(self) -> float:
        """Held-out squared residual that the candidate which predicts best explains."""
        return self.before.total - self.best_error

    @cached_property
    def tolerated(self) -> float:
        """Squared residual that small errors of the model's own friction explain."""
        if self.gap.friction is None:
            return 0.0
        columns, left = self.problem.away(self.problem.of(self.gap.friction)), self.problem.residual
        return float(left @ left - 2.0 * lsq_linear(columns, left, bounds=(-OWN, OWN)).cost)

    def least(self, effect: Effect) -> float:
        """Squared residual that an effect must explain to be more than errors of what is known and named."""
        rest = max(self.predictable * float(np.sum(self.problem.residual**2)) - self.tolerated, 0.0)
        return max(self.law_error(effect), self.tolerated + BEYOND * min(self.tolerated, rest))

    def winner(self, panel: Panel, certain: bool = True) -> Named | None:
        """The best candidate that passes the gate, if there is one; all joints of the robot share the level.

        Unless it must be ``certain``, it need not hold everywhere: what it lacks, other causes may bring.
        """
        for trial in self.trials:
            if not self.gains(trial) or self.explained(trial) <= self.least(trial.effect):
                continue
            columns = self.columns(panel, trial)
            if not self._worth(columns, trial):
                continue
            p_value = self._p_value(panel, columns)
            if p_value <= LEVEL and (not certain or self.holds(panel, trial, columns)):
                plain = self._limit_of(panel, trial, certain)
                return Named(plain, p_value, self.explained(plain), self.trials)
        return None

    def least_p_value(self, panel: Panel) -> float:
        """Chance of so good a candidate as the one that predicts best where there is nothing, on any joint."""
        return self._p_value(panel, self.columns(panel, self.trials[0])) if self.trials else 1.0

    def _limit_of(self, panel: Panel, trial: Trial, certain: bool) -> Trial:
        """A candidate, or the best of its limits if that explains nearly as much and holds: plain laws come first."""
        enough = PLAIN * self.explained(trial)
        limits = (t for t in self.trials if t.effect.name in trial.effect.contains and self.explained(t) > enough)
        return next((t for t in limits if not certain or self.holds(panel, t, self.columns(panel, t))), trial)

    def _p_value(self, panel: Panel, columns: FloatArray) -> float:
        return min(1.0, panel.robot.n * self.gate.p_value(self.gate.statistic(columns)))

    def _worth(self, columns: FloatArray, trial: Trial) -> bool:
        """Whether a gain pays for the effect's parameters and for having been searched, in independent samples.

        Schwarz's criterion with the number of samples divided by the residual's correlation time, and the logarithm
        of the number of candidates (Chen and Chen 2008).
        """
        assert trial.errors is not None
        gained = gain(self.before.total, trial.errors.total)
        left = self.problem.left(columns)
        samples = len(left) / correlation_time(left)
        price = 0.5 * (columns.shape[1] + len(trial.shape)) * np.log(max(samples, 2.0)) + np.log(len(self.trials))
        return bool(-samples * np.log(1.0 - gained) > PRICE * price)


def search(panel: Panel, survey: Survey, gap: JointGap, named: Sequence[Named] = ()) -> Search:
    """Try what a joint does not have yet, besides what is named."""
    effects = forms(survey, gap.joint, [*gap.present, *(n.effect for n in named)])
    if gap.sticks:
        effects = [effect for effect in effects if effect.name not in AT_REST]
    place = Beside.of(panel, gap, named)
    gate = gate_of(panel, place.problem, gap.joint)
    trials = best_trials(panel, survey, gate, effects, gap.joint)
    found = Search(gap, place.named, place.problem, place.before, gate, tuple(sorted(trials, key=penalised)))
    return replace(found, predictable=_predictable(panel, survey, found))


def _predictable(panel: Panel, survey: Survey, found: Search) -> float:
    """Share of a joint's squared residual that anything could explain; not asked where no error is tolerated."""
    if found.tolerated == 0.0 or not any(found.gains(trial) for trial in found.trials):
        return 1.0
    problem = found.problem
    by_trees = explainable(panel, survey, found.joint, problem.residual, problem.keep).share
    return max(by_trees, found.most / found.before.total)


def penalised(trial: Trial) -> float:
    """Held-out error with a price on every parameter."""
    if trial.errors is None:
        return np.inf
    return priced(trial.errors.total, len(trial.shape) + trial.columns + trial.effect.charged)


def priced(error: float, parameters: int) -> float:
    """A held-out error in squares with a price on every parameter."""
    return error * (1.0 + 2.0 * PARSIMONY * parameters)
