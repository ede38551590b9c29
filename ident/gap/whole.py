"""Causes of the whole robot, tried before those of single joints: one payload beats six offsets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.effects.base import Effect
from ident.effects.survey import Survey
from ident.gap.abstain import explainable
from ident.gap.belief import CERTAIN, ENOUGH, remembered_of
from ident.gap.borne_out import chance_in_all
from ident.gap.candidates import Trial, forms, within_bounds
from ident.gap.on_all import TINY, OnAll, Whole, at_any_pace, columns_of, left_by, likelihoods, times_of
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem, gain
from ident.gap.ranking import alternatives, by_motion, mostly_there, ranked
from ident.gap.search import GAIN, LEVEL, PRICE, Search, falls
from ident.gap.threads import in_threads

SHARE = 0.85
"""Share of what the best effects of single joints explain, together, that one cause of the whole robot must."""

MAJORITY = 2.0 / 3.0
"""Share of the joints that lack something on which it must explain that much, if not on all together."""

SETTLED = 2.0 / 3.0
"""Share of what it explains that must be where it leaves next to nothing, if it must: other joints may lack more."""

ALONE = 0.8
"""Share of the gain in likelihood from which a cause shows on one joint alone: else others bear it out."""

PROMISE = 0.25
"""Share of what the best explains at its start that another must, to be searched before it is known to be needed; and
share of what its joint's best effect explains, and the one that is left out, that what one joint has must, at all;
and share of what a cause explains on the joint where it shows most from which it is held against others' own, too."""

DENIED = 0.25
"""Share of what some joints say for a cause that others may say against it (.03 at most for true ones, .6 for a tilt
that a crosstalk of two currents was taken for)."""

BEATS, NEARLY = 1.25, 0.98
"""What shows on one joint alone must explain so many times what its best effect does; with fewer parameters, nearly."""


def whole_effect(
    panel: Panel,
    survey: Survey,
    searches: Sequence[Search],
    present: Sequence[Effect],
    last: bool = False,
    instead: Effect | None = None,
) -> Whole | None:
    """The best cause of the whole robot, if it explains about as much as single joints' effects.

    Args:
        panel: the rows.
        survey: facts about the logs.
        searches: every joint's search.
        present: causes of the whole robot that are known.
        last: whether it must leave next to nothing where it explains most: what joints have of their own is known.
        instead: an effect of one joint that the searches leave out. Of its own kind (a delay of one joint, or of all)
            a cause of the whole robot need only explain more in all than that on its joint: the others bear it out.
    """
    judge = _Judge(panel, survey, searches, last, instead)
    candidates = [judge.on_all(effect) for effect in forms(survey, None, present)]
    for some in _by_promise(candidates):
        searched = in_threads(lambda pair: pair[0].searched(pair[1]), some)
        found = judge.first(ranked([whole for whole in searched if whole is not None]))
        if found is not None:
            return found
    return None


def _by_promise(candidates: Sequence[OnAll]) -> Iterator[list[tuple[OnAll, Whole | None]]]:
    """Yield the candidates worth a search, which most of the time is spent on, then the others; as each had begun."""
    # Handed on and not kept: Python 3.11 lets one thread at a time into a cached property, of whichever instance.
    begun = in_threads(lambda one: one.begun(), candidates)
    explained = np.array([-np.inf if one is None else one.likelihood for one in begun])
    near = explained >= PROMISE * explained.max(initial=0.0)
    for some in (near, ~near):
        if some.any():
            yield [(candidates[k], begun[k]) for k in np.flatnonzero(some).tolist()]


