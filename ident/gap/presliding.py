"""Which joints yield as they turn round: over which displacement their dry friction builds up (Dahl 1968)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy.optimize import minimize

from ident.arrays import BoolArray, FloatArray
from ident.effects.base import Effect
from ident.effects.direction import VelocityEffect
from ident.effects.friction import Coulomb
from ident.effects.friction_curve import Stribeck
from ident.effects.hysteresis import LEAST_SLIP
from ident.effects.survey import Survey
from ident.gap.candidates import best_start, forms, refine
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.rests import (
    BESIDE,
    SEVERAL,
    TOGETHER,
    Rests,
    contrast,
    holds,
    left_in,
    noise_at_turns,
    occasions,
    slipless,
    told_by,
)
from ident.gap.rows import gap_of, panel_of
from ident.gap.standing import hardly_moved, of_motors
from ident.gap.threads import in_threads
from ident.log import LogSource
from ident.model import CurrentModel

DISPLACEMENTS, EXPONENTS = (2e-6, LEAST_SLIP), (0.0, 1.0)
"""Displacements [rad or m] over which friction may build up, and exponents; beyond, it is an effect of its own
(maxwell-slip)."""

GRID, STEPS = np.array([(i / 7.0, k / 2.0) for i in range(8) for k in range(3)]), 40
"""Places on those ranges that are tried first, and laws that are tried about the best of them."""

SHORTEST, AT_REST = 2.4e-6, 1.2e-5
"""What ends below this is a sign that turns at once; so it is of joints that stick, and below a count of the encoders
that do not see them creep."""

ROWS = 4000
"""Rows that laws are fitted to, evenly spread."""

CREEPS = (0.02, 0.06, 0.2)
"""Speeds [rad/s or m/s] below which dry friction may be more while that is chosen."""

TURNS = 0.2
"""Share of rows, at most, in which a joint has hardly moved since it turned round, for that to be asked."""

TRIED, MOST = 4, 0.5
"""Laws of what follows turns whose shapes are searched, and share of it that friction which yields leaves at most."""


@dataclass(frozen=True, eq=False)
class DryFriction:
    """A joint's dry friction, whose direction may turn otherwise, beside the columns of all else that its model has.

    Attributes:
        panel: the rows.
        joint: the joint, from 0.
        law: its dry friction.
        others: the other columns (N, p).
    """

    panel: Panel
    joint: int
    law: Coulomb
    others: FloatArray
    _found: list[Coulomb] = field(init=False, default_factory=list)

    @classmethod
    def of_all(cls, model: CurrentModel, panel: Panel, joints: Iterable[int]) -> dict[int, Self]:
        """The dry friction of some joints of a plain model, by joint; those that have none are left out."""
        found = {j: cls.of(model, panel, j) for j in joints}
        return {j: friction for j, friction in found.items() if friction is not None}

    @classmethod
    def of(cls, model: CurrentModel, panel: Panel, joint: int) -> Self | None:
        """The dry friction of a plain model's joint; None where it has none."""
        own = [t for t in model.terms if t.effect.acts_on in (None, joint)]
        law = next((t.effect for t in own if isinstance(t.effect, Coulomb)), None)
        if law is None:
            return None
        others = [panel.columns(t.effect, t.shape, joint) for t in own if t.effect is not law]
        return cls(panel, joint, law, np.hstack(others))

    def columns(self, law: Coulomb, besides: Sequence[float] = ()) -> FloatArray:
        """Columns (N, k) of a law of dry friction, and of more of it below some speeds."""
        more = Stribeck(self.joint).turned_as(law)
        columns = [self.panel.columns(more, np.array([speed]), self.joint) for speed in besides]
        return np.hstack([self.panel.columns(law, np.zeros(0), self.joint), *columns])

    def rows(self, counts: BoolArray, law: Coulomb | None = None) -> JointGap:
        """The joint's rows, of which some (N,) count, with a law of dry friction or without any."""
        matrix = self.others if law is None else np.hstack([self.others, self.columns(law)])
        return JointGap(self.joint, matrix, self.panel.force[:, self.joint], counts, ())

    def left(self, problem: JointProblem, columns: FloatArray) -> FloatArray:
        """What a law's columns (N, k) leave of all rows (N,), fitted to those that count in a problem without them."""
        found, own = problem.fit(problem.of(columns)), self.others.shape[1]
        left: FloatArray = self.panel.force[:, self.joint] - self.others @ found[:own] - columns @ found[own:]
        return left

    def leaves(self, laws: Sequence[Coulomb], counts: BoolArray, rows: BoolArray) -> list[float]:
        """Mean square that each law leaves of some rows (N,), fitted to those that count (N,)."""
        problem = self.rows(counts).problem(self.panel)
        return [float(np.mean(self.left(problem, self.columns(law))[rows] ** 2)) for law in laws]

    def built_up(self) -> Coulomb:
        """The law that fits all rows best of those that build up over a displacement: rests tell most of it."""
        # Not a cached property, into which Python 3.11 lets one thread at a time, of whichever instance.
        if not self._found:
            self._found.append(self._search())
        return self._found[0]

    def _search(self) -> Coulomb:
        """The same; friction may follow the speed: what it is more as a joint creeps would shorten the displacement."""
        some = np.arange(len(self.panel)) % max(1, len(self.panel) // ROWS) == 0
        problem = self.rows(some).problem(self.panel)
        # A panel of its own: what is tried once need not be kept.
        own = replace(self, panel=replace(self.panel))
        ends = np.array([np.log(DISPLACEMENTS), EXPONENTS])

        def law(place: FloatArray) -> Coulomb:
            length, exponent = np.clip(place, *ends.T).tolist()
            return replace(self.law, presliding=float(np.exp(length)), presliding_exponent=exponent)

        def left(place: FloatArray) -> float:
            return -problem.drop(problem.of(own.columns(law(place), CREEPS)))

        places = ends[:, 0] + np.ptp(ends, axis=1) * GRID
        best = min(places, key=left)
        # Towards the middle: at an end a step outwards is none.
        begun = np.stack([best, best + np.array([0.3, 0.0]), best + np.array([0.0, 0.2 if best[1] < 0.5 else -0.2])])
        found = minimize(left, best, method="Nelder-Mead", options={"initial_simplex": begun, "maxfev": STEPS})
        return law(found.x)


def yielding(model: CurrentModel, panel: Panel, survey: Survey, rests: Rests) -> CurrentModel:
    """Let dry friction build up over a displacement where that tells what follows turns, or what rests hold.

    Args:
        model: a plain model.
        panel: rows of logs under it.
        survey: facts about the logs.
        rests: which joints stick.
    """
    gaps = [gap_of(model, panel, j) for j in range(model.n)]
    coupling = model.robot.coupling
    turned = panel.gather(lambda block: hardly_moved(of_motors(block, coupling), np.full(model.n, LEAST_SLIP)))
    noise = noise_at_turns(model, panel, survey)
    dry = DryFriction.of_all(model, panel, range(model.n))
    rows = np.where(rests.sticks, ~panel.gather(rests.counts), turned)
    errs = _err_after_turns(panel, survey, gaps, dry, turned, noise)
    asked = [j for j in dry if rests.sticks[j] or errs[j]]
    shortest = np.where(rests.sticks, np.maximum(AT_REST, panel.counts), SHORTEST)
    shown = [j for j in asked if shortest[j] < DISPLACEMENTS[1]]
    late = {j: _late(panel, survey, gaps[j]) for j in shown}
    laws = {j: _law(dry[j], gaps[j], rows[:, j], shortest[j], late[j]) for j in shown}
    if sum(law is not None for law in laws.values()) >= TOGETHER[0] * len(asked):
        # A lag that a joint alone seems to have is the same.
        laws = {j: law or _law(dry[j], gaps[j], rows[:, j], shortest[j]) for j, law in laws.items()}
    return with_directions(model, laws)


def built_anew(model: CurrentModel, sources: Sequence[LogSource]) -> CurrentModel:
    """Fit the laws once more where friction builds up, if it does, to logs under the model."""
    yields = np.flatnonzero(model.presliding).tolist()
    if not yields:
        return model
    panel = panel_of(model, sources)
    frictions = DryFriction.of_all(model, panel, yields)
    return with_directions(model, {j: dry.built_up() for j, dry in frictions.items()})


def with_directions(model: CurrentModel, laws: Mapping[int, Coulomb | None]) -> CurrentModel:
    """The model with the direction of all friction of some joints, from 0, as it is in a law; None leaves it."""
    if not any(laws.values()):
        return model

    def turned(effect: Effect) -> Effect:
        if not isinstance(effect, VelocityEffect):
            return effect
        law = laws.get(effect.at)
        return effect if law is None else effect.turned_as(law)

    return replace(model, terms=tuple(replace(term, effect=turned(term.effect)) for term in model.terms))


def _law(
    friction: DryFriction, gap: JointGap, rows: BoolArray, shortest: float, late: FloatArray | None = None
) -> Coulomb | None:
    """The dry friction that builds up as fits all rows best; None if it leaves too much of some of them.

    Args:
        friction: the joint's.
        gap: its rows.
        rows: those (N,) that must be told.
        shortest: displacement below which there is none.
        late: columns (N, k) of a current that comes late, which looks like that, too.
    """
    if late is not None:
        friction = replace(friction, others=np.hstack([friction.others, late]))
    best = friction.built_up()
    before, after = friction.leaves([friction.law, best], gap.keep, rows)
    return best if after < MOST * before and best.presliding > shortest else None


def _late(panel: Panel, survey: Survey, gap: JointGap) -> FloatArray:
    """Columns (N, k) of the law by which a joint's current comes late, as it explains most."""
    problem = gap.problem(panel)
    laws = [effect for effect in forms(survey, gap.joint, gap.present) if effect.family == "timing"]
    starts = [best_start(panel, problem, law, gap.joint) for law in laws]
    if not starts:
        return np.zeros((len(panel), 0))
    best = refine(panel, problem, [max(starts, key=lambda start: start.drop)], gap.joint)
    return panel.columns(best.effect, best.shape, gap.joint)


def _err_after_turns(
    panel: Panel,
    survey: Survey,
    gaps: Sequence[JointGap],
    dry: Mapping[int, DryFriction],
    turned: BoolArray,
    noise: FloatArray,
) -> BoolArray:
    """Joints (n,) that err more where they have hardly moved since they turned round, and yield as they do."""
    asked = (turned.mean(axis=0) <= TURNS) & turned.any(axis=0)

    def yields(gap: JointGap) -> bool:
        j = gap.joint
        if not asked[j] or j not in dry:
            return False
        left = gap.without(turned[:, j]).everywhere(panel)
        much = holds(*contrast(left, turned[:, j], noise[:, j]), BESIDE, float(survey.holds[j]))
        return much and _slips(panel, survey, gap, dry[j], turned[:, j])

    return np.array(in_threads(yields, gaps), dtype=bool)


def _slips(panel: Panel, survey: Survey, gap: JointGap, friction: DryFriction, turned: BoolArray) -> bool:
    """Whether what is left after turns is best told by friction over hardly any displacement.

    A current that comes late looks like that, but a delay tells it better.
    """
    problem = gap.problem(panel)
    if occasions(panel, problem.residual, turned) < SEVERAL:
        return False
    ranked = told_by(panel, survey, gap, problem, turned)[:TRIED]
    found = [refine(panel, problem, [one], gap.joint) for _, one in ranked]
    best = min(found, key=lambda one: left_in(panel, problem, one, gap.joint, turned))
    least = left_in(panel, problem, best, gap.joint, turned)
    if slipless(panel, gap, best):
        return True
    # Some turns are over within a sample, which no other law tells.
    (left,) = friction.leaves([friction.built_up()], gap.keep, turned)
    return left < least
