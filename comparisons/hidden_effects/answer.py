"""What is hidden in a case, and what a method answers when asked for it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.hidden_effects.cases import Case, Made
from comparisons.hidden_effects.identifiability import SURE, Told
from comparisons.hidden_effects.laws import FOREIGN
from ident.arrays import FloatArray

if TYPE_CHECKING:
    from ident.gap import GapReport

Joints = tuple[int, ...]
"""Joints from 0; empty for the whole robot."""


@dataclass(frozen=True)
class Secret:
    """One hidden effect: its name, its joints, its severity, and its true parameters by the contract's keys.

    ``margin`` is by how many standard deviations the logs tell it from its rivals; None where it has none, and of
    measured logs, of which it is not known. ``nearest`` are the figures of the catalogue's law that is nearest to it,
    which differ from its own where the law that hides is another.
    """

    effect: str
    joints: Joints
    severity: float
    parameters: Mapping[str, float]
    margin: float | None = None
    nearest: Mapping[str, float] = field(default_factory=dict)

    @property
    def foreign(self) -> bool:
        """Whether the catalogue does not have it."""
        return self.effect in FOREIGN


@dataclass(frozen=True)
class Truth:
    """What a case hides.

    Attributes:
        name: name of the case, unique in a run.
        robot: its robot.
        kind: set it belongs to: single, changed, pair, triple, nothing, foreign, tie, added or deleted.
        secrets: hidden effects.
        noise: standard deviation (n,) of the current's noise; on measured logs what a model leaves of them.
        known: RMS error (n,) on test logs of the model before, where what is hidden is known and taken away.
        exact_noise: whether the noise is known, and not an estimate.
    """

    name: str
    robot: str
    kind: str
    secrets: tuple[Secret, ...]
    noise: tuple[float, ...]
    known: tuple[float, ...]
    exact_noise: bool = True

    @property
    def severity(self) -> float | None:
        """Severity of its effects; None where nothing is hidden."""
        return max((s.severity for s in self.secrets), default=None)

    @property
    def clarity(self) -> float | None:
        """Severity over what the baseline leaves without the effects, not over the noise; None where nothing is hidden.

        Of the least clear effect; one of the whole robot is held against all joints' mean.
        """
        share = np.array(self.noise) / np.array(self.known)
        mean = float(np.sqrt(np.mean(share**2)))
        return min((s.severity * (float(share[s.joints[0]]) if s.joints else mean) for s in self.secrets), default=None)

    @property
    def margin(self) -> float | None:
        """Least margin of its effects; None where none is known."""
        return min((s.margin for s in self.secrets if s.margin is not None), default=None)

    @property
    def told_apart(self) -> bool:
        """Whether the logs tell every effect that it hides from its rivals, as far as that is known."""
        return self.margin is None or self.margin >= SURE


@dataclass(frozen=True)
class Name:
    """One finding: effect, joints, names not told from it, figures, stated p-value (None where none is stated)."""

    effect: str
    joints: Joints
    alternatives: tuple[str, ...] = ()
    parameters: Mapping[str, float] | None = None
    p_value: float | None = None

    def means(self, secret: Secret) -> bool:
        """Whether it is a secret's name on its joints."""
        return self.effect == secret.effect and self.joints == secret.joints

    def allows(self, secret: Secret) -> bool:
        """Whether a secret's name is this one or among the alternatives, on its joints."""
        return self.joints == secret.joints and secret.effect in (self.effect, *self.alternatives)


@dataclass(frozen=True)
class Answer:
    """What a method says of a case.

    Attributes:
        findings: names, those that explain most first.
        unexplained: joints of which it says that something is there and gives no name.
        before, after: RMS errors (n,) on the test logs, of the model before and with what was found.
        seconds: what it took.
        settled: whether the true name stood alone once a log of the motion proposed was added; None where none was.
        least_p_value: of the best candidate of all joints, whether or not it was named; None where none is stated.
    """

    findings: tuple[Name, ...]
    unexplained: tuple[Joints, ...] = ()
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()
    seconds: float = 0.0
    settled: bool | None = None
    least_p_value: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON-like values."""
        return asdict(self)

    @staticmethod
    def of(values: Mapping[str, Any]) -> Answer:
        """Read what `to_dict` gave."""
        names = tuple(
            Name(f["effect"], tuple(f["joints"]), tuple(f["alternatives"]), f["parameters"], f["p_value"])
            for f in values["findings"]
        )
        unexplained = tuple(tuple(joints) for joints in values["unexplained"])
        before, after = (tuple(_number(x) for x in values[key]) for key in ("before", "after"))
        least = values.get("least_p_value")
        return Answer(names, unexplained, before, after, values["seconds"], values.get("settled"), least)


def _number(value: float | None) -> float:
    """JSON has no NaN: it was written as null."""
    return math.nan if value is None else value


def truth_of(case: Case, made: Made, kind: str, name: str, known: FloatArray, told: Sequence[Told]) -> Truth:
    """Return what a case of the virtual robot hides.

    Args:
        case: the case.
        made: its logs.
        kind: the set that it belongs to.
        name: its name, unique in a run.
        known: the error (n,) with its laws known.
        told: what the logs tell of each hidden effect.
    """
    secrets = tuple(
        Secret(
            h.effect,
            () if h.joint is None else (h.joint,),
            h.severity,
            plain_figures(figures),
            of.margin,
            plain_figures(of.nearest),
        )
        for h, figures, of in zip(case.hidden, made.parameters, told, strict=True)
    )
    return Truth(name, case.robot, kind, secrets, tuple(made.noise.tolist()), tuple(known.tolist()))


def truth_from(values: Mapping[str, Any]) -> Truth:
    """Read the truth that ``dataclasses.asdict`` wrote."""
    secrets = tuple(
        Secret(s["effect"], tuple(s["joints"]), s["severity"], s["parameters"], s.get("margin"), s.get("nearest", {}))
        for s in values["secrets"]
    )
    return Truth(
        values["name"], values["robot"], values["kind"], secrets, tuple(values["noise"]), tuple(values["known"]),
        values["exact_noise"],
    )  # fmt: skip


def answer_of(report: GapReport, seconds: float) -> Answer:
    """Return what the gap workflow's report says."""
    names = tuple(
        Name(f.effect, tuple(f.joints), tuple(f.alternatives), plain_figures(f.parameters), float(f.p_value))
        for f in report.findings
    )
    unexplained = tuple(tuple(u.joints) for u in report.unexplained)
    shown = report.evidence
    before, after = ((), ()) if shown is None else (shown.before.tolist(), shown.after.tolist())
    least = float(report.p_values.min())
    return Answer(names, unexplained, tuple(before), tuple(after), seconds, least_p_value=least)


def plain_figures(parameters: Mapping[str, Any]) -> dict[str, float]:
    """Return the scalar figures among a finding's parameters."""
    return {key: float(value) for key, value in parameters.items() if np.ndim(value) == 0}
