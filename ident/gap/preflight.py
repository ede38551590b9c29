"""Step 1, preflight: which effects these logs could not show, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.effects import load_catalogue
from ident.effects.base import Effect
from ident.effects.survey import Survey
from ident.gap.candidates import forms
from ident.gap.joint_gap import JointGap, speed_of
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.threads import in_threads

VISIBLE = 0.02
"""Share of an effect's own size that the baseline must leave, for the effect to be seen."""

REST, RESTS = 2e-3, 0.02
"""A joint slower than this [rad/s or m/s] stands; it is seen at rest if it stands in this share of the rows."""


@dataclass(frozen=True)
class Untestable:
    """An effect that these logs could not show, on joints (from 0; empty: the whole robot), and why."""

    effect: str
    joints: tuple[int, ...]
    reason: str


def untestable(
    panel: Panel, survey: Survey, gaps: Sequence[JointGap], problems: Sequence[JointProblem]
) -> list[Untestable]:
    """Effects of the catalogue that nothing in these rows could show."""
    found: dict[tuple[str, str], list[int]] = {}
    reasons = in_threads(lambda pair: _reasons(panel, survey, *pair), list(zip(gaps, problems, strict=True)))
    for gap, of_joint in zip(gaps, reasons, strict=True):
        for name, reason in of_joint.items():
            found.setdefault((name, reason), []).append(gap.joint)
    result = [
        Untestable(name, () if len(joints) == panel.robot.n else tuple(joints), reason)
        for (name, reason), joints in found.items()
    ]
    if gaps and gaps[0].refitted:
        absorbed = "links that are fitted anew absorb it: give --model of the robot without it"
        result += [Untestable(name, (), absorbed) for name in ("payload",) if name in load_catalogue()]
    return result


def _reasons(panel: Panel, survey: Survey, gap: JointGap, problem: JointProblem) -> dict[str, str]:
    """Why effects of a joint, by name, could not show."""
    named = _by_name(forms(survey, gap.joint, gap.present)).items()
    found = {name: _reason(panel, survey, gap, problem, effects) for name, effects in named}
    return {name: reason for name, reason in found.items() if reason is not None}


def _by_name(effects: Sequence[Effect]) -> dict[str, list[Effect]]:
    names: dict[str, list[Effect]] = {}
    for effect in effects:
        names.setdefault(effect.name, []).append(effect)
    return names


def _reason(
    panel: Panel, survey: Survey, gap: JointGap, problem: JointProblem, effects: Sequence[Effect]
) -> str | None:
    joint, name = gap.joint, effects[0].name
    speed = speed_of(panel, problem, joint)
    if np.quantile(speed, 0.99) < REST:
        return "the joint never moves"
    if name in ("coulomb-asymmetry", "maxwell-slip") and np.mean(speed < REST) < RESTS:
        if gap.sticks:
            return "the joint sticks: where it stands, dry friction holds any current"
        if np.mean(np.abs(panel.velocity[:, joint]) < REST) >= RESTS:
            return "its velocity is too noisy to tell rest from motion: log positions with less noise"
        return "the joint never stands still: add stops of a few seconds"
    if name in ("gear-ripple", "cogging"):
        fewest = float(effects[0].shapes[0].lower)
        hertz = fewest * np.quantile(speed, 0.2) / (2.0 * np.pi)
        if hertz > 0.5 * survey.rate:
            return f"sampled at {survey.rate:.0f} Hz, the ripple is above {hertz:.0f} Hz at most speeds: move slower"
    left = 0.0
    for effect in effects:
        shapes = np.array([s.starts[0] for s in effect.shapes], dtype=float)
        columns = panel.columns(effect, shapes, joint)[problem.keep]
        size = np.linalg.norm(columns, axis=0)
        if np.any(size > 0):
            left = max(
                left, float(np.max(np.linalg.norm(problem.away(columns), axis=0) / np.where(size > 0, size, np.inf)))
            )
    if left < VISIBLE:
        return "absorbed by what the joint has already: other motion, or --model of a former state, shows it"
    return None
