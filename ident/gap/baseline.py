"""The simulation that measurement is held against: links, rotors, Coulomb and viscous friction, offset."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.effects.friction import Coulomb, VelocityEffect
from ident.fit import Drives, fit
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.rows import panel_of
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
    best = _best_velocities(found.model, train, logged)
    if cutoff is None:
        lower = _followed(best, STEP, train, logged)
        best = lower if lower is not best else _followed(best, 1.0 / STEP, train, logged)
    effects = [term.effect for term in best.model.terms]
    views = [best.model.view(source) for source in train]
    fitted = fit(robot, effects, views, best.model.cutoff, Drives(best.model.gain, best.model.force_unit)).model
    return replace(fitted, positions_only=best.model.positions_only)


@dataclass(frozen=True, eq=False)
class _Smoothed:
    """A model whose signs of velocity turn as the logs ask for, and its held-out error over all joints' rows.

    The error is the sum over joints of the logarithm of its mean square.
    """

    model: CurrentModel
    error: float
    rows: int


def _followed(best: _Smoothed, factor: float, train: Sequence[LogSource], logged: bool) -> _Smoothed:
    """The model with its cut-off multiplied by a factor for as long as it predicts better."""
    while (better := _better(best, factor, train, logged)) is not None:
        best = better
    return best


def _better(best: _Smoothed, factor: float, train: Sequence[LogSource], logged: bool) -> _Smoothed | None:
    """The model a step or two on, if it predicts that much better; None if it does not.

    Poses held out that links are hardly told from make errors jump: the step beyond a worse one may be the better.
    """
    for steps in (1, 2):
        cutoff = best.model.cutoff * factor**steps
        if cutoff >= HIGHEST * best.model.rate:
            break
        other = _best_velocities(replace(best.model, cutoff=cutoff), train, logged)
        if other.error <= best.error - steps * WORTH * best.model.n and other.rows >= ROWS_KEPT * best.rows:
            return other
    return None


def _best_velocities(model: CurrentModel, train: Sequence[LogSource], logged: bool) -> _Smoothed:
    """The model with velocities from positions or, where there are any, as logged: those may be the noisier."""
    tried = [_smoothed(replace(model, positions_only=False), train)]
    if logged:
        tried.append(_smoothed(replace(model, positions_only=True), train))
    return min(tried, key=lambda one: one.error)


def _smoothed(model: CurrentModel, train: Sequence[LogSource]) -> _Smoothed:
    panel = panel_of(model, train)
    found = [_smoothing(model, panel, j) for j in range(model.n)]
    smoothing = [width for width, _ in found]
    terms = tuple(
        replace(term, effect=replace(term.effect, smoothing=smoothing[term.effect.at]))
        if isinstance(term.effect, VelocityEffect)
        else term
        for term in model.terms
    )
    return _Smoothed(replace(model, terms=terms), float(np.sum(np.log([error for _, error in found]))), len(panel))


def _smoothing(model: CurrentModel, panel: Panel, joint: int) -> tuple[float, float]:
    """The smoothing with which a joint's rows are fitted best, and the mean squared held-out error with it."""
    own = [t for t in model.terms if t.effect.joint in (None, joint)]
    friction = next((t.effect for t in own if isinstance(t.effect, Coulomb)), None)
    others = [panel.columns(t.effect, t.shape, joint) for t in own if not isinstance(t.effect, Coulomb)]
    everything = np.ones(len(panel), dtype=bool)
    problem = JointProblem(np.hstack(others), panel.force[:, joint], panel.fold, everything)
    width, columns = float(SMOOTHINGS[0]), None
    if friction is not None:
        tried = [panel.columns(replace(friction, smoothing=s), np.zeros(0), joint) for s in SMOOTHINGS]
        best = int(np.argmax([problem.drop(c) for c in tried]))
        width, columns = float(SMOOTHINGS[best]), tried[best]
    return width, max(problem.errors(columns).total / len(panel), 1e-300)
