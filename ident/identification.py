"""From a robot and logs to an identified, explained current model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from ident.cautions import gain_warnings, sign_warnings, still_warnings
from ident.current_unit import check_unit
from ident.drive_gain import GainEstimate
from ident.effects import load_catalogue
from ident.effects.base import Effect
from ident.effects.direction import DirectedEffect, VelocityEffect
from ident.effects.hysteresis import CrossJointHysteresis
from ident.effects.survey import Survey
from ident.effects.transmission import CrossJointFriction
from ident.errors import InputError
from ident.feasible import Feasible, SolverFailure, feasible_parameters
from ident.fit import Fit, fit
from ident.gap.baseline import Foreseen, foreseen
from ident.gap.rests import Rests, find_rests
from ident.gap.rows import panel_of, survey_of
from ident.log import LogSource
from ident.model import CurrentModel
from ident.model_file import save_model
from ident.parameters import Parameter, list_parameters
from ident.robot import Robot
from ident.signals import CutoffChoice
from ident.start import Gains, PayloadLogs, Start, start_of
from ident.structure import Structure, choose_structure, coupled
from ident.urdf_export import write_urdf

Progress = Callable[[str, float], None]

URDF = "identified.urdf"

SLOWEST_SIGN = 0.01
"""Speed [rad/s or m/s] from which on a sign of velocity that turns over it is left to a law that the logs choose."""


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
        rests: which joints stick, and when: what dry friction holds then was not fitted.
        warnings: what the user should look at, in sentences.
    """

    model: CurrentModel
    fit: Fit
    gains: Gains
    gain_estimate: GainEstimate | None
    cutoff: CutoffChoice
    structure: Structure | None
    feasible: Feasible | None
    rests: Rests
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
            "rests_left_out": [j + 1 for j in self.rests.joints],
            "presliding": self.model.presliding.tolist(),
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
        InputError: no log, a log too short, in another unit than others, a name that is no effect, or gains that the
            card does not know.
    """
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
    tell("looking at the logs", 0.0)
    start, seen = _seen(robot, start_of(robot, train, cutoff, gains, loaded), train, cutoff is None, effects is None)
    train = [seen.model.view(source) for source in train]
    hertz, drives, rests = start.cutoff.hertz, start.drives, seen.rests
    structure: Structure | None = None
    if effects is None:
        tell("choosing friction terms", 0.0)
        structure = choose_structure(
            robot,
            start.effects,
            train,
            hertz,
            drives,
            lambda share: tell("choosing friction terms", share),
            rests.counts,
        )
        used: Sequence[Effect] = structure.effects
    else:
        used = _named(start, survey_of(seen.model, panel_of(seen.model, train)), effects)
        # Who names friction with memory means what it holds at rest, which nothing else tells of.
        rests = rests.without([e.joint for e in used if e.family == "hysteresis" and e.joint is not None])
    found = fit(robot, used, train, hertz, drives, robust, lambda share: tell("fitting", share), counts=rests.counts)
    model = replace(found.model, positions_only=seen.model.positions_only)
    check_unit(model, train, learnt=True)
    feasible, trouble = _feasible(robot, found, start.gains)
    warnings = [
        *sign_warnings(model, start.held),
        *still_warnings(robot, start.still),
        *gain_warnings(start.gain_estimate),
        *trouble,
    ]
    return Identification(
        model, found, start.gains, start.gain_estimate, start.cutoff, structure, feasible, rests, tuple(warnings)
    )


def _seen(robot: Robot, start: Start, train: Sequence[LogSource], choose: bool, yields: bool) -> tuple[Start, Foreseen]:
    """The start with the signs and sources of velocity and, if it is to be chosen, the cut-off that predict best.

    Friction may build up over a displacement where the effects are not given: who names some means no memory.
    """
    found = foreseen(start.model(robot), train, choose, yields)
    effects = [_turning(old, term.effect) for old, term in zip(start.effects, found.model.terms, strict=True)]
    hertz = found.model.cutoff
    cutoff = start.cutoff
    if hertz != cutoff.hertz:
        cutoff = CutoffChoice(hertz, f"{hertz:.3g} Hz: rows held out are predicted best with it")
    start = replace(start, effects=effects, cutoff=cutoff)
    # A sign that turns elsewhere than the joint's own looks like friction that holds.
    rests = find_rests(found.model, train) if found.rests.joints else found.rests
    return start, replace(found, rests=rests)


def _turning(old: Effect, seen: Effect) -> Effect:
    """An effect as the logs ask for, unless its sign turns more slowly than a sign may: then it is a law of its own."""
    if isinstance(seen, DirectedEffect) and seen.presliding > 0.0:
        return seen
    return old if isinstance(seen, VelocityEffect) and seen.smoothing >= SLOWEST_SIGN else seen


def _named(start: Start, survey: Survey, names: Sequence[str]) -> list[Effect]:
    """Every joint's effects by name, in place of Coulomb and viscous friction."""
    catalogue = load_catalogue()
    for name in names:
        if name not in catalogue:
            raise InputError(f"no effect is named {name!r}", "--effects", f"choose from {', '.join(sorted(catalogue))}")
    effects = [e for e in start.effects if not isinstance(e, VelocityEffect)]
    present = {effect.name for effect in effects}
    moving = [j for j in range(survey.robot.n) if j not in start.still]
    for name in dict.fromkeys(names):
        if name not in present:
            found = [effect for j in moving for effect in _on_joint(catalogue[name], start, survey, j)]
            if not found:
                raise InputError(f"{name} is no effect of one joint of this robot", "--effects", "leave it out")
            effects += found
    return effects


def _on_joint(kind: type[Effect], start: Start, survey: Survey, joint: int) -> list[Effect]:
    """An effect of a joint as the logs ask for, if there is one; of other joints, those that are coupled."""
    if issubclass(kind, CrossJointFriction | CrossJointHysteresis):
        return [kind(joint, source) for source in coupled(survey.robot, joint)]
    found = kind.candidates(survey, joint)[:1]
    return [one.turned_as(start.friction[joint]) if isinstance(one, VelocityEffect) else one for one in found]


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
