"""What an identification starts from: a cut-off, drive gains, and the effects that every joint has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ident.arrays import FloatArray
from ident.base_parameters import rotor_shows
from ident.cautions import still_joints
from ident.design import Design
from ident.drive_gain import GainEstimate, gains_from_payload, shared_gains
from ident.effects.base import Effect, initial_term
from ident.effects.direction import SMOOTHING
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import Links, RotorInertia
from ident.errors import InputError
from ident.fit import Drives, solved_model
from ident.least_squares import factorise, solve
from ident.log import JointLog, LogSource, concatenate
from ident.log_set import check_together, path_of
from ident.model import NEWTON_METRE, CurrentModel
from ident.payload import Payload
from ident.robot import Robot
from ident.signals import CutoffChoice, choose_cutoff, derivative_noise
from ident.walk import Block, collect, slowest_rate

Gains = Literal["known", "shared", "per-joint", "payload"]

CUTOFF_ROWS = 100_000
"""Rows of each log from which the cut-off is chosen."""


SAME_RATE = 1.2
"""Times the lowest of the logs' sampling rates that is still the same."""


@dataclass(frozen=True, eq=False)
class PayloadLogs:
    """Logs of the robot carrying a known payload, which fix the scale of its drive gains.

    Attributes:
        payload: mass, centre of mass and the frame that carries it.
        logs: of motion with it.
    """

    payload: Payload
    logs: Sequence[LogSource]


@dataclass(frozen=True, eq=False)
class Start:
    """What an identification starts from.

    Attributes:
        cutoff: cut-off of the derivatives' filter and why.
        held: rows of the logs held in memory.
        still: joints, from 0, that never move.
        gains: how drive gains are treated.
        gain_estimate: gains with intervals, where they are estimated.
        drives: force unit per unit of current.
        effects: links, and for every joint its rotor and offset, with Coulomb and viscous friction where it moves.
    """

    cutoff: CutoffChoice
    held: Sequence[Block]
    still: Sequence[int]
    gains: Gains
    gain_estimate: GainEstimate | None
    drives: Drives
    effects: Sequence[Effect]

    @property
    def friction(self) -> dict[int, Coulomb]:
        """Dry friction of each joint, from 0, that moves."""
        return {effect.at: effect for effect in self.effects if isinstance(effect, Coulomb)}

    def model(self, robot: Robot) -> CurrentModel:
        """A robot's model with these effects, fitted to the rows held, without standard deviations."""
        design = Design(robot, tuple(initial_term(effect) for effect in self.effects), self.drives.gain)
        solution = solve(design, factorise(design, design.rows(self.held)))
        return solved_model(design, solution, self.drives, self.cutoff.hertz, slowest_rate(self.held))


def start_of(
    robot: Robot,
    train: Sequence[LogSource],
    cutoff: float | None = None,
    gains: Gains | None = None,
    loaded: PayloadLogs | None = None,
) -> Start:
    """Settle what an identification starts from; arguments and errors are those of ``identify``.

    Args:
        robot: the robot.
        train: logs of free motion.
        cutoff: cut-off [Hz]; chosen from the logs unless given.
        gains: how drive gains are treated; by what is known unless given.
        loaded: logs with a known payload.
    """
    if not train:
        raise InputError("no log to identify from", "--train", "give at least one log")
    check_together(train)
    if cutoff is not None and not cutoff > 0.0:
        raise InputError(f"cut-off of {cutoff:g} Hz", "--cutoff", "give one between 0 and half the sampling rate")
    chosen = CutoffChoice(cutoff, "given") if cutoff is not None else _choose_cutoff(train)
    held = collect(train, chosen.hertz)
    if not any(block.keep.any() for block in held):
        where = ", ".join(path_of(source) for source in train)
        raise InputError(f"too short for a cut-off of {chosen.hertz:.3g} Hz", where, "give longer logs")
    still = still_joints(held)
    gains = gains or ("payload" if loaded is not None else "known" if robot.gain is not None else "per-joint")
    drives, estimate = _drives(robot, gains, train, loaded, chosen.hertz)
    effects = _effects(robot, gains, _smoothing(held, chosen.hertz), still)
    return Start(chosen, held, still, gains, estimate, drives, effects)


def _choose_cutoff(sources: Sequence[LogSource]) -> CutoffChoice:
    heads: list[JointLog] = []
    for source in sources:
        rows = 0
        for block in source.blocks(CUTOFF_ROWS):
            heads.append(block)
            rows += len(block)
            if rows >= CUTOFF_ROWS:
                break
    if max(map(len, heads), default=0) < 2:
        raise InputError("fewer than two rows", ", ".join(s.name for s in sources), "give longer logs")
    # Logs that were sampled faster than others can do with their cut-off.
    rates = [head.rate if len(head) > 1 else np.inf for head in heads]
    slow = [head for head, rate in zip(heads, rates, strict=True) if rate < SAME_RATE * min(rates)]
    return choose_cutoff(concatenate(slow))


def _drives(
    robot: Robot, gains: Gains, train: Sequence[LogSource], loaded: PayloadLogs | None, cutoff: float
) -> tuple[Drives, GainEstimate | None]:
    if gains == "known":
        if robot.gain is None:
            raise InputError("the drive gains are not known", robot.name, "set [drive] gain, or leave --gains out")
        return Drives(robot.gain, NEWTON_METRE), None
    if gains == "payload":
        if loaded is None:
            raise InputError("no logs with a payload", "--gains payload", "give --payload-train and --payload-mass")
        estimate = gains_from_payload(robot, train, loaded.logs, loaded.payload, cutoff, nominal=robot.gain)
        return Drives(estimate.value, NEWTON_METRE), estimate
    if gains == "shared":
        estimate = shared_gains(robot, train, cutoff)
        return Drives(estimate.value, f"relative {NEWTON_METRE}"), estimate
    return Drives(np.ones(robot.n), robot.unit), None


def _effects(robot: Robot, gains: Gains, smoothing: FloatArray, still: Sequence[int]) -> list[Effect]:
    """Links, and for every joint its rotor and offset, with Coulomb and viscous friction where it moves."""
    effects: list[Effect] = [Links(j) for j in range(robot.n)] if gains == "per-joint" else [Links(None)]
    for j in range(robot.n):
        effects.append(CurrentOffset(j))
        if j not in still:
            # A row with link parameters of its own may have the rotor in them.
            apart = gains != "per-joint" or rotor_shows(robot.rigid_body, j)
            effects += [RotorInertia(j)] if apart else []
            effects += [Coulomb(j, smoothing[j]), Viscous(j, smoothing[j])]
    return effects


def _smoothing(held: Sequence[Block], cutoff: float) -> FloatArray:
    """Speed (n,) over which each joint's sign of velocity turns: three standard deviations of the velocity's noise.

    What the filter took from the position is taken for white noise; its derivative below the cut-off follows.
    """
    removed = np.concatenate([block.removed[block.keep] for block in held])
    noise = derivative_noise(removed.std(axis=0), cutoff, slowest_rate(held))
    return np.asarray(np.clip(3.0 * noise, 0.1 * SMOOTHING, SMOOTHING))
