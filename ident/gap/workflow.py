"""The gap workflow: where simulation and measurement disagree, what is missing, and how far that closes the gap."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.effects.base import Survey, Term
from ident.effects.friction import Coulomb
from ident.errors import InputError
from ident.fit import Drives, fit
from ident.gap.abstain import Explainable, explainable
from ident.gap.attribute import JointGap, Named, Search, attribute, search, starts_of
from ident.gap.candidates import admissible, forms
from ident.gap.constancy import inconstancy
from ident.gap.evidence import Evidence, evidence, negative_control
from ident.gap.localise import GapMap, gap_map
from ident.gap.panel import Panel
from ident.gap.preflight import Untestable, untestable
from ident.gap.rows import panel_of, survey_of
from ident.gap.settle import alternatives, next_experiment
from ident.gap.spectrum import spectral_line
from ident.gap.touch import Touches, find_touches, row_step
from ident.gap.velocity_lag import velocity_lag
from ident.gap.whole import Whole, columns_of, whole_effect
from ident.log import LogSource, PositionsOnly
from ident.model import CurrentModel

Progress = Callable[[str, float], None]

EDGE, WIDEST = 4.0, 0.012
"""How much narrower and wider the sign of velocity may turn than the model says, and how wide at most [rad/s]."""

ENOUGH, CERTAIN = 2.0, 8.0
"""Names of a joint must explain this many times what could still be explained after them; else none is given.

Between the two they are given if their coefficients are the same all over the logs.
"""

CONSTANT = 0.03
"""Share of what names explain that varying their coefficients may add."""

SURE = 1e-6
"""Least p-value that is stated."""

WORTH_SAYING = 0.06
"""Share of a joint's squared residual that must be explainable for it to be called unexplained."""


@dataclass(frozen=True, eq=False)
class Finding:
    """A named cause of the gap.

    Attributes:
        effect, family: its name and family by the contract.
        joints: joints it acts on, from 0; empty for the whole robot.
        parameters: its figures by the contract's keys.
        p_value: chance of so good a candidate where there is nothing.
        alternatives: names that the logs cannot tell from it.
        next_experiment: the motion that would; None where nothing is open.
        terms: what is added to the model.
        explained: share by which it lowered the held-out squared residual of its joints.
        control: what the negative control gained, as a share of the RMS residual; None for the whole robot.
    """

    effect: str
    family: str
    joints: tuple[int, ...]
    parameters: dict[str, float | list[float]]
    p_value: float
    alternatives: tuple[str, ...]
    next_experiment: str | None
    terms: tuple[Term, ...]
    explained: float
    control: float | None = None


@dataclass(frozen=True)
class Unexplained:
    """What could be explained on a joint and was not named: its signals and its share of the squared residual."""

    joints: tuple[int, ...]
    depends_on: tuple[str, ...]
    share: float


@dataclass(frozen=True, eq=False)
class GapReport:
    """What the workflow found.

    Attributes:
        before, model: the model before, and with what was found.
        findings: named causes, those that explain most first.
        unexplained: what is there and was not named.
        untestable: what the logs could not show.
        touches: contact that was left out.
        map_before, map_after: the gap by joint and regime, on the train logs.
        panel, survey: the rows that were looked at.
        residuals: of those rows, before and after, (N, n), in force units.
        evidence: errors on the test logs, finding by finding; None where there are no test logs.
    """

    before: CurrentModel
    model: CurrentModel
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    untestable: tuple[Untestable, ...]
    touches: Touches
    map_before: GapMap
    map_after: GapMap
    panel: Panel = field(repr=False)
    survey: Survey = field(repr=False)
    residuals: tuple[FloatArray, FloatArray] = field(repr=False)
    evidence: Evidence | None = None

    @property
    def noise_floor(self) -> FloatArray:
        """RMS (n,) of what is left on the rows looked at and nothing predicts, in the current's unit."""
        squares = np.mean(self.residuals[1] ** 2, axis=0)
        for one in self.unexplained:
            squares[list(one.joints)] *= 1.0 - one.share
        return np.asarray(np.sqrt(squares) / self.model.gain)


