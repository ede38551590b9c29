"""What the workflow found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Term
from ident.effects.survey import Survey
from ident.gap.evidence import Evidence
from ident.gap.experiment import Experiment
from ident.gap.localise import GapMap
from ident.gap.panel import Panel
from ident.gap.preflight import Untestable
from ident.model import CurrentModel

ITS_SIZE = " (its size)"
"""Ends the name of a signal that only the size of what is unexplained follows."""

OF_RESTS = " (about rests, more than friction holds)"
"""The same of one that is unexplained in rests that are left out."""


@dataclass(frozen=True, eq=False)
class Finding:
    """A named cause of the gap.

    Attributes:
        effect, family: its name and family by the contract.
        joints: joints it acts on, from 0; empty for the whole robot.
        parameters: its figures by the contract's keys.
        p_value: chance of so good a candidate where there is nothing.
        alternatives: names that the logs cannot tell from it.
        next_experiment: what would; None where nothing is open.
        terms: what is added to the model, by the clock of the rows that were looked at.
        explained: share by which it lowered the held-out squared residual of its joint, or of the one that shows most
            of it; None of what was found or cut out before the effects were tried.
        control: what the negative control gained, as a share of the RMS residual; None for the whole robot.
        experiments: by pair of names that are open, the finding's own first, the motion, of those that the workflow was
            given, that would tell most.
    """

    effect: str
    family: str
    joints: tuple[int, ...]
    parameters: dict[str, float | list[float]]
    p_value: float
    alternatives: tuple[str, ...]
    next_experiment: str | None
    terms: tuple[Term, ...]
    explained: float | None
    control: float | None = None
    experiments: Mapping[tuple[str, str], Experiment] = field(default_factory=dict)

    @property
    def settled(self) -> tuple[str, ...]:
        """Alternatives that motions would settle: whichever of them and the name is true, they rule out the others."""
        settling = {frozenset(pair) for pair, one in self.experiments.items() if one.settles}
        against = [name for name in self.alternatives if frozenset({self.effect, name}) in settling]
        return tuple(a for a in against if all(frozenset({a, b}) in settling for b in against if b != a))

    @property
    def motions(self) -> tuple[str, ...]:
        """Names of the motions that would settle those, each once."""
        names = {self.effect, *self.settled}
        return tuple(dict.fromkeys(one.motion for pair, one in self.experiments.items() if names.issuperset(pair)))

    @property
    def telling(self) -> tuple[str, ...]:
        """Names of the motions that would tell most of what is open, each once."""
        return tuple(dict.fromkeys(one.motion for one in self.experiments.values() if one.shows))

    @property
    def where(self) -> str:
        """The joints in words, counted from 1."""
        numbers = ", ".join(str(j + 1) for j in self.joints)
        return f"Joint{'s' if len(self.joints) > 1 else ''} {numbers}" if numbers else "Whole robot"


@dataclass(frozen=True)
class Unexplained:
    """What could be explained on a joint and was not named: its signals and its share of the squared residual.

    Attributes:
        joints: from 0.
        depends_on: signals, such as ``q2`` or ``sign(dq2)``, joints counted from 1; none where no one of them tells it.
            One that only its size follows ends in ``ITS_SIZE``.
        share: of the squared residual, 0 to 1.
    """

    joints: tuple[int, ...]
    depends_on: tuple[str, ...]
    share: float

    @property
    def of_rests(self) -> bool:
        """Whether it is in rests that are left out, and not in the rows looked at."""
        return any(signal.endswith(OF_RESTS) for signal in self.depends_on)

    @property
    def follows_motion(self) -> bool:
        """Whether motion tells it, or its size, and not the clock alone."""
        return not any(signal.startswith("t ") for signal in self.depends_on)


@dataclass(frozen=True, eq=False)
class GapReport:
    """What the workflow found.

    Attributes:
        before, model: the model before, and with what was found.
        findings: named causes, those that explain most first.
        unexplained: what is there and was not named.
        untestable: what the logs could not show.
        map_before, map_after: the gap by joint and regime, on the train logs.
        panel, survey: the rows that were looked at.
        residuals: of those rows, before and after, (N, n), in force units; NaN in rows that were left out. Without what
            a model held fixed may itself err by, which the maps show.
        p_values: chance (n,), over all joints, of so good a first candidate on each joint where there is nothing.
        evidence: errors on the test logs, finding by finding; None where there are no test logs.
        rests: joints, from 0, that stick: their rests were left out, but for the errors on test logs.
        warnings: what the user should look at, in sentences.
    """

    before: CurrentModel
    model: CurrentModel
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    untestable: tuple[Untestable, ...]
    map_before: GapMap
    map_after: GapMap
    panel: Panel = field(repr=False)
    survey: Survey = field(repr=False)
    residuals: tuple[FloatArray, FloatArray] = field(repr=False)
    p_values: FloatArray = field(repr=False)
    evidence: Evidence | None = None
    rests: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def noise_floor(self) -> FloatArray:
        """RMS (n,) of what is left on the rows looked at and nothing predicts, in the current's unit."""
        squares = np.nanmean(self.residuals[1] ** 2, axis=0)
        for one in self.unexplained:
            if not one.of_rests:
                squares[list(one.joints)] *= 1.0 - one.share
        return np.asarray(np.sqrt(squares) / self.model.gain)
