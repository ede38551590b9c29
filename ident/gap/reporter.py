"""Steps 6, 8 and 9: causes become findings, with alternatives, the next experiment and what they do to the gap."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, combinations

import numpy as np

from ident.arrays import FloatArray
from ident.cautions import error_warnings, misfit_warnings, reach_warnings, sign_warnings, still_joints, still_warnings
from ident.effects.base import Effect, Term
from ident.gap.belief import unexplained
from ident.gap.candidates import Trial
from ident.gap.clocks import by_own_clock, clock_warnings
from ident.gap.evidence import Evidence, evidence, negative_control
from ident.gap.experiment import Continued, Experiment, Joined, Question, separating, with_motion
from ident.gap.joint_gap import JointGap, Named
from ident.gap.localise import gap_map
from ident.gap.naming import Causes
from ident.gap.on_all import Whole, columns_of
from ident.gap.own_errors import share_within
from ident.gap.preflight import untestable
from ident.gap.report import Finding, GapReport, Unexplained
from ident.gap.rows import left_by
from ident.gap.settle import alternatives, next_experiment
from ident.gap.subject import Subject
from ident.gap.threads import in_threads
from ident.gap.touch import Touches, undisturbed
from ident.gap.unsure import mistimed, turning
from ident.gap.untold import untold_warnings
from ident.gap.velocity_lag import VelocityLag
from ident.log import JointLog, LogSource
from ident.log_set import set_warnings
from ident.model import CurrentModel

UNCLEAR = 0.5
"""Share of a joint's squared residual without its touches that must be unexplained to make them doubtful, too."""

LEFT_OUT = 0.05
"""Share of a joint's rows that, left out of the search, may be why the model delivered has nothing of a finding."""

SURE = 1e-6
"""Least p-value that is stated."""


@dataclass(frozen=True, eq=False)
class Start:
    """Where the search began, and what was found before any other effect was tried: velocities that lag, gains.

    Attributes:
        model: the model before anything was found.
        lag: of the logged velocities, which the subject's model does without.
    """

    model: CurrentModel
    lag: VelocityLag | None

    @property
    def known(self) -> int:
        """How many terms the model had before its gains were found wrong."""
        return len(self.model.terms)


