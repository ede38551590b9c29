"""The simulation that measurement is held against: links, rotors, Coulomb and viscous friction, offset."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Effect
from ident.effects.friction import Coulomb, VelocityEffect
from ident.fit import Drives, fit
from ident.gap.panel import JointProblem, Panel
from ident.gap.rows import panel_of
from ident.identification import identify
from ident.log import LogSource
from ident.model import CurrentModel
from ident.robot import Robot

EFFECTS = ("coulomb", "viscous", "current-offset", "rotor-inertia")
"""What every joint of the baseline has besides its links."""

SMOOTHINGS = np.geomspace(3e-4, 1e-2, 12)
"""Speeds [rad/s or m/s] over which the sign of velocity may turn; beyond, it is an effect of its own (sigmoid)."""


def baseline_model(
    robot: Robot,
    train: Sequence[LogSource],
    cutoff: float | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> CurrentModel:
    """Identify the model that a robotics engineer would start from, with the smoothing that the logs ask for.

    Args:
        robot: the robot.
        train: logs of free motion.
        cutoff: cut-off [Hz] of the derivatives' filter; chosen from the logs unless given.
        progress: told what is being done and the share of it that is done.
    """
    found = identify(robot, train, cutoff=cutoff, effects=EFFECTS, progress=progress)
    model = found.model
    panel = panel_of(model, train)
    smoothing = np.array([_smoothing(model, panel, j) for j in range(robot.n)])
    effects = [_smoothed(term.effect, smoothing) for term in model.terms]
    return fit(robot, effects, train, model.cutoff, Drives(model.gain, model.force_unit)).model


def _smoothed(effect: Effect, smoothing: FloatArray) -> Effect:
    if isinstance(effect, VelocityEffect):
        return replace(effect, smoothing=float(smoothing[effect.at]))
    return effect


def _smoothing(model: CurrentModel, panel: Panel, joint: int) -> float:
    """The smoothing with which a joint's rows are fitted best."""
    own = [t for t in model.terms if t.effect.joint in (None, joint)]
    friction = next((t.effect for t in own if isinstance(t.effect, Coulomb)), None)
    if friction is None:
        return float(SMOOTHINGS[0])
    others = [panel.columns(t.effect, t.shape, joint) for t in own if not isinstance(t.effect, Coulomb)]
    everything = np.ones(len(panel), dtype=bool)
    problem = JointProblem(np.hstack(others), panel.force[:, joint], panel.fold, everything)
    drops = [problem.drop(panel.columns(replace(friction, smoothing=s), np.zeros(0), joint)) for s in SMOOTHINGS]
    return float(SMOOTHINGS[int(np.argmax(drops))])
