"""Figures of merit of answers about hidden effects: what the issue's table asks for, with intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from comparisons.hidden_effects.answer import Answer, Name, Secret, Truth
from comparisons.hidden_effects.rates import Score

MAIN = {
    "payload": "mass",
    "base-tilt": "roll",
    "rotor-inertia": "inertia",
    "cable-spring": "stiffness",
    "elasticity": "stiffness",
    "coulomb": "force",
    "viscous": "damping",
    "coulomb-asymmetry": "force",
    "stribeck": "force",
    "sigmoid": "force",
    "viscous-nonlinear": "force",
    "load-friction": "force",
    "thermal-friction": "share",
    "maxwell-slip": "force",
    "cross-joint-hysteresis": "force",
    "cross-joint-friction": "force",
    "backlash": "gap",
    "gear-ripple": "force",
    "cogging": "force",
    "drive-gain": "scale",
    "torque-saturation": "share",
    "current-offset": "offset",
    "sensor-drift": "per_hour",
    "delay": "seconds",
    "filter-lag": "hertz",
}
"""Main parameter of each effect that has one. Of a drive's gain it is how far the scale is from one."""

LEVELS = (1e-5, 1e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3)
"""Stated p-values at which they are held against observed rates."""


@dataclass(frozen=True)
class Judged:
    """One case and what a method said of it; an answer of None is a method that broke down, and is wrong."""

    truth: Truth
    answer: Answer | None

    @property
    def findings(self) -> tuple[Name, ...]:
        """The names that were given."""
        return () if self.answer is None else self.answer.findings

    @property
    def first(self) -> Name | None:
        """The first name."""
        return self.findings[0] if self.findings else None

    @property
    def name_right(self) -> bool:
        """Whether the first name is a hidden effect's, wherever it is said to be."""
        return self.first is not None and any(self.first.effect == s.effect for s in self.truth.secrets)

    @property
    def among(self) -> bool:
        """Whether a hidden effect's name is the first name or among its alternatives."""
        one = self.first
        return one is not None and any(s.effect in (one.effect, *one.alternatives) for s in self.truth.secrets)

    @property
    def joint_right(self) -> bool:
        """Whether the first finding, or without one the first that is unexplained, is on a hidden effect's joint."""
        unexplained = () if self.answer is None else self.answer.unexplained
        said = self.first.joints if self.first is not None else unexplained[0] if unexplained else None
        return any(said == s.joints for s in self.truth.secrets)

    @property
    def silent(self) -> bool:
        """Whether no name is given, and the hidden effect's joint is said to be unexplained."""
        unexplained = () if self.answer is None else self.answer.unexplained
        joints = {joint for some in unexplained for joint in some}
        return self.answer is not None and not self.findings and any(joints >= {*s.joints} for s in self.truth.secrets)

    @property
    def named(self) -> bool:
        """Whether any name is given."""
        return bool(self.findings)

    @property
    def counts(self) -> tuple[int, int, int]:
        """Hidden effects that are named on their joints, names too many, hidden effects that are missed."""
        left = list(self.truth.secrets)
        for name in self.findings:
            hit = next((s for s in left if name.means(s)), None)
            if hit is not None:
                left.remove(hit)
        found = len(self.truth.secrets) - len(left)
        return found, len(self.findings) - found, len(left)

    @property
    def error_ratio(self) -> float:
        """RMS test error on the joints where something is hidden, over that of a model that knows every law.

        All joints where an effect of the whole robot or nothing is hidden; NaN without test errors.
        """
        return self._ratio(self._touched or set(range(len(self.truth.noise))), self.truth.known)

    @property
    def noise_ratio(self) -> float:
        """The same over the noise alone, which no fitted model reaches."""
        return self._ratio(self._touched or set(range(len(self.truth.noise))), self.truth.noise)

    @property
    def _touched(self) -> set[int]:
        """Joints on which something is hidden."""
        whole = any(not s.joints for s in self.truth.secrets)
        return set(range(len(self.truth.noise))) if whole else {j for s in self.truth.secrets for j in s.joints}

    def _ratio(self, joints: set[int], least: Sequence[float]) -> float:
        if self.answer is None or not self.answer.after or not joints:
            return math.nan
        ratios = np.array([self.answer.after[j] / least[j] for j in sorted(joints)])
        return float(np.sqrt(np.mean(ratios**2)))

    @property
    def parameter_errors(self) -> list[float]:
        """Relative errors of the main parameters of the hidden effects that are named on their joints."""
        return [parameter_error(name, s.effect, s.parameters) for name, s in self._right]

    @property
    def distances(self) -> list[float]:
        """The same from the catalogue's law that is nearest to what is hidden, of those laws that have a true one."""
        return [
            parameter_error(name, s.effect, s.nearest)
            for name, s in self._right
            if not math.isnan(parameter_error(name, s.effect, s.parameters))
        ]

    @property
    def _right(self) -> list[tuple[Name, Secret]]:
        """The names that mean a hidden effect, beside it."""
        return [(name, s) for s in self.truth.secrets for name in self.findings if name.means(s)]


def parameter_error(name: Name, effect: str, truth: Mapping[str, float]) -> float:
    """Return the relative error of an effect's main parameter; NaN where the truth or the finding has none."""
    key = MAIN.get(effect, "")
    found, true = (name.parameters or {}).get(key), truth.get(key)
    if found is None or true is None:
        return math.nan
    unit = 1.0 if key == "scale" else 0.0
    return abs(found - true) / abs(true - unit) if true != unit else math.nan