@dataclass(eq=False)
class Reporter:
    """Writes the report on what was named.

    Attributes:
        subject: the model and its rows.
        start: where the search began.
        test: logs to show findings on.
        motions: commanded motions by name, among which the one is sought that would separate names.
        tell: told the share of it that is done.
    """

    subject: Subject
    start: Start
    test: Sequence[LogSource]
    motions: Mapping[str, JointLog]
    tell: Callable[[float], None]

    def report(self, causes: Causes, contacts: Sequence[Touches]) -> GapReport:
        """Write the report on causes that were named and contact that was cut out."""
        self.tell(0.0)
        subject, panel, survey = self.subject, self.subject.panel, self.subject.survey
        findings = [self._whole_finding(w, causes.gaps[w.joint], causes.named[w.joint]) for w in causes.wholes]
        errors = mistimed(subject.model, panel, survey)
        before, after = (np.full((len(panel), subject.model.n), np.nan) for _ in range(2))
        own, within = [np.zeros_like(before) for _ in range(2)], np.zeros(subject.model.n)
        # Before causes of the whole robot were taken away.
        problems = [replace(gap, target=subject.gaps[gap.joint].target).problem(panel) for gap in causes.gaps]

        def see(joint: int) -> list[Finding]:
            gap, names, plain = causes.gaps[joint], causes.named[joint], problems[joint]
            full = gap.problem(panel, [n.trial for n in names])
            before[plain.keep, joint], after[full.keep, joint] = plain.residual, full.residual
            own[0][plain.keep, joint], own[1][full.keep, joint] = plain.within_prior, full.within_prior
            within[joint] = share_within(full)
            return [self._joint_finding(gap, names, one, plain.errors().total) for one in names]

        findings += chain(*in_threads(see, range(len(problems))))
        nameless = self._nameless(causes, errors)
        if len(subject.model.terms) > self.start.known:
            # Rows fitted one joint at a time bend their links to a wrong gain: only those that all share show it.
            before = np.where(np.isnan(before), np.nan, left_by(self.start.model, panel.seen_by(self.start.model)))
        if any(_clear(one, nameless) for one in contacts):
            findings.append(_contact(contacts))
        findings.sort(key=lambda f: -(f.explained or 0.0))
        self.tell(0.6)
        missing = untestable(panel, survey, causes.gaps, problems)
        terms = [finding.terms for finding in findings]
        models = in_threads(
            lambda k: subject.fitted(subject.model, list(chain(*terms[: k + 1])), spread=k == len(terms) - 1),
            range(len(terms)),
        )
        if models:
            findings = _delivered(findings, models[-1], len(subject.model.terms))
            if denied := self._denied(causes, findings):
                return self.report(causes.without(denied), contacts)
        models = [by_own_clock(model, subject.clock) for model in models]
        first, found_first = self._found_first()
        findings, models = [*first, *findings], [*found_first, *models]
        shown = evidence([self.start.model, *models], self.test, subject.rests) if self.test else None
        model = models[-1] if models else subject.model
        # What a model held fixed may err by is a gap all the same.
        maps = [gap_map(panel, survey, r + errors) for r, errors in zip((before, after), own, strict=True)]
        self.tell(1.0)
        return GapReport(
            self.start.model, model, tuple(findings), tuple(nameless), tuple(missing), maps[0], maps[1],
            panel, survey, (before, after), causes.p_values, shown, subject.rests.joints,
            (
                *self._warnings(findings, within),
                *untold_warnings(panel, problems, causes.wholes),
                *self._misfit(shown, after + own[1], bool(contacts)),
            ),
        )  # fmt: skip

    def _nameless(self, causes: Causes, errors: FloatArray) -> list[Unexplained]:
        """What is left on every joint, also in rests left out; errors (N, n) are of when its friction turns."""
        panel, rests = self.subject.panel, self.subject.rests
        counts = panel.gather(rests.counts)

        def left(joint: int) -> list[Unexplained]:
            gap, names, rest = causes.gaps[joint], causes.named[joint], ~counts[:, joint]
            held = np.zeros(len(panel))
            if rest.any():
                held[rest] = rests.beyond(joint, undisturbed(gap, panel, [n.trial for n in names])[rest])
            return unexplained(panel, self.subject.survey, gap, names, causes.doubted[joint], errors[:, joint], held)

        return list(chain(*in_threads(left, range(len(causes.gaps)))))

    def _denied(self, causes: Causes, findings: Sequence[Finding]) -> list[Named]:
        """Joints' own causes of which the model delivered has nothing though all its rows of the joint were searched.

        Links seen in one joint's rows alone may bend to what the other joints' rows deny.
        """
        nil = {(joint, finding.effect) for finding in findings if is_nil(finding) for joint in finding.joints}
        searched = [
            names
            for gap, names in zip(causes.gaps, causes.named, strict=True)
            if len(gap.keep) > (1.0 - LEFT_OUT) * len(self.subject.gaps[gap.joint].keep)
        ]
        return [one for one in chain(*searched) if (one.effect.joint, one.effect.name) in nil]

    def _found_first(self) -> tuple[list[Finding], list[CurrentModel]]:
        """What was found before any other effect was tried, and the model with each."""
        model, known, lag = self.subject.model, self.start.known, self.start.lag
        plain, gains = replace(model, terms=model.terms[:known]), model.terms[known:]
        findings = []
        if lag is not None:
            findings.append(Finding("delay", "timing", (), {"seconds": lag.seconds}, SURE, (), None, (), None))
        for gain in gains:
            effect = gain.effect
            figures = effect.summary(model.robot, gain.shape, gain.coefficients)
            findings.append(Finding(effect.name, effect.family, (effect.at,), figures, SURE, (), None, (gain,), None))
        steps = range(0 if lag is not None else 1, len(gains) + 1)
        return findings, [model if k == len(gains) else self.subject.fitted(plain, gains[:k]) for k in steps]

    def _warnings(self, findings: Sequence[Finding], within: FloatArray) -> tuple[str, ...]:
        """What the user should look at: joints that stand still, flipped signs, logs that go further, clocks, nil.

        And the share (n,) of what is left of each joint that a model held fixed may err by.
        """
        model, held = self.subject.model, self.subject.panel.blocks
        return (
            *sign_warnings(self.start.model, held),
            *still_warnings(model.robot, still_joints(held)),
            *reach_warnings(model.robot, self.subject.train, self.test, model.cutoff),
            *set_warnings(self.subject.train, self.test),
            *clock_warnings(self.subject.clock, [finding.effect for finding in findings]),
            *nil_warnings(findings),
            *error_warnings(model.robot, within),
        )

    def _misfit(self, shown: Evidence | None, left: FloatArray, touched: bool) -> list[str]:
        """Which joints the model delivered predicts far worse on test logs than it leaves (N, n) of train logs.

        From those contact was cut out if anything touched the arm.
        """
        if shown is None:
            return []
        rows = np.maximum(np.isfinite(left).sum(axis=0), 1)
        known = np.sqrt(np.nansum(left**2, axis=0) / rows) / self.subject.model.gain
        return misfit_warnings(self.subject.model.robot, known, shown.moving[-1], touched)

    def _whole_finding(self, whole: Whole, gap: JointGap, named: Sequence[Named]) -> Finding:
        """A cause of the whole robot and the joint that shows most of it; its figures are yet to come."""
        effect = whole.effect
        own = replace(gap, target=gap.target + columns_of(self.subject.panel, whole, gap.joint))
        besides, one = [n.trial for n in named], Trial(effect, whole.shape, 0.0)
        experiments = self._experiments(own, {effect.name: one, **whole.alternatives}, besides)
        joints, law = () if effect.joint is None else (effect.joint,), whole.as_meant
        left, all_of_it = (rows.problem(self.subject.panel, besides).errors().total for rows in (gap, own))
        proposed = next_experiment(effect.name, whole.alternatives, experiments)
        return Finding(
            effect.name, effect.family, joints, {}, whole.p_value, tuple(whole.alternatives),
            proposed, (_term(effect, law.shape, law.coefficients),),
            1.0 - left / max(all_of_it, 1e-300), experiments=experiments,
        )  # fmt: skip

    def _joint_finding(self, gap: JointGap, named: Sequence[Named], one: Named, total: float) -> Finding:
        """A joint's own cause; its figures are yet to come, with the delivered model."""
        effect, trial, panel = one.effect, one.trial, self.subject.panel
        others = [n.trial for n in named if n is not one]
        found = gap.coefficients_of(panel, one, named)
        rivals = alternatives(panel, gap, named, one)
        experiments = self._experiments(gap, {effect.name: trial, **rivals}, others)
        return Finding(
            effect.name, effect.family, (gap.joint,), {}, one.p_value, tuple(rivals),
            next_experiment(effect.name, rivals, experiments), (_term(effect, trial.shape, found),),
            one.explained / max(total, 1e-300), negative_control(panel, gap, named, one), experiments,
        )  # fmt: skip

    def _experiments(
        self, gap: JointGap, names: Mapping[str, Trial | None], besides: Sequence[Trial]
    ) -> dict[tuple[str, str], Experiment]:
        """By pair of names of a joint the motion that would separate them; none of what no law was fitted for."""
        laws = {name: trial for name, trial in names.items() if trial is not None}
        if len(laws) < 2 or not self.motions:
            return {}
        subject, joined = self.subject, self._joined_of(gap)
        found = {}
        for (one, first), (other, second) in combinations(laws.items(), 2):
            left = gap.problem(subject.panel, [*besides, first]).residual
            rms = float(np.sqrt(np.mean(left**2)))
            found[one, other] = separating(Question(first, second, tuple(besides), rms, subject.survey), joined)
        return found

    def _joined_of(self, gap: JointGap) -> dict[str, Joined]:
        """A joint's baseline on each motion's rows behind the logs'."""
        subject = self.subject
        turns = turning(subject.panel, subject.survey)[:, gap.joint]
        noisy = bool(turns.any()) and gap.keep[turns].mean() < 0.5
        joined = {}
        for name, logs in self._joined.items():
            # Where these logs' rests and reversals tell nothing, the motion's would not either.
            hidden = turning(logs.panel, subject.survey)[:, gap.joint] & noisy
            joined[name] = Joined(logs, subject.gap(logs.panel, gap.joint).without(hidden))
        return joined

    @cached_property
    def _joined(self) -> dict[str, Continued]:
        """Each motion's rows behind the logs'."""
        subject = self.subject
        return {name: with_motion(subject.model, subject.panel, motion) for name, motion in self.motions.items()}


