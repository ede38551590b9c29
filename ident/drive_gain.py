"""Drive gains from currents: relative ones from motion alone, absolute ones from a known payload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.bilinear import WIDE, GainPrior
from ident.effects.base import Effect
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import RotorInertia
from ident.errors import InputError
from ident.gain_regression import Bounds, GainFit, GainRegression
from ident.log import LogSource
from ident.payload import CarryingMotion, Payload, last_joint
from ident.robot import Robot

OPEN = 0.05
"""Relative standard deviation, from the data alone, above which a gain counts as left open."""

WEIGHTLESS = 0.05
"""Share of the payload's torque below which gravity's part of it does not count."""

COVERAGE = 1.96
"""Standard deviations from the estimate to either end of its interval (95 %)."""


@dataclass(frozen=True, eq=False)
class GainEstimate:
    """Drive gains [N m (prismatic N) per unit of current], or relative ones with geometric mean one.

    Attributes:
        value: estimates (n,).
        std: standard deviations (n,), with the residual's autocorrelation and whatever prior was given.
        low, high: ends of the 95 % interval (n,).
        open: gains that the data alone leave within no better than about 10 %, (n,).
        reason: in words why a gain is open; empty where it is not, (n,).
        start: estimates by column-scaled total least squares, from which the search began, (n,).
        links: inertial parameters of each joint's row at these gains [SI, or relative], (n, 10 n); base ones only.
    """

    value: FloatArray
    std: FloatArray
    low: FloatArray
    high: FloatArray
    open: BoolArray
    reason: tuple[str, ...]
    start: FloatArray
    links: FloatArray


def usual_effects(robot: Robot) -> list[Effect]:
    """Return what every joint has of its own: rotor inertia, offset, Coulomb and viscous friction.

    Args:
        robot: whose joints get them.
    """
    return [kind(j) for j in range(robot.n) for kind in (RotorInertia, CurrentOffset, Coulomb, Viscous)]


def gains_from_payload(
    robot: Robot,
    without: Sequence[LogSource],
    with_: Sequence[LogSource],
    payload: Payload,
    cutoff: float,
    effects: Sequence[Effect] | None = None,
    nominal: FloatArray | None = None,
    nominal_std: FloatArray | float = 0.2,
    bounds: Bounds | None = None,
    share_links: bool = False,
) -> GainEstimate:
    """Estimate drive gains from logs without and with a known payload.

    The currents obey ``i_j = (Y_j pi_j + Y_L,j pi_L) / k_j + friction_j`` with the payload ``pi_L`` known.
    Column-scaled total least squares (Gautier and Briot 2014) starts the search for the maximum likelihood, in which
    noise is in the currents alone. The same motion without and with the payload is best: what the model lacks is
    then the same in both, and does not enter the gains.

    Args:
        robot: the robot.
        without, with_: logs without and with the payload.
        payload: the payload.
        cutoff: cut-off [Hz] of the zero-phase filter that derives velocity and acceleration.
        effects: what each joint has besides links; by default `usual_effects`.
        nominal: gains known beforehand, e.g. from a data sheet, (n,); NaN where unknown.
        nominal_std: their relative standard deviation.
        bounds: least and largest gain of each joint, (n,) each.
        share_links: let all joints share one set of links. That ties the gains to each other, which helps those that
            the payload hardly loads where the model is right, and spoils the others where friction is not; by default
            every joint's row has links of its own and only the payload tells its gain.

    Raises:
        InputError: one of the two sets of logs is empty, the payload is wrong, or a bound is not positive.
    """
    if not without or not with_:
        where = "logs without the payload" if not without else "logs with the payload"
        raise InputError("no log", where, "give logs of the same motion without and with the payload")
    n = robot.n
    low, high = bounds if bounds is not None else (np.full(n, 1.0 / WIDE), np.full(n, WIDE))
    if np.any(~(np.asarray(low) > 0.0)) or np.any(~(np.asarray(low) < np.asarray(high))):
        raise InputError("bounds are not positive and rising", "drive gains", "give 0 < lower < upper for each joint")
    prior = None
    if nominal is not None:
        known = np.isfinite(nominal) & (nominal > 0.0)
        relative = np.where(known, np.broadcast_to(nominal_std, n), np.inf)
        prior = GainPrior(np.log(np.where(known, nominal, 1.0)), relative)
    chosen = usual_effects(robot) if effects is None else effects
    regression = GainRegression(robot, without, with_, payload, cutoff, chosen, share_links)
    limits = (np.asarray(low, dtype=float), np.asarray(high, dtype=float))
    return _report(regression, regression.fit(prior, limits), prior, limits)


def shared_gains(
    robot: Robot,
    sources: Sequence[LogSource],
    cutoff: float,
    effects: Sequence[Effect] | None = None,
    inertial: FloatArray | None = None,
) -> GainEstimate:
    """Estimate relative drive gains from motion alone, together with the links that all joints share.

    Args:
        robot: the robot.
        sources: logs.
        cutoff: cut-off [Hz] of the zero-phase filter that derives velocity and acceleration.
        effects: what each joint has besides links; by default `usual_effects`.
        inertial: inertial parameters (10 n,) [SI], such as CAD's scaled to the robot's true mass. They fix the scale:
            the links' weight along the logs is then as large as theirs, and the intervals hold for that scale.
            Without them the gains' geometric mean is one.

    Raises:
        InputError: no log.
    """
    if not sources:
        raise InputError("no log", "drive gains", "give logs of moving joints")
    chosen = usual_effects(robot) if effects is None else effects
    regression = GainRegression(robot, sources, (), None, cutoff, chosen, share_links=True)
    limits = (np.zeros(robot.n), np.full(robot.n, np.inf))
    found = regression.fit(None, limits)
    estimate = _report(regression, found, None, limits)
    if inertial is None:
        return estimate
    factor = _scale(regression, found, inertial)
    scaled = {k: getattr(estimate, k) * factor for k in ("value", "std", "low", "high", "start", "links")}
    return replace(estimate, **scaled)


def _report(regression: GainRegression, found: GainFit, prior: GainPrior | None, bounds: Bounds) -> GainEstimate:
    spread = regression.spread(found)
    alone = np.sqrt(np.diag(spread))
    with_prior = alone if prior is None else _combined(spread, prior)
    # The current is linear in one over the gain, so that is where the interval is symmetric.
    reach = COVERAGE * with_prior
    low = np.maximum(found.gains / (1.0 + reach), bounds[0])
    high = np.minimum(
        np.divide(found.gains, 1.0 - reach, where=reach < 1.0, out=np.full(len(reach), np.inf)), bounds[1]
    )
    if regression.known is None:
        alone = _beside_the_best(spread)
    is_open = ~(alone <= OPEN)
    reasons = tuple(_reason(regression, found, j, alone[j]) if is_open[j] else "" for j in range(len(alone)))
    links = regression.link_parameters(found)
    return GainEstimate(found.gains, found.gains * with_prior, low, high, is_open, reasons, found.start, links)


def _reason(regression: GainRegression, found: GainFit, joint: int, alone: float) -> str:
    how = "not at all" if not alone < 1.0 else f"to {100 * alone:.0f} % only"
    told = f"the data alone tell the gain of joint {joint + 1} {how}"
    if regression.known is None:
        return f"{told}: its current shares too little with the other joints'"
    noise, unit = found.residual[joint], regression.robot.unit
    moving, weight = _payload_torque(regression, joint)
    felt = f"the payload asks {moving:.2g} N m of it and the model leaves {noise:.2g} {unit} (both root mean square)"
    if weight < WEIGHTLESS * moving:
        return f"{told}: gravity does not load it; {felt}"
    return f"{told}: {felt}"


def _payload_torque(regression: GainRegression, joint: int) -> tuple[float, float]:
    """Root mean square of what the payload asks of a joint in the logs that carry it, and of its weight's part."""
    robot = regression.robot
    parameters = np.zeros(10 * robot.n)
    parameters[10 * last_joint(robot) :][:10] = regression.payload
    asked, still = [], []
    for motion in (b.motion for b in regression.held if isinstance(b.motion, CarryingMotion)):
        rest = np.zeros_like(motion.q)
        asked.append(robot.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, parameters)[:, joint])
        still.append(robot.rigid_body.inverse_dynamics(motion.q, rest, rest, parameters)[:, joint])
    moving, weight = (float(np.sqrt(np.nanmean(np.concatenate(x) ** 2))) for x in (asked, still))
    return moving, weight


