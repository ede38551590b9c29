"""From a robot and logs to an identified, explained current model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from ident.arrays import FloatArray
from ident.base_parameters import rotor_shows
from ident.cautions import gain_warnings, sign_warnings, still_joints, still_warnings
from ident.drive_gain import GainEstimate, gains_from_payload, shared_gains
from ident.effects import load_catalogue
from ident.effects.base import Effect
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import SMOOTHING, Coulomb, VelocityEffect, Viscous
from ident.effects.rigid_body import Links, RotorInertia
from ident.effects.transmission import CrossJointFriction
from ident.errors import InputError
from ident.feasible import Feasible, SolverFailure, feasible_parameters
from ident.fit import Drives, Fit, fit
from ident.log import JointLog, LogSource, concatenate
from ident.model import NEWTON_METRE, CurrentModel
from ident.model_file import save_model
from ident.parameters import Parameter, list_parameters
from ident.payload import Payload
from ident.robot import Robot
from ident.signals import CutoffChoice, choose_cutoff, derivative_noise
from ident.structure import Structure, choose_structure, coupled
from ident.urdf_export import write_urdf
from ident.walk import Block, collect

Gains = Literal["known", "shared", "per-joint", "payload"]
Progress = Callable[[str, float], None]

CUTOFF_ROWS = 100_000
"""Rows of each log from which the cut-off is chosen."""


URDF = "identified.urdf"


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
class Identification:
    """What was identified from a robot's logs.

    Attributes:
        model: the current model.
        fit: the regression behind it.
        gains: how drive gains were treated.
        gain_estimate: gains with intervals, where they were estimated.
        cutoff: cut-off of the derivatives' filter and why.
        structure: which effects each joint got and what was tried; None where the caller named the effects.
        feasible: the nearest physically feasible parameters; None where there is no one body behind the rows.
        warnings: what the user should look at, in sentences.
    """

    model: CurrentModel
    fit: Fit
    gains: Gains
    gain_estimate: GainEstimate | None
    cutoff: CutoffChoice
    structure: Structure | None
    feasible: Feasible | None
    warnings: tuple[str, ...]

    @property
    def parameters(self) -> list[Parameter]:
        """Every parameter with its interval."""
        return list_parameters(self.fit)

    def write(self, folder: Path) -> None:
        """Write the model, and the identified URDF where one body stands behind the rows."""
        save_model(self.model, folder)
        robot = self.model.robot
        if self.feasible is not None and robot.urdf is not None:
            write_urdf(robot.urdf, robot.joints, self.feasible.preferred.parameters, folder / URDF)

    def result(self) -> dict[str, Any]:
        """Figures of the fit as result.json holds them (those of the logs are the caller's)."""
        return {
            "joints": list(self.model.robot.joints),
            "unit": self.model.unit,
            "force_unit": self.model.force_unit,
            "gains": self.gains,
            "gain": self.model.gain.tolist(),
            "cutoff_hertz": self.cutoff.hertz,
            "condition_number": self.fit.solution.condition_number,
            "parameters": [parameter.as_dict() for parameter in self.parameters],
            "effects": {
                str(j + 1): [t.effect.name for t in self.model.terms if t.effect.joint == j]
                for j in range(self.model.n)
            },
            "warnings": list(self.warnings),
            **({"gain_interval": _gain_intervals(self.gain_estimate)} if self.gain_estimate is not None else {}),
            **({"feasible": _feasible_result(self.feasible)} if self.feasible is not None else {}),
        }


def identify(
    robot: Robot,
    train: Sequence[LogSource],
    *,
    cutoff: float | None = None,
    gains: Gains | None = None,
    effects: Sequence[str] | None = None,
    robust: bool = False,
    loaded: PayloadLogs | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify a robot's current model from logs of free motion.

    Args:
        robot: the robot.
        train: logs, the robot touching nothing.
        cutoff: cut-off [Hz] of the filter that derives velocity and acceleration; chosen from the logs unless given.
        gains: ``known``: as the card says; ``shared``: relative gains are estimated together with links that all
            joints share; ``per-joint``: every joint's row has link parameters of its own, in units of its current;
            ``payload``: from the same motion without (``train``) and with a known payload (``loaded``). By default
            payload where such logs are given, known where the card knows them, else per joint.
        effects: names of the effects every joint gets besides links, rotor and offset; by default Coulomb and viscous
            friction and what predicts held-out logs better.
        robust: weight rows by Huber's function, against contacts and outliers.
        loaded: logs with a known payload; they serve the gains alone.
        progress: told what is being done and the share of it that is done.

    Raises:
        InputError: no log, a log too short, a name that is no effect, or gains that the card does not know.
    """
    if not train:
        raise InputError("no log to identify from", "--train", "give at least one log")
    # The matrices are narrow: BLAS threads would only wait for one another.
    with threadpool_limits(1, "blas"):
        return _identify(robot, train, cutoff, gains, effects, robust, loaded, progress)


def _identify(
    robot: Robot,
    train: Sequence[LogSource],
    cutoff: float | None,
    gains: Gains | None,
    effects: Sequence[str] | None,
    robust: bool,
    loaded: PayloadLogs | None,
    progress: Progress | None,
) -> Identification:
    tell = progress or (lambda what, share: None)
    chosen = CutoffChoice(cutoff, "given") if cutoff is not None else _choose_cutoff(train)
    held = collect(train, chosen.hertz)
    if not any(block.keep.any() for block in held):
        where = ", ".join(source.name for source in train)
        raise InputError(f"too short for a cut-off of {chosen.hertz:.3g} Hz", where, "give longer logs")
    still = still_joints(held)
    gains = gains or ("payload" if loaded is not None else "known" if robot.gain is not None else "per-joint")
    drives, estimate = _drives(robot, gains, train, loaded, chosen.hertz)
    smoothing = _smoothing(held, chosen.hertz)
    baseline = _baseline(robot, gains, smoothing, still)
    structure: Structure | None = None
    if effects is None:
        tell("choosing friction terms", 0.0)
        structure = choose_structure(
            robot, baseline, train, chosen.hertz, drives, lambda share: tell("choosing friction terms", share)
        )
        used: Sequence[Effect] = structure.effects
    else:
        used = _named(robot, gains, effects, smoothing, still)
    found = fit(robot, used, train, chosen.hertz, drives, robust, lambda share: tell("fitting", share))
    feasible, trouble = _feasible(robot, found, gains)
    warnings = [*sign_warnings(found.model, held), *still_warnings(robot, still), *gain_warnings(estimate), *trouble]
    return Identification(found.model, found, gains, estimate, chosen, structure, feasible, tuple(warnings))


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
    return choose_cutoff(concatenate(heads))


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


def _baseline(robot: Robot, gains: Gains, smoothing: FloatArray, still: Sequence[int]) -> list[Effect]:
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


def _named(
    robot: Robot, gains: Gains, names: Sequence[str], smoothing: FloatArray, still: Sequence[int]
) -> list[Effect]:
    """Every joint's effects by name, in place of Coulomb and viscous friction."""
    catalogue = load_catalogue()
    for name in names:
        if name not in catalogue:
            raise InputError(f"no effect is named {name!r}", "--effects", f"choose from {', '.join(sorted(catalogue))}")
    effects = [e for e in _baseline(robot, gains, smoothing, still) if not isinstance(e, VelocityEffect)]
    present = {effect.name for effect in effects}
    moving = [j for j in range(robot.n) if j not in still]
    for kind in [catalogue[name] for name in dict.fromkeys(names) if name not in present]:
        if kind is CrossJointFriction:
            effects += [CrossJointFriction(j, source) for j in moving for source in coupled(robot, j)]
        elif issubclass(kind, VelocityEffect):
            effects += [kind(j, smoothing[j]) for j in moving]
        else:
            effects += [kind(j) for j in moving]
    return effects


def _smoothing(held: Sequence[Block], cutoff: float) -> FloatArray:
    """Speed (n,) over which each joint's sign of velocity turns: three standard deviations of the velocity's noise.

    What the filter took from the position is taken for white noise; its derivative below the cut-off follows.
    """
    removed = np.concatenate([block.removed[block.keep] for block in held])
    noise = derivative_noise(removed.std(axis=0), cutoff, held[0].log.rate)
    return np.asarray(np.clip(3.0 * noise, 0.1 * SMOOTHING, SMOOTHING))


def _feasible(robot: Robot, found: Fit, gains: Gains) -> tuple[Feasible | None, list[str]]:
    if gains == "per-joint":
        return None, []
    prior = None if gains == "shared" else robot.multibody.parameters
    try:
        return feasible_parameters(found.design, found.factors, found.solution, prior), []
    except SolverFailure as failure:
        return None, [f"No physically feasible parameters were found: {failure}"]


def _gain_intervals(estimate: GainEstimate) -> list[dict[str, Any]]:
    ends = zip(estimate.low.tolist(), estimate.high.tolist(), estimate.open.tolist(), strict=True)
    return [{"low": low, "high": high, "open": is_open} for low, high, is_open in ends]


def _feasible_result(feasible: Feasible) -> dict[str, Any]:
    return {
        "prior": feasible.prior,
        "parameters": feasible.preferred.parameters.tolist(),
        "rmse_rise_percent": feasible.preferred.rise.tolist(),
        "smallest_eigenvalue": feasible.preferred.smallest_eigenvalue.tolist(),
        "held": list(feasible.preferred.held),
    }


__all__ = ["Gains", "Identification", "PayloadLogs", "identify"]
