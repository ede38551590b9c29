"""The truth as plain figures, and its effects by the contract's names: the true answer to "what does a model lack"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arrays import FloatArray

if TYPE_CHECKING:
    from comparisons.virtual_robot.truth import Truth

Parameters = dict[str, FloatArray]


def true_figures(truth: Truth) -> dict[str, Any]:
    """Return every true figure by name: links, inertia, gain, laws, effects (`true_effects`), the scenario's tables."""
    return {
        "robot": truth.robot.name,
        "unit": truth.robot.unit,
        "link_parameters": truth.link_parameters,
        "gravity": truth.gravity,
        "gain": truth.gain,
        "nominal_gain": truth.nominal_gain,
        "rotor_inertia": truth.rotor_inertia,
        "gear_ratio": truth.gear_ratio,
        "friction": truth.friction._asdict(),
        "cross_friction": truth.cross_friction._asdict(),
        "spring": truth.spring._asdict(),
        "ripples": [ripple._asdict() for ripple in truth.ripples],
        "cable": None if truth.cable is None else truth.cable._asdict(),
        "balancer": None if truth.balancer is None else truth.balancer._asdict(),
        "drive": vars(truth.drive),
        "delay": truth.delay,
        "filter_lag": truth.filter_lag,
        "sensors": vars(truth.sensors),
        "effects": true_effects(truth),
        "scenario": truth.scenario.model_dump(exclude_none=True),
    }


def true_effects(truth: Truth) -> dict[str, Parameters]:
    """Return the effects a scenario has, by the contract's names, each with its true parameters.

    One figure a joint, (n,), zero in joints the effect spares; SI units, torques in N m, currents in the card's unit.
    Parameters of the whole robot (``mass``, ``com``, ``roll``, ``pitch``) are single figures.
    """
    present = {
        key.replace("_", "-")
        for key in type(truth.scenario).model_fields
        if key not in ("name", "links", "motors", "servo", "sensors", "friction")
        and getattr(truth.scenario, key) is not None
    }
    if truth.scenario.friction is not None:
        present |= {"coulomb", "viscous", "stribeck", "maxwell-slip"}
    known = _friction(truth) | _transmission(truth) | _drives(truth) | _loads(truth)
    return {name: known[name] for name in sorted(present)} | {"rotor-inertia": {"inertia": truth.rotor_inertia}}


def _friction(truth: Truth) -> dict[str, Parameters]:
    law, pairs = truth.friction, truth.cross_friction
    excess = law.static - law.coulomb
    slip = np.max(law.share * law.static[:, None] / np.where(law.stiffness > 0.0, law.stiffness, np.inf), axis=1)
    shared = np.zeros(truth.n)
    for first, second, ratio, force in zip(pairs.first, pairs.second, pairs.ratio, pairs.force, strict=True):
        shared[int(first)] += force
        shared[int(second)] += abs(ratio) * force
    return {
        "coulomb": {"force": law.coulomb},
        "viscous": {"damping": law.viscous},
        "stribeck": {"force": excess, "speed": law.stribeck.mean(axis=1)},
        "maxwell-slip": {"force": law.static, "slip": slip},
        "cross-joint-hysteresis": {
            "force": (1.0 - law.kept) * law.static * (law.loosening.max(axis=1) > 0.0),
            "slip": slip,
        },
        "load-friction": {"force": law.load * truth.usual_torque},
        "coulomb-asymmetry": {"force": law.asymmetry * law.coulomb},
        "position-friction": {"force": law.position * law.coulomb},
        "viscous-nonlinear": {"speed": law.thinning},
        "thermal-friction": {"share": law.heat_share, "seconds": law.heat_time},
        "cross-joint-friction": {"force": shared},
    }


def _transmission(truth: Truth) -> dict[str, Parameters]:
    found: dict[str, Parameters] = {
        "elasticity": {"stiffness": truth.spring.stiffness},
        "backlash": {"gap": truth.spring.gap},
    }
    keys = [key for key in ("gear_ripple", "cogging") if getattr(truth.scenario, key) is not None]
    for key, ripple in zip(keys, truth.ripples, strict=True):
        turns = ripple.per_joint_radian / truth.gear_ratio
        found[key.replace("_", "-")] = {"force": ripple.force, "per_turn": turns}
    return found


def _drives(truth: Truth) -> dict[str, Parameters]:
    drive = truth.drive
    return {
        "drive-gain": {"scale": truth.gain / truth.nominal_gain},
        "torque-saturation": {"share": drive.saturation},
        "current-offset": {"offset": drive.offset},
        "sensor-drift": {"per_hour": drive.drift},
        "delay": {"seconds": truth.delay},
        "filter-lag": {"hertz": truth.filter_lag},
    }


def _loads(truth: Truth) -> dict[str, Parameters]:
    payload, tilt = truth.scenario.payload, truth.scenario.base_tilt
    none = np.zeros(truth.n)
    return {
        "payload": {"mass": np.array(payload.mass), "com": np.array(payload.com)} if payload else {},
        "base-tilt": {"roll": np.array(tilt.roll), "pitch": np.array(tilt.pitch)} if tilt else {},
        "cable-spring": {"stiffness": none if truth.cable is None else truth.cable.stiffness},
        "gravity-balancer": {"torque": none if truth.balancer is None else truth.balancer.torque},
    }