@dataclass(frozen=True, eq=False)
class _Judge:
    """What causes of the whole robot are held against: what joints' own effects explain; arguments as above."""

    panel: Panel
    survey: Survey
    searches: Sequence[Search]
    last: bool
    instead: Effect | None

    @cached_property
    def problems(self) -> list[JointProblem]:
        """Every joint's regression."""
        return [search.problem for search in self.searches]

    @cached_property
    def before(self) -> FloatArray:
        """Held-out squares (n, folds) of every joint."""
        return np.array([p.errors().held_out for p in self.problems])

    @cached_property
    def _squares(self) -> FloatArray:
        return np.asarray(self.before.sum(axis=1))

    @cached_property
    def _best_single(self) -> FloatArray:
        own = np.array([s.best_error for s in self.searches], dtype=np.float64)
        return np.asarray(np.minimum(self._squares, own))

    @cached_property
    def _single(self) -> FloatArray:
        return likelihoods(self.problems, self._squares, self._best_single)

    def on_all(self, effect: Effect) -> OnAll:
        """An effect on all joints' rows; what one joint has must promise what it is held against there tells."""
        held_against = [effect.joint, None if self.instead is None else self.instead.joint]
        least = PROMISE * max((float(self._single[j]) for j in held_against if j is not None), default=0.0)
        own = None if effect.joint is None else self.searches[effect.at]
        return OnAll(self.panel, self.problems, effect, self.before, own, least)

    def first(self, ranking: Sequence[Whole]) -> Whole | None:
        """The first cause that holds."""
        for best in by_motion(self.panel, self.problems, ranking):
            after = best.held_out.sum(axis=1)
            gains = _gains(self._squares, after)
            # In every fold the joints together must gain: where some move little, others bear it out.
            repeats = falls(np.log(np.maximum(self.before, TINY) / np.maximum(best.held_out, TINY)).sum(axis=0))
            if gains.min() < -GAIN or not repeats or not mostly_there(best):
                continue
            helped = _helped(self.panel, self.searches, best, self._squares, after)
            explained = likelihoods(self.problems, self._squares, after)
            p_value = self._chance(best, helped, explained)
            if p_value <= LEVEL:
                others = alternatives(best, ranking, self._own(helped, explained))
                found = self._in_full(best)
                return replace(found, p_value=p_value, alternatives=others, joint=int(np.argmax(explained)))
        return None

    def _chance(self, best: Whole, helped: IntArray, explained: FloatArray) -> float:
        """Chance of a cause where there is nothing (p-value); 1 if it does not hold."""
        borne_out = chance_in_all(self.panel, self.survey, self.problems, best)
        if borne_out <= LEVEL:
            return borne_out
        told = explained / times_of(self.panel, self.problems, best)
        if len(helped) == 0 or _denied(told) or not self._shown(best, helped, explained):
            return 1.0
        return _p_value(self.panel, best, self.searches)

    def _in_full(self, named: Whole) -> Whole:
        """A linear cause with more of its law, if that pays for its parameters: Schwarz (1978), independent samples."""
        for more in named.effect.fuller(self.survey) if not named.effect.shapes else []:
            full = self.on_all(more).at(named.shape)
            if full is not None and self._pays(named, full):
                return full
        return named

    def _pays(self, named: Whole, full: Whole) -> bool:
        times = times_of(self.panel, self.problems, full)
        explained = likelihoods(self.problems, named.held_out.sum(axis=1), full.held_out.sum(axis=1)) / times
        samples = float(np.sum([len(p) for p in self.problems] / times))
        # What the motion does not show stays nought.
        more = np.count_nonzero(full.coefficients) - np.count_nonzero(named.coefficients)
        return bool(explained.sum() > PRICE * 0.5 * more * np.log(samples))

    def _alone(self, helped: IntArray, explained: FloatArray) -> bool:
        """Whether a cause shows on one joint alone."""
        several = self.last or self.panel.robot.n > 1
        return len(helped) == 1 and several and bool(explained[helped[0]] >= ALONE * explained.sum())

    def _own(self, helped: IntArray, explained: FloatArray) -> list[tuple[Trial, float, float]]:
        """Effects of the joint on which alone a cause shows, best first, with what they and the cause explain there."""
        if not self._alone(helped, explained):
            return []
        (joint,) = helped.tolist()
        search = self.searches[joint]
        own = [within_bounds(self.panel, search.problem, trial, joint) for trial in search.trials]
        left = np.array([search.before.total - search.explained(trial) for trial in own])
        found = likelihoods([search.problem] * len(own), np.full(len(own), search.before.total), left)
        return [(trial, gained, explained[joint]) for trial, gained in zip(own, found.tolist(), strict=True)]

    def _shown(self, best: Whole, helped: IntArray, explained: FloatArray) -> bool:
        """Whether a cause explains about as much as the effects of the joints that it helps, and at any pace."""
        one, alone = int(helped[0]), self._alone(helped, explained)
        if self.instead is not None and type(best.effect) is type(self.instead):
            shown = bool(explained.sum() > self._single[self.instead.at])
        elif alone:
            shown = _stands_alone(best, self.searches[one].closest, explained, self._single, one)
            shown = shown and falls(self.before[one] - best.held_out[one])
        else:
            affected = _gains(self._squares, self._best_single) > GAIN
            shown = _rivals(explained, self._single, affected, helped)
        if shown and (alone or self.last):
            exhausted = [j for j in helped.tolist() if _exhausts(self.panel, self.survey, self.problems[j], best, j)]
            shown = bool(explained[exhausted].sum() >= SETTLED * explained[helped].sum())
        # Play is there where the load changes sides, which slow motion need not do.
        return shown and (best.effect.family == "hysteresis" or at_any_pace(self.panel, self.problems, best))


