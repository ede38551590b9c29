"""The gap workflow: where simulation and measurement disagree, what is missing, and how far that closes the gap."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np
from threadpoolctl import threadpool_limits

from ident.arrays import BoolArray, FloatArray
from ident.cautions import reach_warnings, sign_warnings, still_joints, still_warnings
from ident.effects.base import Effect, Term
from ident.errors import InputError
from ident.fit import Drives, fit
from ident.gap.abstain import explainable
from ident.gap.attribute import attribute, still_holding
from ident.gap.baseline import WORTH
from ident.gap.belief import WORTH_SAYING, believed, unexplained
from ident.gap.candidates import Trial, coefficients
from ident.gap.edge import with_less_edge, with_slight_edge
from ident.gap.evidence import evidence, negative_control
from ident.gap.experiment import Experiment, Joined, Question, separating, with_motion
from ident.gap.joint_gap import JointGap, Named
from ident.gap.localise import gap_map
from ident.gap.panel import Panel
from ident.gap.preflight import untestable
from ident.gap.report import Finding, GapReport, Unexplained
from ident.gap.rests import Rests, no_rests, rests_of, slipless
from ident.gap.rows import gap_of, held_of, left_by, panel_of, survey_of
from ident.gap.search import Search, search
from ident.gap.settle import alternatives, next_experiment
from ident.gap.threads import in_threads
from ident.gap.torque_constant import wrong_gain
from ident.gap.touch import Touches, find_touches, undisturbed
from ident.gap.unsure import mistimed, turning, unsure_rows
from ident.gap.velocity_lag import velocity_lag
from ident.gap.whole import Whole, columns_of, whole_effect
from ident.log import JointLog, LogSource
from ident.model import CurrentModel

Progress = Callable[[str, float], None]

SURE = 1e-6
"""Least p-value that is stated."""

ROUNDS = 3
"""Times at most that contact is cut out: links that were fitted to some of it hide the rest."""

MOST_OF_ALL = 2
"""Causes of the whole robot at most that no joint has; springs it may have as many as joints."""

DEPENDENT = {"links", "load", "total"}
"""What effects need of a model that is fitted again with them before they are judged."""


def find_gap(
    model: CurrentModel,
    train: Sequence[LogSource],
    test: Sequence[LogSource] = (),
    refit: bool = True,
    progress: Progress | None = None,
    motions: Mapping[str, JointLog] | None = None,
) -> GapReport:
    """Find what a model lacks.

    Args:
        model: the simulation.
        train: logs to find it in.
        test: logs to show it on, which play no part in finding it.
        refit: whether the model's own parameters are fitted again with every candidate: what does its structure lack?
            Without, it is held fixed: what has changed since it was identified?
        progress: told what is being done and the share of it that is done.
        motions: commanded motions by name (their currents are not looked at), among which the one is sought that
            would separate names that the logs leave open; without any, findings only say it in words.

    Raises:
        InputError: no log, or logs too short.
    """
    if not train:
        raise InputError("no log to look at", "--train", "give at least one log")
    with threadpool_limits(1, "blas"):
        return _Workflow(model, train, test, refit, progress or (lambda what, share: None), motions or {}).run()


@dataclass(frozen=True, eq=False)
class _Causes:
    """Causes of the whole robot, each joint's rows without them, its own causes, and those that are not believed.

    ``p_values`` (n,) say how sure the first of each joint is.
    """

    wholes: list[Whole]
    gaps: list[JointGap]
    named: list[list[Named]]
    doubted: list[list[Named]]
    p_values: FloatArray


@dataclass(eq=False)
class _Workflow:
    model: CurrentModel
    train: Sequence[LogSource]
    test: Sequence[LogSource]
    refit: bool
    tell: Progress
    motions: Mapping[str, JointLog]

    def run(self) -> GapReport:
        self.tell("reading logs", 0.0)
        self.lag = velocity_lag(self.train, self.model.cutoff)
        if self.lag is not None and not (self.refit or self.lags_more()):
            self.lag = None
        if self.lag is not None:
            self.model = replace(self.model, positions_only=True)
        self.look()
        self.start = self.model
        if self.lag is not None:
            logged = replace(self.model, positions_only=False)
            self.start = self.fitted(logged, []) if self.refit else logged
        self.known_before = len(self.model.terms)
        while self.refit and (gain := self.wrong_gain()) is not None:
            self.model = replace(self.model, terms=(*self.model.terms, gain))
            self.see()
        contacts: list[Touches] = []
        while True:
            causes = self.name(~self.unsure())
            if self.leave_out(self.stuck(causes)):
                continue
            found = self.touches(causes.gaps, causes.named) if len(contacts) < ROUNDS else None
            if found is None:
                return self.report(causes, contacts)
            contacts.append(found)
            self.train = found.cut(self.panel, self.train)
            self.look()

    def lags_more(self) -> bool:
        """Whether velocities lag now and did not when a model held fixed was identified: positions suit it better."""
        models = [replace(self.model, positions_only=only) for only in (False, True)]
        left = [left_by(model, panel_of(model, self.train)) for model in models]
        logged, derived = (float(np.sum(np.log(np.maximum(np.mean(x**2, axis=0), 1e-300)))) for x in left)
        return not self.model.positions_only and derived <= logged - WORTH * self.model.n

    def look(self) -> None:
        """Steps 1 and 2: the model, fitted again unless it is held fixed, and the rows that it is held against."""
        self.rests = no_rests(self.model.n)
        self.see()
        self.rests = rests_of(self.model, self.panel, self.survey)
        if self.rests.joints:
            self.see()

    def see(self) -> None:
        """The model, its rows and facts about them, with what is known of rests."""
        if self.refit:
            self.model = self.fitted(self.model, [])
        self.panel = panel_of(self.model, self.train)
        if len(self.panel) < 200:
            raise InputError("too few rows", ", ".join(s.name for s in self.train), "give longer logs")
        self.survey = survey_of(self.model, self.panel)
        self.gaps = [self.gap(self.panel, j) for j in range(self.model.n)]

    def wrong_gain(self) -> Term | None:
        """A joint's gain that the rows of the others contradict."""
        self.tell("comparing joints", 0.0)
        return wrong_gain(self.model, self.panel, self.survey, self.gaps, self.fitted)

    def unsure(self) -> BoolArray:
        """Rows (N, n) whose sign of velocity is noise."""
        residuals = np.stack([gap.everywhere(self.panel) for gap in self.gaps], axis=1)
        return unsure_rows(self.model, self.panel, self.survey, residuals)

    def name(self, keep: BoolArray) -> _Causes:
        """Steps 3 to 5: first causes of the whole robot, then of each joint."""
        gaps = [gap.without(~keep[:, gap.joint]) for gap in self.gaps]
        wholes: list[Whole] = []
        self.tell("trying effects", 0.0)
        searches = self.seen_anew(self.searches(gaps))
        p_values = np.array([one.least_p_value(self.panel) for one in searches])
        self.tell("trying effects", 0.5)
        for _ in range(self.model.n + MOST_OF_ALL):
            found = whole_effect(self.panel, self.survey, searches, self.known(wholes))
            if found is None:
                break
            wholes.append(found)
            gaps = self.without(gaps, found)
            searches = self.searches(gaps)
        named = self.attributed(searches)
        beside = self.whole_beside(searches, named, self.known(wholes))
        if beside is not None:
            wholes.append(beside)
            gaps = self.without(gaps, beside)
            named = self.attributed(self.searches(gaps))
        self.tell("trying effects", 1.0)
        gaps, sure, doubted = map(list, zip(*map(self.judged, named), strict=True))
        return _Causes(wholes, gaps, sure, doubted, p_values)

    def leave_out(self, joints: Sequence[int]) -> bool:
        """Look without the rests of these joints, too; whether that is any other."""
        rests: Rests = self.rests.also(joints)
        more = rests.joints != self.rests.joints
        if more:
            self.rests = rests
            self.see()
        return more

    def stuck(self, causes: _Causes) -> list[int]:
        """Joints that are given friction with a memory of no displacement: that is dry friction that sticks."""
        names = zip(causes.gaps, causes.named, causes.doubted, strict=True)
        return [gap.joint for gap, sure, doubted in names for _ in self.slipless(gap, (*sure, *doubted))]

    def slipless(self, gap: JointGap, named: Sequence[Named]) -> list[Named]:
        """Names of a joint, beside one another, that are hysteresis of no displacement."""
        return [
            one
            for one in named
            if slipless(self.panel, gap, one.trial, [other.trial for other in named if other is not one])
        ]

    def judged(self, last: Search) -> tuple[JointGap, list[Named], list[Named]]:
        """A joint's rows, the names that are believed, and those that explain what is left but are not."""
        names, doubted = self.parted(last)
        if names:
            return last.gap, names, doubted
        sharp = with_less_edge(self.panel, last.gap, self.model.terms)
        if sharp is not None:
            found = attribute(self.panel, self.survey, search(self.panel, self.survey, sharp))
            names, withdrawn = self.parted(found)
            if names or (withdrawn and not doubted):
                return sharp, names, withdrawn
        bold = None if doubted else last.winner(self.panel, certain=False)
        return last.gap, [], doubted if bold is None else [bold]

    def parted(self, last: Search) -> tuple[list[Named], list[Named]]:
        """Names of a joint that are believed, and those that are withdrawn: all, if the others do not hold alone."""
        named = list(last.named)
        believable = believed(self.panel, self.survey, last.gap, named)
        sticks = self.slipless(last.gap, believable)
        names = [one for one in believable if one not in sticks]
        withdrawn = [one for one in named if one not in names]
        if not withdrawn:
            return names, []
        names = still_holding(self.panel, last.gap, names)
        return names, withdrawn if names else named

    def seen_anew(self, searches: Sequence[Search]) -> list[Search]:
        """The searches, anew where a likely effect depends on links that, fitted without it, have bent to it."""
        if not self.refit:
            return list(searches)
        likely = {one.joint: one.winner(self.panel, certain=False) for one in searches}
        dependent = {j: n.trial for j, n in likely.items() if n is not None and DEPENDENT & {*n.effect.needs}}
        if not dependent:
            return list(searches)
        terms = [
            Term(trial.effect, trial.shape, coefficients(self.panel, searches[j].problem, trial, j))
            for j, trial in dependent.items()
        ]
        beside = self.fitted(self.model, terms)
        self.panel = self.panel.seen_by(replace(beside, terms=beside.terms[: -len(terms)]))
        self.survey = survey_of(self.model, self.panel)
        anew = iter(self.searches([one.gap for one in searches if one.joint in dependent]))
        return [next(anew) if one.joint in dependent else one for one in searches]

    def known(self, wholes: Sequence[Whole]) -> list[Effect]:
        """Causes of the whole robot that the model has, and those found."""
        return [*(t.effect for t in self.model.terms if t.effect.acts_on is None), *(w.effect for w in wholes)]

    def without(self, gaps: Sequence[JointGap], whole: Whole) -> list[JointGap]:
        """Every joint's rows with a cause of the whole robot, which none has once more, taken away."""
        added = (columns_of(self.panel, whole, gap.joint) for gap in gaps)
        return [gap.knowing(self.panel, whole.effect, force) for gap, force in zip(gaps, added, strict=True)]

    def attributed(self, searches: Sequence[Search]) -> list[Search]:
        """Every joint's search beside its own causes, from those with nothing named."""
        return in_threads(lambda first: attribute(self.panel, self.survey, first), searches)

    def whole_beside(self, plain: Sequence[Search], full: Sequence[Search], present: Sequence[Effect]) -> Whole | None:
        """A cause of the whole robot that shows only once joints' own causes are known, or that one was taken for.

        Args:
            plain: every joint's search with nothing named.
            full: the same beside its own causes.
            present: causes of the whole robot that are known.
        """
        if not any(one.named for one in full):
            return None
        found = (
            whole_effect(self.panel, self.survey, searches, present, last=True, instead=left_out)
            for searches, left_out in self.beside(plain, full)
        )
        return next((one for one in found if one is not None), None)

    def beside(self, plain: Sequence[Search], full: Sequence[Search]) -> Iterator[tuple[list[Search], Effect | None]]:
        """Yield every joint's search beside all that is named, and beside all but one name, with that, in turn."""
        yield list(full), None
        for j, one in enumerate(full):
            for left_out in one.named:
                others = [n for n in one.named if n is not left_out]
                without = search(self.panel, self.survey, one.gap, others) if others else plain[j]
                yield [*full[:j], without, *full[j + 1 :]], left_out.effect

    def searches(self, gaps: Sequence[JointGap]) -> list[Search]:
        return in_threads(lambda gap: search(self.panel, self.survey, gap), gaps)

    def gap(self, panel: Panel, joint: int) -> JointGap:
        """The joint's rows: the model's columns if it is refitted, else what it leaves; of one that sticks no rests."""
        found = (gap_of if self.refit else held_of)(self.model, panel, joint)
        if joint not in self.rests.joints:
            return found
        left = found.moving(panel, ~panel.gather(self.rests.counts)[:, joint])
        return with_slight_edge(panel, left, self.model.terms)

    def touches(self, gaps: Sequence[JointGap], named: Sequence[Sequence[Named]]) -> Touches | None:
        """Contact in what names leave, if there is any."""
        residuals, explained = (np.zeros((len(self.panel), self.model.n)) for _ in range(2))
        counts = self.panel.gather(self.rests.counts)
        for gap, names in zip(gaps, named, strict=True):
            left, rest = undisturbed(gap, self.panel, [n.trial for n in names]), ~counts[:, gap.joint]
            residuals[gap.keep, gap.joint] = left[gap.keep]
            residuals[rest, gap.joint] = self.rests.beyond(gap.joint, left[rest])
            if names:
                explained[gap.keep, gap.joint] = (undisturbed(gap, self.panel) - left)[gap.keep]
        found = find_touches(self.panel, self.survey, residuals, explained)
        # A burst that the motion predicts is an effect that was not named, and no touch.
        everything = np.arange(len(self.panel))
        shares = {j: explainable(self.panel, self.survey, j, residuals[:, j], everything).share for j in found.joints}
        predicted = [j for j, share in shares.items() if share >= WORTH_SAYING]
        if predicted:
            residuals[:, predicted] = 0.0
            found = find_touches(self.panel, self.survey, residuals, explained)
        return found if found.episodes else None

    def report(self, causes: _Causes, contacts: Sequence[Touches]) -> GapReport:
        self.tell("settling names", 0.0)
        findings = [self.whole_finding(w, causes.gaps[w.joint], causes.named[w.joint]) for w in causes.wholes]
        nameless: list[Unexplained] = []
        errors = mistimed(self.model, self.panel, self.survey)
        before, after = (np.full((len(self.panel), self.model.n), np.nan) for _ in range(2))
        problems = []
        for gap, names, doubted in zip(causes.gaps, causes.named, causes.doubted, strict=True):
            plain, full = self.plain(gap).problem(self.panel), gap.problem(self.panel, [n.trial for n in names])
            problems.append(plain)
            before[plain.keep, gap.joint], after[full.keep, gap.joint] = plain.residual, full.residual
            findings += [self.joint_finding(gap, names, one, plain.errors().total) for one in names]
            nameless += unexplained(self.panel, self.survey, gap, names, doubted, errors[:, gap.joint])
        if len(self.model.terms) > self.known_before:
            # Rows fitted one joint at a time bend their links to a wrong gain: only those that all share show it.
            before = np.where(np.isnan(before), np.nan, left_by(self.start, self.panel.seen_by(self.start)))
        if contacts:
            findings.append(_contact(contacts))
        findings.sort(key=lambda f: -f.explained)
        self.tell("settling names", 0.6)
        missing = untestable(self.panel, self.survey, causes.gaps, problems)
        terms = [finding.terms for finding in findings]
        models = in_threads(lambda k: self.fitted(self.model, list(chain(*terms[: k + 1]))), range(len(terms)))
        if models:
            findings = self.delivered(findings, models[-1])
        first, found_first = self.found_first()
        findings, models = [*first, *findings], [*found_first, *models]
        shown = evidence([self.start, *models], self.test, self.rests) if self.test else None
        model = models[-1] if models else self.model
        maps = [gap_map(self.panel, self.survey, r) for r in (before, after)]
        self.tell("settling names", 1.0)
        return GapReport(
            self.start, model, tuple(findings), tuple(nameless), tuple(missing), maps[0], maps[1],
            self.panel, self.survey, (before, after), causes.p_values, shown, self.rests.joints, self.warnings(),
        )  # fmt: skip

    def found_first(self) -> tuple[list[Finding], list[CurrentModel]]:
        """What was found before any other effect was tried, and the model with each: velocities that lag, gains."""
        plain = replace(self.model, terms=self.model.terms[: self.known_before])
        gains = self.model.terms[self.known_before :]
        findings = []
        if self.lag is not None:
            findings.append(Finding("delay", "timing", (), {"seconds": self.lag.seconds}, SURE, (), None, (), np.inf))
        for gain in gains:
            effect = gain.effect
            figures = effect.summary(self.model.robot, gain.shape, gain.coefficients)
            findings.append(Finding(effect.name, effect.family, (effect.at,), figures, SURE, (), None, (gain,), np.inf))
        known = range(0 if self.lag is not None else 1, len(gains) + 1)
        return findings, [self.model if k == len(gains) else self.fitted(plain, gains[:k]) for k in known]

    def delivered(self, findings: Sequence[Finding], model: CurrentModel) -> list[Finding]:
        """Findings with the term and parameters that the delivered model has of each, all being fitted together."""
        terms, found = iter(model.terms[len(self.model.terms) :]), []
        for finding in findings:
            if finding.terms:
                term = next(terms)
                figures = term.effect.summary(model.robot, term.shape, term.coefficients)
                finding = replace(finding, terms=(term,), parameters=figures)
            found.append(finding)
        return found

    def warnings(self) -> tuple[str, ...]:
        """What the user should look at: joints that stand still, flipped signs, test logs that go further."""
        robot, held = self.model.robot, self.panel.blocks
        return (
            *sign_warnings(self.start, held),
            *still_warnings(robot, still_joints(held)),
            *reach_warnings(robot, self.train, self.test, self.model.cutoff),
        )

    def plain(self, gap: JointGap) -> JointGap:
        """The joint's rows before causes of the whole robot were taken away."""
        return replace(gap, target=self.gaps[gap.joint].target)

    def whole_finding(self, whole: Whole, gap: JointGap, named: Sequence[Named]) -> Finding:
        """A cause of the whole robot and the joint that shows most of it; its figures are yet to come."""
        effect = whole.effect
        term = Term(
            effect,
            whole.shape,
            whole.coefficients,
            *(np.full(k, np.nan) for k in (len(whole.coefficients), len(whole.shape))),
        )
        own = replace(gap, target=gap.target + columns_of(self.panel, whole, gap.joint))
        besides, one = [n.trial for n in named], Trial(effect, whole.shape, 0.0)
        experiments = {name: self.experiment(own, one, other, besides) for name, other in whole.alternatives.items()}
        joints = () if effect.joint is None else (effect.joint,)
        return Finding(
            effect.name, effect.family, joints, {}, whole.p_value, tuple(whole.alternatives),
            next_experiment(effect.name, experiments), (term,), np.inf, motions=_settling(experiments),
        )  # fmt: skip

    def joint_finding(self, gap: JointGap, named: Sequence[Named], one: Named, total: float) -> Finding:
        """A joint's own cause; its figures are yet to come, with the delivered model."""
        effect, trial = one.effect, one.trial
        others = [n.trial for n in named if n is not one]
        found = coefficients(self.panel, gap.problem(self.panel, others), trial, gap.joint)
        unknown = (np.full(k, np.nan) for k in (len(found), len(trial.shape)))
        term = Term(effect, trial.shape, found, *unknown)
        rivals = alternatives(self.panel, gap, named, one)
        experiments = {name: self.experiment(gap, trial, rival, others) for name, rival in rivals.items()}
        return Finding(
            effect.name, effect.family, (gap.joint,), {}, one.p_value, tuple(rivals),
            next_experiment(effect.name, experiments), (term,), one.explained / max(total, 1e-300),
            negative_control(self.panel, gap, named, one),
            _settling(experiments),
        )  # fmt: skip

    def experiment(self, gap: JointGap, one: Trial, other: Trial | None, besides: Sequence[Trial]) -> Experiment | None:
        """The motion that would separate two names of a joint."""
        if other is None or not self.motions:
            return None
        left = gap.problem(self.panel, [*besides, one]).residual
        turns = turning(self.panel, self.survey)[:, gap.joint]
        noisy = bool(turns.any()) and gap.keep[turns].mean() < 0.5
        joined = {}
        for name, (panel, added) in self.joined.items():
            own = self.gap(panel, gap.joint)
            # Where these logs' rests and reversals tell nothing, the motion's would not either.
            hidden = turning(panel, self.survey)[:, gap.joint] & noisy
            joined[name] = Joined(panel, own.without(hidden), added)
        return separating(Question(one, other, tuple(besides), float(np.sqrt(np.mean(left**2)))), joined)

    @cached_property
    def joined(self) -> dict[str, tuple[Panel, int]]:
        """Each motion's rows behind the logs'."""
        return {name: with_motion(self.model, self.panel, motion) for name, motion in self.motions.items()}

    def fitted(self, model: CurrentModel, terms: Sequence[Term]) -> CurrentModel:
        """Step 8: the model with what was found, refitted, or with the found terms added to it."""
        if not self.refit:
            return replace(model, terms=(*model.terms, *terms))
        everything = [*model.terms, *terms]
        effects, shapes = [t.effect for t in everything], [t.shape for t in everything]
        drives = Drives(model.gain, model.force_unit)
        views = [model.view(source) for source in self.train]
        found = fit(model.robot, effects, views, model.cutoff, drives, shapes=shapes, counts=self.rests.counts).model
        return replace(found, positions_only=model.positions_only)


def _settling(experiments: Mapping[str, Experiment | None]) -> dict[str, str]:
    """The motion that would settle a name against each alternative of which one would."""
    return {name: e.motion for name, e in experiments.items() if e is not None and e.settles}


def _contact(contacts: Sequence[Touches]) -> Finding:
    """What was cut out of the logs as contact."""
    joints = tuple(sorted({j for one in contacts for j in one.joints}))
    seconds, episodes = sum(one.seconds for one in contacts), float(sum(one.episodes for one in contacts))
    figures: dict[str, float | list[float]] = {"seconds": seconds, "episodes": episodes}
    return Finding("contact", "contact", joints, figures, SURE, (), None, (), 0.0)