SINGLE = ("single", "changed")

TIES = "a tie broken by the proposed experiment"

FIGURES: Mapping[str, tuple[tuple[str, ...], Callable[[Sequence[Judged]], Score]]] = {
    "first name right": (SINGLE, lambda js: Score.share(j.name_right for j in js)),
    "true name in name + alternatives": (SINGLE, lambda js: Score.share(j.among for j in js)),
    "joint right": (SINGLE, lambda js: Score.share(j.joint_right for j in js)),
    "no name too many": (SINGLE, lambda js: Score.share(j.answer is not None and j.counts[1] == 0 for j in js)),
    "a name, where nothing is hidden": (("nothing",), lambda js: Score.share(j.named or j.answer is None for j in js)),
    "silence on effects outside the catalogue": (("foreign",), lambda js: Score.share(j.silent for j in js)),
    "test RMSE over that with the law known": (SINGLE, lambda js: Score.median(j.error_ratio for j in js)),
    "test RMSE over the noise": (SINGLE, lambda js: Score.median(j.noise_ratio for j in js)),
    "main parameter's error": (SINGLE, lambda js: Score.median(e for j in js for e in j.parameter_errors)),
    "the same from the catalogue's law nearest to what is hidden": (
        SINGLE,
        lambda js: Score.median(e for j in js for e in j.distances),
    ),
    TIES: ((*SINGLE, "tie"), lambda js: Score.share(_settled(js))),
    "F1, two effects": (("pair",), lambda js: Score.f1([j.counts for j in js])),
    "F1, three effects": (("triple",), lambda js: Score.f1([j.counts for j in js])),
    "effect added to a measured log: named": (("added",), lambda js: Score.share(_hit(j) for j in js)),
    "term deleted from a measured log's model: named": (
        ("deleted",),
        lambda js: Score.share(_hit(j) for j in js),
    ),
}
"""Rows of the table: which sets of cases each is taken of, and how."""


def table(judged: Sequence[Judged]) -> dict[str, Score]:
    """Return every figure of one method over cases, those of no case left out."""
    chosen = {row: [j for j in judged if j.truth.kind in kinds] for row, (kinds, _) in FIGURES.items()}
    return {row: FIGURES[row][1](cases) for row, cases in chosen.items() if cases}


def curves(judged: Sequence[Judged]) -> dict[str, dict[float, Score]]:
    """Return every figure of the table by severity; cases in which nothing is hidden are in none."""
    severities = sorted({j.truth.severity for j in judged if j.truth.severity is not None})
    found: dict[str, dict[float, Score]] = {}
    for severity in severities:
        for row, score in table([j for j in judged if j.truth.severity == severity]).items():
            found.setdefault(row, {})[severity] = score
    return found


def calibration(judged: Sequence[Judged], levels: Sequence[float] = LEVELS) -> dict[str, dict[float, Score]]:
    """Hold stated p-values against what happened.

    Returns:
        By level p: ``candidates``, the share of cases without a hidden effect in which the best candidate of all joints
        has that p or less, named or not, and ``nothing hidden``, in which a name is given at it: neither should exceed
        p; ``names``, the share of all names stated at that p or less (and above the level
        below) that are neither right nor right among their alternatives.
    """
    nothing = [j for j in judged if j.truth.kind == "nothing" and j.answer is not None]
    stated = [
        (name.p_value, not any(name.allows(s) for s in j.truth.secrets))
        for j in judged
        for name in j.findings
        if name.p_value is not None and j.truth.exact_noise
    ]
    smallest = [min((n.p_value for n in j.findings if n.p_value is not None), default=1.0) for j in nothing]
    best = [j.answer.least_p_value for j in nothing if j.answer is not None and j.answer.least_p_value is not None]
    found: dict[str, dict[float, Score]] = {"candidates": {}, "nothing hidden": {}, "names": {}}
    below = -1.0
    for level in levels:
        found["candidates"][level] = Score.share(p <= level for p in best)
        found["nothing hidden"][level] = Score.share(p <= level for p in smallest)
        found["names"][level] = Score.share(wrong for p, wrong in stated if below < p <= level)
        below = level
    return found


def confusion(judged: Sequence[Judged]) -> dict[str, dict[str, int]]:
    """Count first names by hidden effect, over cases that hide one or none; without a name: unexplained or silent."""
    found: dict[str, dict[str, int]] = {}
    for j in judged:
        if len(j.truth.secrets) > 1 or not j.truth.exact_noise:
            continue
        true = j.truth.secrets[0].effect if j.truth.secrets else "nothing"
        said = j.first.effect if j.first is not None else _wordless(j.answer)
        row = found.setdefault(true, {})
        row[said] = row.get(said, 0) + 1
    return found


def _wordless(answer: Answer | None) -> str:
    if answer is None:
        return "broke down"
    return "unexplained" if answer.unexplained else "silent"


def _hit(j: Judged) -> bool:
    """Whether the hidden effect is named, or among alternatives, on its joint: a measured log may hold others too."""
    return any(name.allows(s) for s in j.truth.secrets for name in j.findings)


def _settled(judged: Sequence[Judged]) -> list[bool]:
    """Of each case in which a motion was proposed to settle a name, whether it did."""
    return [j.answer.settled for j in judged if j.answer is not None and j.answer.settled is not None]