def _helped(panel: Panel, searches: Sequence[Search], whole: Whole, squares: FloatArray, after: FloatArray) -> IntArray:
    """Joints on which it lowers squared residuals (n,) by enough.

    What softens force must do so beside noise of the accelerations and what the filter cuts away of them, too.
    """
    enough = _gains(squares, after) > GAIN
    if whole.effect.softens:
        enough &= squares - after > panel.jolted * [len(search.problem) for search in searches]
        for j in np.flatnonzero(enough).tolist():
            enough[j] = searches[j].gains_by(panel, columns_of(panel, whole, j))
    return np.flatnonzero(enough)


def _denied(told: FloatArray) -> bool:
    """Whether some joints deny what others say, (n,), by independent samples, of which a slow residual has few."""
    return bool(-told[told < 0.0].sum() > DENIED * told[told > 0.0].sum())


def _stands_alone(whole: Whole, single: Trial | None, likelihoods: FloatArray, singles: FloatArray, joint: int) -> bool:
    """Whether a cause that shows on one joint explains more there than the joint's best effect does.

    What it costs other joints counts. A spring that shows on another joint than its own is chosen among those of all
    joints: it is no simpler cause than that effect.
    """
    simpler = whole.effect.joint in (None, joint) and _simpler(whole, single)
    explained = min(likelihoods[joint], likelihoods.sum())
    return bool(explained > (NEARLY if simpler else BEATS) * singles[joint])


def _simpler(whole: Whole, single: Trial | None) -> bool:
    """Whether a cause of the whole robot has fewer parameters than a joint's effect, which is of another law."""
    if single is None or single.effect.name == whole.effect.name:
        return False
    return len(whole.coefficients) + len(whole.shape) < single.columns + len(single.shape)


def _rivals(likelihoods: FloatArray, single: FloatArray, affected: BoolArray, helped: IntArray) -> bool:
    """Whether it explains nearly what joints' best effects do, on most joints that lack something or all that bear it.

    A joint may have a cause of its own besides, and one that it does not help has.
    """
    most = (affected & (likelihoods >= SHARE * single)).sum() >= max(2, MAJORITY * affected.sum())
    bear = likelihoods >= PROMISE * likelihoods.max()
    bear[helped] = True
    return bool(most or likelihoods.sum() >= SHARE * single[bear].sum())


def _exhausts(panel: Panel, survey: Survey, problem: JointProblem, whole: Whole, joint: int) -> bool:
    """Whether the effect leaves next to nothing on a joint that could still be explained, or that has a memory."""
    before, after = problem.residual, left_by(panel, problem, whole, joint)
    squares = float(after @ after)
    explained = float(before @ before) - squares
    if explained < ENOUGH * remembered_of(panel, problem, after) * squares:
        return False
    return explained >= CERTAIN * explainable(panel, survey, joint, after, problem.keep).share * squares


def _p_value(panel: Panel, whole: Whole, searches: Sequence[Search]) -> float:
    values = []
    for joint, search in enumerate(searches):
        column = columns_of(panel, whole, joint)[search.problem.keep, None]
        values.append(search.gate.p_value(search.gate.statistic(column)))
    return min(1.0, min(values) * len(values))


def _gains(before: FloatArray, after: FloatArray) -> FloatArray:
    """Share (n,) by which each joint's RMS residual falls."""
    return np.array([gain(b, a) for b, a in zip(before, after, strict=True)])
