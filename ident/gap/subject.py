"""Steps 1 and 2: the model, fitted again unless it is held fixed, and the rows of logs that it is held against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Term
from ident.effects.survey import Survey
from ident.errors import InputError
from ident.fit import Drives, fit
from ident.gap.clocks import AS_STAMPED, Clock
from ident.gap.edge import with_slight_edge
from ident.gap.joint_gap import JointGap
from ident.gap.lateness import turned_in_time
from ident.gap.panel import Panel
from ident.gap.presliding import yielding
from ident.gap.rests import Rests, no_rests, rests_of
from ident.gap.rows import gap_of, held_of, panel_of, survey_of
from ident.gap.touch import Touches
from ident.gap.unsure import unsure_rows
from ident.log import LogSource
from ident.log_set import path_of
from ident.model import CurrentModel

LEAST_ROWS = 200
"""Rows without which nothing is looked for."""


@dataclass(eq=False)
class Subject:
    """A model and the rows of logs that it is held against; :meth:`look` fills in all but the first four.

    Attributes:
        model: the simulation, as last fitted.
        train: the logs.
        refit: whether the model's own parameters are fitted again with every candidate, or held fixed.
        clock: what is known of the clocks of logs that begin anew.
        rests: joints whose rests are left out.
        panel, survey: the rows, and facts about the logs.
        gaps: each joint's rows with the model's columns.
    """

    model: CurrentModel
    train: Sequence[LogSource]
    refit: bool
    clock: Clock = AS_STAMPED
    rests: Rests = field(init=False)
    panel: Panel = field(init=False)
    survey: Survey = field(init=False)
    gaps: list[JointGap] = field(init=False)
    _turned: bool = field(default=False, init=False)

    def look(self) -> None:
        """Fit the model, gather the rows, and find whose rests are to be left out.

        Raises:
            InputError: the logs have too few rows.
        """
        self.rests = no_rests(self.model.n)
        self._see()
        self.rests = rests_of(self.model, self.panel, self.survey)
        if self.rests.joints:
            self._see()

    def leave_out(self, joints: Sequence[int]) -> bool:
        """Look without the rests of these joints, too; whether that is any other."""
        rests = self.rests.also(joints)
        more = rests.joints != self.rests.joints
        if more:
            self.rests = rests
            self._see()
        return more

    def cut_out(self, touches: Touches) -> None:
        """Look without the rows of touches, which may have hidden which joints yield."""
        self.train = touches.cut(self.panel, self.train)
        self.look()
        found = yielding(self.model, self.panel, self.survey, self.rests) if self.refit else self.model
        if found is not self.model:
            self.model = found
            self.look()

    def turn(self, late: FloatArray) -> bool:
        """Look with signs of velocity that suit currents late by some seconds (n,); whether that makes a difference.

        They were chosen before it was known that the current comes late, which blurs them. Done once, if the model is
        fitted again at all.
        """
        if self._turned or not self.refit or not late.any():
            return False
        self._turned = True
        found = turned_in_time(self.model, self.train, self.rests, late)
        differs = any(new.effect != old.effect for new, old in zip(found.terms, self.model.terms, strict=True))
        if differs:
            self.model = found
            self.look()
        return differs

    def learn(self, term: Term) -> None:
        """Look with one more term in the model."""
        self.model = replace(self.model, terms=(*self.model.terms, term))
        self._see()

    def bend(self, terms: Sequence[Term]) -> None:
        """See the logs by the links that the model has once these terms are fitted with it."""
        beside = self.fitted(self.model, terms, spread=False)
        self.panel = self.panel.seen_by(replace(beside, terms=beside.terms[: -len(terms)]))
        self.survey = survey_of(self.model, self.panel, self.clock.begins, not self.refit)

    def gap(self, panel: Panel, joint: int) -> JointGap:
        """The joint's rows: the model's columns if it is refitted, else what it leaves; of one that sticks no rests."""
        found = (gap_of if self.refit else held_of)(self.model, panel, joint).dealt(panel)
        if joint not in self.rests.joints:
            return found
        left = found.moving(panel, ~panel.gather(self.rests.counts)[:, joint])
        return with_slight_edge(panel, left, self.model.terms)

    def sure_gaps(self) -> list[JointGap]:
        """Every joint's rows but those whose sign of velocity is noise."""
        residuals = np.stack([gap.everywhere(self.panel) for gap in self.gaps], axis=1)
        unsure = unsure_rows(self.model, self.panel, self.survey, residuals)
        return [gap.without(unsure[:, gap.joint]) for gap in self.gaps]

    def fitted(self, model: CurrentModel, terms: Sequence[Term], spread: bool = True) -> CurrentModel:
        """Step 8: a model with what was found, refitted, or with the found terms added to it.

        Standard deviations take a third of the time; without ``spread`` they are not known.
        """
        if not self.refit:
            return replace(model, terms=(*model.terms, *terms))
        everything = [*model.terms, *terms]
        effects, shapes = [t.effect for t in everything], [t.shape for t in everything]
        drives = Drives(model.gain, model.force_unit)
        views = [model.view(source) for source in self.train]
        counts = self.rests.counts
        found = fit(model.robot, effects, views, model.cutoff, drives, shapes=shapes, counts=counts, spread=spread)
        return replace(found.model, positions_only=model.positions_only)

    def _see(self) -> None:
        """The model, its rows and facts about them, with what is known of rests."""
        if self.refit:
            self.model = self.fitted(self.model, [])
        self.panel = panel_of(self.model, self.train)
        if len(self.panel) < LEAST_ROWS:
            what = f"{len(self.panel)} rows to learn from, where {LEAST_ROWS} are needed"
            raise InputError(what, ", ".join(path_of(s) for s in self.train), "give longer logs")
        self.survey = survey_of(self.model, self.panel, self.clock.begins, not self.refit)
        self.gaps = [self.gap(self.panel, j) for j in range(self.model.n)]