def _beside_the_best(spread: FloatArray) -> FloatArray:
    """Standard deviations (n,) of relative gains beside a mean in which each weighs what it is known to.

    Beside the plain mean, one gain that the data do not tell would make all of them look open.
    """
    n = len(spread)
    if not np.isfinite(spread).all():
        return np.sqrt(np.diag(spread))
    weights = np.full(n, 1.0 / n)
    for _ in range(20):
        away = np.eye(n) - np.outer(np.ones(n), weights)
        variance = np.diag(away @ spread @ away.T)
        weights = 1.0 / (variance + variance.min() + 1e-300)
        weights /= weights.sum()
    std: FloatArray = np.sqrt(variance)
    return std


def _scale(regression: GainRegression, found: GainFit, inertial: FloatArray) -> float:
    """Factor that makes the links' weight along the logs as large as that of given inertial parameters.

    Weight, because inertia may hold rotors' too. Where no joint carries weight, all of the torque.
    """
    body = regression.robot.rigid_body
    relative = regression.link_parameters(found)
    for moving in (0.0, 1.0):
        sums = np.zeros(2)
        for m in (block.motion for block in regression.held):
            torques = [body.inverse_dynamics(m.q, moving * m.dq, moving * m.ddq, x) for x in (inertial, relative)]
            sums += [float(np.nansum(torque**2)) for torque in torques]
        if np.all(sums > 0.0):
            break
    return float(np.sqrt(sums[0] / sums[1]))


def _combined(spread: FloatArray, prior: GainPrior) -> FloatArray:
    """Standard deviations (n,) of the logarithms of the gains from data and prior together."""
    determined = np.isfinite(np.diag(spread))
    information = np.diag(1.0 / prior.std**2)
    information[np.ix_(determined, determined)] += np.linalg.inv(spread[np.ix_(determined, determined)])
    told = np.diag(information) > 0.0
    std = np.full(len(spread), np.inf)
    std[told] = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(told, told)])))
    return std