def _term(effect: Effect, shape: FloatArray, coefficients: FloatArray) -> Term:
    """A term as it was found, its standard deviations unknown."""
    return Term(effect, shape, coefficients, *(np.full(len(k), np.nan) for k in (coefficients, shape)))


def _delivered(findings: Sequence[Finding], model: CurrentModel, before: int) -> list[Finding]:
    """Findings with the terms and parameters that a model has of them, fitted together behind its first terms."""
    terms, found = iter(model.terms[before:]), []
    for finding in findings:
        if finding.terms:
            term = next(terms)
            figures = term.effect.summary(model.robot, term.shape, term.coefficients)
            finding = replace(finding, terms=(term,), parameters=figures)
        found.append(finding)
    return found


def is_nil(finding: Finding) -> bool:
    """Whether the model delivered has nothing of a finding."""
    return bool(finding.terms) and not any(term.coefficients.any() for term in finding.terms)


def nil_warnings(findings: Sequence[Finding]) -> list[str]:
    """Say of which findings the model delivered has nothing, since rows that are left out of the search deny them."""
    return [
        f"{one.where}: {one.effect} shows in rows whose sign of velocity is sure, and comes to nothing in the model, "
        "which is fitted to all rows: log positions with less noise."
        for one in findings
        if is_nil(one)
    ]


def _clear(touches: Touches, nameless: Sequence[Unexplained]) -> bool:
    """Whether touches are more than bursts of what follows the motion of all their joints, and has no name."""
    doubtful = {j for one in nameless if one.share > UNCLEAR and one.follows_motion for j in one.joints}
    return not set(touches.joints) <= doubtful


def _contact(contacts: Sequence[Touches]) -> Finding:
    """What was cut out of the logs as contact."""
    joints = tuple(sorted({j for one in contacts for j in one.joints}))
    seconds, episodes = sum(one.seconds for one in contacts), float(sum(one.episodes for one in contacts))
    figures: dict[str, float | list[float]] = {"seconds": seconds, "episodes": episodes}
    return Finding("contact", "contact", joints, figures, SURE, (), None, (), None)
