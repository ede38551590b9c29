"""The simulation that measurement is held against: links, rotors, Coulomb and viscous friction, offset."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from ident.cutoff import HIGHEST_SHARE
from ident.fit import fit
from ident.gap.presliding import built_anew, yielding
from ident.gap.rests import Rests, find_rests, rests_of
from ident.gap.rows import panel_of, survey_of
from ident.gap.smoothing import Smoothed, smoothed
from ident.log import LogSource
from ident.model import CurrentModel
from ident.robot import Robot
from ident.start import start_of

STEP = 0.7
"""What the cut-off is multiplied by, again and again, while the model predicts better with it."""

WORTH = 0.05
"""Share by which a step must lower joints' mean squared error: down, all joints' on average, as velocities from
positions must, for short logs that repeat a motion flatter filters; up, any joint's."""

ROWS_KEPT = 0.95
"""Share of the rows that a lower cut-off must leave: a filter needs more of a segment, the lower it is."""

ENDS = 2.0
"""Periods, at logs' ends, of the cut-off that the search begins with that tell nothing of it: there the filter leans
on what it takes for the positions before and after."""


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
    # The matrices are narrow: BLAS threads would only wait for one another.
    with threadpool_limits(1, "blas"):
        return _baseline(robot, train, cutoff, progress or (lambda what, share: None))


def _baseline(
    robot: Robot, train: Sequence[LogSource], cutoff: float | None, tell: Callable[[str, float], None]
) -> CurrentModel:
    begun = start_of(robot, train, cutoff)
    tell("fitting", 0.0)
    found = foreseen(begun.model(robot), train, cutoff is None)
    views = [found.model.view(source) for source in train]
    effects = [term.effect for term in found.model.terms]
    fitted = fit(robot, effects, views, found.model.cutoff, begun.drives, counts=found.rests.counts).model
    tell("fitting", 1.0)
    return replace(fitted, positions_only=found.model.positions_only)


@dataclass(frozen=True, eq=False)
class Foreseen:
    """A plain model with the signs of velocity, source of velocities and cut-off that predict logs best.

    Attributes:
        model: the model, whose parameters are those of the first cut-off still.
        rests: which joints stick.
    """

    model: CurrentModel
    rests: Rests


def foreseen(model: CurrentModel, train: Sequence[LogSource], choose: bool, yields: bool = True) -> Foreseen:
    """Let a plain model see logs as it predicts rows held out best.

    Args:
        model: links, rotors, offsets, Coulomb and viscous friction, fitted to the logs.
        train: the logs.
        choose: whether the cut-off is chosen, too.
        yields: whether friction may build up over a displacement.
    """
    model, rests = _directed(model, train) if yields else (model, find_rests(model, train))
    logged = any(block.dq is not None for source in train for block in itertools.islice(source.blocks(2), 1))
    logs = _Logs(train, logged, rests, ENDS / model.cutoff)
    best = _best_velocities(model, logs)
    if choose:
        lower = _followed(best, STEP, logs)
        best = lower if lower is not best else _followed(best, 1.0 / STEP, logs)
    return Foreseen(built_anew(best.model, train), rests)


def _directed(model: CurrentModel, train: Sequence[LogSource]) -> tuple[CurrentModel, Rests]:
    """The model with friction that builds up over a displacement where joints yield, and which joints stick then."""
    panel = panel_of(model, train)
    survey = survey_of(model, panel)
    rests = rests_of(model, panel, survey)
    found = yielding(model, panel, survey, rests)
    if found is model:
        return model, rests
    panel = panel.seen_by(found)
    return found, rests_of(found, panel, survey_of(found, panel))


@dataclass(frozen=True, eq=False)
class _Logs:
    """Logs, whether they have velocities, which joints' rests are left out, and how many seconds at their ends."""

    sources: Sequence[LogSource]
    logged: bool
    rests: Rests
    ends: float


def _followed(best: Smoothed, factor: float, logs: _Logs) -> Smoothed:
    """The model with its cut-off multiplied by a factor for as long as it predicts better."""
    while (better := _better(best, factor, logs)) is not None:
        best = better
    return best


def _better(best: Smoothed, factor: float, logs: _Logs) -> Smoothed | None:
    """The model a step or two on, if it predicts that much better; None if it does not.

    Poses held out that links are hardly told from make errors jump: the step beyond a worse one may be the better.
    """
    for steps in (1, 2):
        cutoff = best.model.cutoff * factor**steps
        if cutoff >= HIGHEST_SHARE * best.model.rate:
            break
        other = _best_velocities(replace(best.model, cutoff=cutoff), logs)
        least = steps * WORTH * (best.model.n if factor < 1.0 else 1)
        if other.error <= best.error - least and other.rows >= ROWS_KEPT * best.rows:
            return other
    return None


def _best_velocities(model: CurrentModel, logs: _Logs) -> Smoothed:
    """The model with velocities as logged or, where it predicts that much better with them, from positions."""
    best = smoothed(replace(model, positions_only=False), logs.sources, logs.rests, logs.ends)
    if not logs.logged:
        return best
    other = smoothed(replace(model, positions_only=True), logs.sources, logs.rests, logs.ends)
    return other if other.error <= best.error - WORTH * model.n else best