def find_gap(
    model: CurrentModel,
    train: Sequence[LogSource],
    test: Sequence[LogSource] = (),
    refit: bool = True,
    progress: Progress | None = None,
) -> GapReport:
    """Find what a model lacks.

    Args:
        model: the simulation.
        train: logs to find it in.
        test: logs to show it on, which play no part in finding it.
        refit: whether the model's own parameters are fitted again with every candidate: what does its structure lack?
            Without, it is held fixed: what has changed since it was identified?
        progress: told what is being done and the share of it that is done.

    Raises:
        InputError: no log, or logs too short.
    """
    if not train:
        raise InputError("no log to look at", "--train", "give at least one log")
    with threadpool_limits(1, "blas"):
        return _Workflow(model, train, test, refit, progress or (lambda what, share: None)).run()


@dataclass(eq=False)
class _Workflow:
    model: CurrentModel
    train: Sequence[LogSource]
    test: Sequence[LogSource]
    refit: bool
    tell: Progress

    def run(self) -> GapReport:
        self.tell("reading logs", 0.0)
        if self.refit:
            self.model = self.fitted(self.model, [])
        self.start, self.lag = self.model, velocity_lag(self.train, self.model.cutoff)
        if self.lag is not None:
            self.train = [PositionsOnly(source) for source in self.train]
            self.model = replace(self.model, positions_only=True)
            self.model = self.fitted(self.model, []) if self.refit else self.model
        self.panel = panel_of(self.model, self.train)
        if len(self.panel) < 200:
            raise InputError("too few rows", ", ".join(s.name for s in self.train), "give longer logs")
        self.survey = survey_of(self.model, self.panel)
        keep = np.ones((len(self.panel), self.model.n), dtype=bool)
        named, wholes, gaps = self.name(keep)
        touches = self.touches(gaps, named)
        if touches.episodes:
            keep &= ~touches.rows[:, None]
            named, wholes, gaps = self.name(keep)
        return self.report(named, wholes, gaps, touches)

    def name(self, keep: BoolArray) -> tuple[list[list[Named]], list[Whole], list[JointGap]]:
        """Steps 3 to 5: first causes of the whole robot, then of each joint."""
        gaps = [self.gap(j, keep[:, j]) for j in range(self.model.n)]
        wholes: list[Whole] = []
        self.tell("trying effects", 0.0)
        searches = self.searches(gaps)
        self.tell("trying effects", 0.5)
        for _ in range(2):
            present = [*(t.effect for t in self.model.terms if t.effect.joint is None), *(w.effect for w in wholes)]
            found, _ = whole_effect(self.panel, self.survey, gaps, searches, present)
            if found is None:
                break
            wholes.append(found)
            gaps = [replace(g, target=g.target - columns_of(self.panel, found, g.joint)) for g in gaps]
            searches = self.searches(gaps)
        named = Parallel(n_jobs=2, prefer="threads")(
            delayed(attribute)(self.panel, self.survey, gap, first) for gap, first in zip(gaps, searches, strict=True)
        )
        self.tell("trying effects", 1.0)
        return [self.believed(gap, names) for gap, names in zip(gaps, named, strict=True)], wholes, gaps

    def searches(self, gaps: Sequence[JointGap]) -> list[Search]:
        found: list[Search] = Parallel(n_jobs=2, prefer="threads")(
            delayed(search)(self.panel, gap, forms(self.survey, gap.joint, gap.present)) for gap in gaps
        )
        return found

    def gap(self, joint: int, keep: BoolArray) -> JointGap:
        """The joint's rows: the model's columns if it is refitted, else what it leaves."""
        own = [t for t in self.model.terms if t.effect.joint in (None, joint)]
        edge = _edge(self.panel, own, joint)
        if self.refit:
            columns = [self.panel.columns(t.effect, t.shape, joint) for t in own]
            present = tuple(t.effect for t in own)
            return JointGap(joint, np.hstack([*columns, edge]), self.panel.force[:, joint], keep, present)
        return JointGap(joint, edge, self.panel.force[:, joint] - self.simulated()[:, joint], keep, ())

    def simulated(self) -> FloatArray:
        """Force (N, n) that the model gives in the panel's rows."""
        parts = [
            self.model.force(block.motion, self.model.start())[rows]
            for block, rows in zip(self.panel.blocks, self.panel.rows, strict=True)
        ]
        return np.concatenate(parts)

    def believed(self, gap: JointGap, named: list[Named]) -> list[Named]:
        """Step 7: names that leave much of what could be explained are no names."""
        if not named:
            return named
        before, after = gap.problem(self.panel), gap.problem(self.panel, [n.trial for n in named])
        left = self.explainable(gap, after.residual, after.keep)
        squares = float(after.residual @ after.residual)
        explained = float(before.residual @ before.residual) - squares
        rest = left.share * squares
        if explained >= CERTAIN * rest:
            return named
        constant = explained >= ENOUGH * rest and inconstancy(self.panel, self.survey, gap, named) <= CONSTANT
        return named if constant else []

    def explainable(self, gap: JointGap, residual: FloatArray, rows: IntArray) -> Explainable:
        return explainable(self.panel, self.survey, gap.joint, residual, rows)

    def touches(self, gaps: Sequence[JointGap], named: Sequence[Sequence[Named]]) -> Touches:
        residuals = np.zeros((len(self.panel), self.model.n))
        for gap, names in zip(gaps, named, strict=True):
            problem = gap.problem(self.panel, [n.trial for n in names])
            residuals[problem.keep, gap.joint] = problem.residual
        found = find_touches(self.panel, residuals)
        real = []
        for j in found.joints:
            # A burst that the motion predicts is an effect that was not named, and no touch.
            everything = np.arange(len(self.panel))
            if self.explainable(gaps[j], residuals[:, j], everything).share < WORTH_SAYING:
                real.append(j)
        none = Touches(np.zeros(len(self.panel), dtype=bool), (), 0.0, 0)
        return replace(found, joints=tuple(real)) if real else none

    def report(
        self, named: list[list[Named]], wholes: list[Whole], gaps: list[JointGap], touches: Touches
    ) -> GapReport:
        self.tell("settling names", 0.0)
        findings = [self.whole_finding(w) for w in wholes]
        unexplained, before, after = [], np.zeros((2, 0)), np.zeros((2, 0))
        before, after = (np.zeros((len(self.panel), self.model.n)) for _ in range(2))
        problems = []
        for gap, names in zip(gaps, named, strict=True):
            plain, full = self.plain(gap).problem(self.panel), gap.problem(self.panel, [n.trial for n in names])
            problems.append(plain)
            before[plain.keep, gap.joint], after[full.keep, gap.joint] = plain.residual, full.residual
            findings += [self.joint_finding(gap, names, one, plain.errors().total) for one in names]
            unexplained += self.unexplained(gap, full.residual, full.keep)
        if touches.episodes:
            figures: dict[str, float | list[float]] = {"seconds": touches.seconds, "episodes": float(touches.episodes)}
            findings.append(Finding("contact", "contact", touches.joints, figures, SURE, (), None, (), 0.0))
        findings.sort(key=lambda f: -f.explained)
        self.tell("settling names", 0.6)
        missing = untestable(self.panel, self.survey, gaps, problems)
        models = [self.fitted(self.model, findings[:k]) for k in range(1, len(findings) + 1)]
        if self.lag is not None:
            models.insert(0, self.model)
            figure: dict[str, float | list[float]] = {"seconds": self.lag.seconds}
            findings.insert(0, Finding("delay", "timing", (), figure, SURE, (), None, (), np.inf))
        shown = evidence([self.start, *models], self.test) if self.test else None
        model = models[-1] if models else self.model
        maps = [gap_map(self.panel, self.survey, r) for r in (before, after)]
        self.tell("settling names", 1.0)
        return GapReport(
            self.start, model, tuple(findings), tuple(unexplained), tuple(missing), touches, maps[0], maps[1],
            self.panel, self.survey, (before, after), shown,
        )  # fmt: skip

    def plain(self, gap: JointGap) -> JointGap:
        """The joint's rows before causes of the whole robot were taken away."""
        return self.gap(gap.joint, gap.keep)

    def unexplained(self, gap: JointGap, residual: FloatArray, rows: IntArray) -> list[Unexplained]:
        left = self.explainable(gap, residual, rows)
        if left.share > WORTH_SAYING:
            return [Unexplained((gap.joint,), left.depends_on, left.share)]
        problem = gap.problem(self.panel)
        line = spectral_line(residual, starts_of(self.panel, problem), row_step(self.panel))
        if line is not None:
            return [Unexplained((gap.joint,), (f"t ({line[0]:.2g} Hz)",), line[1])]
        return []

    def whole_finding(self, whole: Whole) -> Finding:
        effect = whole.effect
        term = Term(
            effect,
            whole.shape,
            whole.coefficients,
            *(np.full(k, np.nan) for k in (len(whole.coefficients), len(whole.shape))),
        )
        figures = effect.summary(self.model.robot, whole.shape, whole.coefficients)
        return Finding(effect.name, effect.family, (), figures, whole.p_value, (), None, (term,), np.inf)

    def joint_finding(self, gap: JointGap, named: Sequence[Named], one: Named, total: float) -> Finding:
        effect, trial = one.effect, one.trial
        coefficients = self.coefficients(gap, named, one)
        unknown = (np.full(k, np.nan) for k in (len(coefficients), len(trial.shape)))
        term = Term(effect, trial.shape, coefficients, *unknown)
        others = alternatives(self.panel, gap, named, one)
        figures = effect.summary(self.model.robot, trial.shape, coefficients)
        return Finding(
            effect.name, effect.family, (gap.joint,), figures, one.p_value, tuple(others),
            next_experiment(effect.name, others), (term,), one.explained / max(total, 1e-300),
            negative_control(self.panel, gap, named, one),
        )  # fmt: skip

    def coefficients(self, gap: JointGap, named: Sequence[Named], one: Named) -> FloatArray:
        """Linear parameters of a name, fitted together with the others; those at their bounds are nought."""
        problem = gap.problem(self.panel, [n.trial for n in named if n is not one])
        whole = self.panel.columns(one.effect, one.trial.shape, gap.joint)[problem.keep]
        used = admissible(self.panel, problem, one.effect, one.trial.shape, gap.joint)
        found = problem.fit(used)[problem.matrix.shape[1] :]
        values, k = np.zeros(whole.shape[1]), 0
        for i in range(whole.shape[1]):
            if k < used.shape[1] and np.array_equal(whole[:, i], used[:, k]):
                values[i], k = found[k], k + 1
        return values

    def fitted(self, model: CurrentModel, findings: Sequence[Finding]) -> CurrentModel:
        """Step 8: the model with what was found, refitted, or with the found terms added to it."""
        terms = [term for finding in findings for term in finding.terms]
        if not self.refit:
            return replace(model, terms=(*model.terms, *terms))
        everything = [*model.terms, *terms]
        effects, shapes = [t.effect for t in everything], [t.shape for t in everything]
        drives = Drives(model.gain, model.force_unit)
        found = fit(model.robot, effects, self.train, model.cutoff, drives, shapes=shapes).model
        return replace(found, positions_only=model.positions_only)


def _edge(panel: Panel, own: Sequence[Term], joint: int) -> FloatArray:
    """How the sign of velocity turns in detail (N, 3): a nuisance, so that no effect is named for it."""
    for term in own:
        if isinstance(term.effect, Coulomb):
            v, width = panel.velocity[:, joint], term.effect.smoothing
            sign = np.tanh(v / width)
            bends = [v / np.sqrt(v**2 + width**2), np.tanh(EDGE * v / width), np.tanh(v / min(EDGE * width, WIDEST))]
            return np.stack([bend - sign for bend in bends], axis=1)
    return np.zeros((len(panel), 0))
