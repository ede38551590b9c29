"""Which joints yield as they turn round: over which displacement their dry friction builds up (Dahl 1968)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from ident.arrays import BoolArray, FloatArray
from ident.effects.base import Survey
from ident.effects.friction import Coulomb, DirectedEffect, Stribeck
from ident.gap.candidates import best_start, forms, refine
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.gap.rests import (
    HELD,
    SEVERAL,
    SHAKEN,
    SLIP,
    STICKS,
    TOGETHER,
    Rests,
    contrast,
    left_in,
    occasions,
    slipless,
    told_by,
)
from ident.gap.rows import gap_of
from ident.gap.standing import hardly_moved
from ident.gap.unsure import shaken, turning
from ident.model import CurrentModel

DISPLACEMENTS, FINE = np.geomspace(1e-5, 4e-4, 7), 0.02
"""Displacements [rad or m] over which friction may build up; beyond, it is an effect of its own (maxwell-slip).
The best is found to this share."""

SHORTEST = 1.2e-5
"""The shortest of them looks for a sign that turns at once."""

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

    @staticmethod
    def of(model: CurrentModel, panel: Panel, joint: int) -> DryFriction | None:
        """The dry friction of a plain model's joint; None where it has none."""
        own = [t for t in model.terms if t.effect.acts_on in (None, joint)]
        law = next((t.effect for t in own if isinstance(t.effect, Coulomb)), None)
        if law is None:
            return None
        others = [panel.columns(t.effect, t.shape, joint) for t in own if t.effect is not law]
        return DryFriction(panel, joint, law, np.hstack(others))

    def rows(self, law: Coulomb, counts: BoolArray, besides: Sequence[float] = ()) -> JointGap:
        """The joint's rows, of which some (N,) count, with a law of dry friction, and more of it below some speeds."""
        more = Stribeck(self.joint).turned_as(law)
        columns = [self.panel.columns(law, np.zeros(0), self.joint)]
        columns += [self.panel.columns(more, np.array([speed]), self.joint) for speed in besides]
        matrix = np.hstack([self.others, *columns])
        return JointGap(self.joint, matrix, self.panel.force[:, self.joint], counts, ())

    def built_up(self, counts: BoolArray) -> Coulomb:
        """The law that predicts rows (N,) held out best of those that build up over a displacement.

        Friction may follow the speed as it likes: what it is more as a joint creeps would shorten the displacement.
        """

        def error(place: float) -> float:
            law = replace(self.law, presliding=float(np.exp(place)))
            return self.rows(law, counts, CREEPS).problem(self.panel).errors().total

        places = np.log(DISPLACEMENTS)
        best = int(np.argmin([error(place) for place in places.tolist()]))
        ends = places[max(best - 1, 0)], places[min(best + 1, len(places) - 1)]
        found = minimize_scalar(error, bounds=ends, method="bounded", options={"xatol": FINE})
        return replace(self.law, presliding=float(np.exp(found.x)))


def yielding(model: CurrentModel, panel: Panel, survey: Survey, rests: Rests) -> CurrentModel:
    """Let dry friction build up over a displacement where that tells what follows turns, or what rests hold.

    Args:
        model: a plain model.
        panel: rows of logs under it.
        survey: facts about the logs.
        rests: which joints stick.
    """
    gaps = [gap_of(model, panel, j) for j in range(model.n)]
    turned = panel.gather(lambda block: hardly_moved(block, np.full(model.n, SLIP)))
    noise = np.where(turning(panel, survey), np.minimum(shaken(model, panel, survey), survey.holds), 0.0)
    rows = np.where(rests.sticks, ~panel.gather(rests.counts), turned)
    asked = np.flatnonzero(rests.sticks | _err_after_turns(panel, survey, gaps, turned, noise)).tolist()
    lengths = {j: _length(model, panel, gaps[j], rows[:, j], _late(panel, survey, gaps[j])) for j in asked}
    if sum(length > 0.0 for length in lengths.values()) >= TOGETHER[0] * len(asked):
        # A lag that a joint alone seems to have is the same.
        lengths = {j: length or _length(model, panel, gaps[j], rows[:, j]) for j, length in lengths.items()}
    return with_presliding(model, {j: length for j, length in lengths.items() if length > 0.0})


