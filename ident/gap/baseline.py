"""The simulation that measurement is held against: links, rotors, Coulomb and viscous friction, offset."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import BoolArray
from ident.effects.friction import Coulomb, VelocityEffect
from ident.fit import Drives, fit
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.gap.rests import Rests, rests_of
from ident.gap.rows import gap_of, panel_of, survey_of
from ident.identification import identify
from ident.log import LogSource
from ident.model import CurrentModel
from ident.robot import Robot

EFFECTS = ("coulomb", "viscous", "current-offset", "rotor-inertia")
"""What every joint of the baseline has besides its links."""

SMOOTHINGS = np.geomspace(3e-4, 1e-2, 12)
"""Speeds [rad/s or m/s] over which the sign of velocity may turn; beyond, it is an effect of its own (sigmoid)."""

STEP = 0.7
"""What the cut-off is multiplied by, again and again, while the model predicts better with it."""

WORTH = 0.05
"""Share by which a step must lower a joint's mean squared error: short logs that repeat a motion flatter filters."""

ROWS_KEPT = 0.95
"""Share of the rows that a lower cut-off must leave: a filter needs more of a segment, the lower it is."""

HIGHEST = 0.4
"""Cut-off at most, times the sampling rate."""


def baseline_model(
    robot: Robot,
    train: Sequence[LogSource],
    cutoff: float | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> CurrentModel:
    """Identify the model that a robotics engineer would start from, with the smoothing that the logs ask for.

    The cut-off and the source of velocities are those with which the model predicts rows held out best: the positions'
    spectrum alone does not tell how much their noise shakes inertial and dry friction forces.

    Args:
        robot: the robot.
        train: logs of free motion.
        cutoff: cut-off [Hz] of the derivatives' filter; chosen from the logs unless given.
        progress: told what is being done and the share of it that is done.
    """
    found = identify(robot, train, cutoff=cutoff, effects=EFFECTS, progress=progress)
    logged = any(block.dq is not None for source in train for block in itertools.islice(source.blocks(2), 1))
    first = panel_of(found.model, train)
    gaps = [gap_of(found.model, first, j) for j in range(robot.n)]
    rests = rests_of(found.model, first, survey_of(found.model, first), gaps)
    logs = _Logs(train, logged, rests)
    best = _best_velocities(found.model, logs)
    if cutoff is None:
        lower = _followed(best, STEP, logs)
        best = lower if lower is not best else _followed(best, 1.0 / STEP, logs)
    effects = [term.effect for term in best.model.terms]
    views = [best.model.view(source) for source in train]
    drives = Drives(best.model.gain, best.model.force_unit)
    fitted = fit(robot, effects, views, best.model.cutoff, drives, counts=rests.counts).model
    return replace(fitted, positions_only=best.model.positions_only)


@dataclass(frozen=True, eq=False)
class _Logs:
    """Logs, whether they have velocities, and which joints' rests are left out."""

    sources: Sequence[LogSource]
    logged: bool
    rests: Rests


@dataclass(frozen=True, eq=False)
class _Smoothed:
    """A model whose signs of velocity turn as the logs ask for, and its held-out error over all joints' rows.

    The error is the sum over joints of the logarithm of its mean square.
    """

    model: CurrentModel
    error: float
    rows: int


def _followed(best: _Smoothed, factor: float, logs: _Logs) -> _Smoothed:
    """The model with its cut-off multiplied by a factor for as long as it predicts better."""
    while (better := _better(best, factor, logs)) is not None:
        best = better
    return best


def _better(best: _Smoothed, factor: float, logs: _Logs) -> _Smoothed | None:
    """The model a step or two on, if it predicts that much better; None if it does not.

    Poses held out that links are hardly told from make errors jump: the step beyond a worse one may be the better.
    """
    for steps in (1, 2):
        cutoff = best.model.cutoff * factor**steps
        if cutoff >= HIGHEST * best.model.rate:
            break
        other = _best_velocities(replace(best.model, cutoff=cutoff), logs)
        if other.error <= best.error - steps * WORTH * best.model.n and other.rows >= ROWS_KEPT * best.rows:
            return other
    return None


def _best_velocities(model: CurrentModel, logs: _Logs) -> _Smoothed:
    """The model with velocities from positions or, where there are any, as logged: those may be the noisier."""
    tried = [_smoothed(replace(model, positions_only=False), logs)]
    if logs.logged:
        tried.append(_smoothed(replace(model, positions_only=True), logs))
    return min(tried, key=lambda one: one.error)


def _smoothed(model: CurrentModel, logs: _Logs) -> _Smoothed:
    panel = panel_of(model, logs.sources)
    counts = panel.gather(logs.rests.counts)
    found = [_smoothing(model, panel, counts[:, j], j) for j in range(model.n)]
    smoothing = [width for width, _ in found]
    terms = tuple(
        replace(term, effect=replace(term.effect, smoothing=smoothing[term.effect.at]))
        if isinstance(term.effect, VelocityEffect)
        else term
        for term in model.terms
    )
    return _Smoothed(replace(model, terms=terms), float(np.sum(np.log([error for _, error in found]))), len(panel))


def _smoothing(model: CurrentModel, panel: Panel, counts: BoolArray, joint: int) -> tuple[float, float]:
    """The smoothing that predicts all of a joint's rows best, fitted to those that count, whose held-out error follows.

    Rests that do not count still tell how well the sign is predicted as the joint creeps.
    """
    own = [t for t in model.terms if t.effect.joint in (None, joint)]
    friction = next((t.effect for t in own if isinstance(t.effect, Coulomb)), None)
    others = [panel.columns(t.effect, t.shape, joint) for t in own if not isinstance(t.effect, Coulomb)]
    rows = JointGap(joint, np.hstack(others), panel.force[:, joint], counts, ())
    tried = [(float(SMOOTHINGS[0]), rows)]
    if friction is not None:
        laws = [(width, replace(friction, smoothing=width)) for width in SMOOTHINGS.tolist()]
        columns = [(width, panel.columns(law, np.zeros(0), joint)) for width, law in laws]
        tried = [(width, replace(rows, matrix=np.hstack([rows.matrix, c]))) for width, c in columns]
    width, best = min(tried, key=lambda one: float(np.sum(one[1].everywhere(panel) ** 2)))
    problem = best.problem(panel)
    return width, max(problem.errors().total / len(problem), 1e-300)