def with_presliding(model: CurrentModel, lengths: dict[int, float]) -> CurrentModel:
    """The model with the direction of joints' friction built up over such displacements."""
    if not lengths:
        return model
    terms = tuple(
        replace(term, effect=replace(term.effect, presliding=lengths.get(term.effect.at, term.effect.presliding)))
        if isinstance(term.effect, DirectedEffect)
        else term
        for term in model.terms
    )
    return replace(model, terms=terms)


def _length(model: CurrentModel, panel: Panel, gap: JointGap, rows: BoolArray, late: FloatArray | None = None) -> float:
    """The displacement that predicts rows held out best; nought if it leaves too much of some of them.

    Args:
        model: a plain model.
        panel: rows of logs under it.
        gap: the joint's rows.
        rows: those (N,) that must be told.
        late: columns (N, k) of a current that comes late, which looks like that, too.
    """
    friction = DryFriction.of(model, panel, gap.joint)
    if friction is None:
        return 0.0
    if late is not None:
        friction = replace(friction, others=np.hstack([friction.others, late]))
    best = friction.built_up(gap.keep)
    left = [friction.rows(law, gap.keep).everywhere(panel)[rows] for law in (friction.law, best)]
    before, after = (float(np.mean(x**2)) for x in left)
    return best.presliding if after < MOST * before and best.presliding > SHORTEST else 0.0


def _late(panel: Panel, survey: Survey, gap: JointGap) -> FloatArray:
    """Columns (N, k) of the law by which a joint's current comes late, as it explains most."""
    problem = gap.problem(panel)
    laws = [effect for effect in forms(survey, gap.joint, gap.present) if effect.family == "timing"]
    starts = [best_start(panel, problem, law, gap.joint) for law in laws]
    if not starts:
        return np.zeros((len(panel), 0))
    found = [refine(panel, problem, start, gap.joint) for start in starts]
    best = max(found, key=lambda one: one.drop)
    return panel.columns(best.effect, best.shape, gap.joint)


def _err_after_turns(
    panel: Panel, survey: Survey, gaps: Sequence[JointGap], turned: BoolArray, noise: FloatArray
) -> BoolArray:
    """Joints (n,) that err far more where they have hardly moved since they turned round than elsewhere."""
    asked = (turned.mean(axis=0) <= TURNS) & turned.any(axis=0)

    def errs(gap: JointGap, times: float) -> bool:
        j = gap.joint
        if not asked[j]:
            return False
        left = gap.without(turned[:, j]).everywhere(panel)
        usual, held, by_noise = contrast(left, turned[:, j], noise[:, j])
        much = times * usual + SHAKEN * by_noise <= held <= (HELD * survey.holds[j]) ** 2 + usual
        return much and _slips(panel, survey, gap, turned[:, j])

    found = [errs(gap, STICKS) for gap in gaps]
    if np.mean(found) >= TOGETHER[0]:
        found = [one or errs(gap, TOGETHER[1]) for one, gap in zip(found, gaps, strict=True)]
    return np.array(found, dtype=bool)


def _slips(panel: Panel, survey: Survey, gap: JointGap, turned: BoolArray) -> bool:
    """Whether what is left after turns is best told by friction over hardly any displacement.

    A current that comes late looks like that, but a delay tells it better.
    """
    problem = gap.problem(panel)
    if occasions(panel, problem.residual, turned) < SEVERAL:
        return False
    ranked = told_by(panel, survey, gap, problem, turned)[:TRIED]
    found = [refine(panel, problem, one, gap.joint) if one.effect.shapes else one for _, one in ranked]
    best = min(found, key=lambda one: left_in(panel, problem, one, gap.joint, turned))
    return slipless(panel, gap, best)
