"""Joint friction with memory: a generalised Maxwell slip model with a Stribeck curve for each of its elements.

Lampaert, Al-Bender and Swevers 2003: an element sticks like a spring until its force reaches its share of the
Stribeck curve, then slips, drawn to that curve at a finite rate, until the velocity reverses. Three things are
added: the curve grows with the transmitted torque, the stored force of a joint at rest is shaken loose by the motion
of other joints (the paper's Joint 4), and the dissipated power warms the joint and thins its lubricant. The
catalogue of `ident` holds none of these laws: it fits elements of constant force, and cannot fit this one exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.compiled import compiled


class FrictionLaw(NamedTuple):
    """Figures of the law for n joints with E elements each; torques in N m, angles in rad (prismatic: N, m).

    Attributes:
        coulomb, static: kinetic and breakaway torque, (n,).
        share: part of the torque that each element carries, rows sum to 1, (n, E).
        stiffness: torque per unit of displacement of each sticking element, (n, E).
        stribeck: speed at which each element's excess over Coulomb has fallen to 1/e, (n, E).
        attraction: rate at which a slipping element nears its curve [1/s], (n,).
        viscous: damping [N m s/rad], (n,).
        thinning: speed at which shear thinning has halved the damping, (n,); inf for none.
        load: Coulomb torque per unit of transmitted torque, (n,).
        asymmetry: relative excess of the torque in the positive direction, and lack in the other, (n,).
        position, phase: relative amplitude and phase of the torque over a joint turn, (n,).
        loosening: rate at which joint k's motion shakes the torque stored in joint j loose [1/rad], (n, n).
        kept: share of the torque stored at the stop that no motion of others shakes loose, (n,).
        heat_share: relative loss of friction in a hot joint, (n,).
        heat_power: dissipated power [W] that warms the joint to one unit of heat, (n,).
        heat_time: time constant of warming and cooling [s], (n,).
    """

    coulomb: FloatArray
    static: FloatArray
    share: FloatArray
    stiffness: FloatArray
    stribeck: FloatArray
    attraction: FloatArray
    viscous: FloatArray
    thinning: FloatArray
    load: FloatArray
    asymmetry: FloatArray
    position: FloatArray
    phase: FloatArray
    loosening: FloatArray
    kept: FloatArray
    heat_share: FloatArray
    heat_power: FloatArray
    heat_time: FloatArray


class FrictionState(NamedTuple):
    """What the joints remember; changed in place by the kernels.

    Attributes:
        force: torque of each element, (n, E).
        slipping: which elements slip, (n, E).
        anchor: torque of each element when its joint last moved, (n, E).
        heat: units of heat stored in each joint, (n,).
    """

    force: FloatArray
    slipping: BoolArray
    anchor: FloatArray
    heat: FloatArray


REST_SPEED = 2e-3
"""Below this speed [rad/s] a joint counts as stopped: motion of others can shake its stored friction loose."""


def stopped(law: FrictionLaw, stored: FloatArray) -> FrictionState:
    """Return the state of joints at rest that keep the share ``stored`` (n,), in [-1, 1], of their breakaway torque."""
    force = stored[:, None] * law.share * law.static[:, None]
    return FrictionState(force.copy(), np.zeros(force.shape, dtype=np.bool_), force.copy(), np.zeros(len(stored)))


@compiled
def friction_step(
    law: FrictionLaw,
    state: FrictionState,
    q: FloatArray,
    travel: FloatArray,
    dq: FloatArray,
    load: FloatArray,
    dt: float,
    torque: FloatArray,
) -> None:
    """Advance the state by ``dt`` and write the torque the motors spend on friction into ``torque``, all (n,).

    ``travel`` is the displacement during the step and ``load`` the transmitted torque; stable for any step.
    """
    n, elements = law.share.shape
    for j in range(n):
        speed = abs(dq[j])
        heat = state.heat[j]
        level = 1.0 - law.heat_share[j] * heat / (1.0 + heat)
        level *= 1.0 + law.position[j] * math.cos(q[j] - law.phase[j])
        level *= 1.0 + law.asymmetry[j] if dq[j] > 0.0 else 1.0 - law.asymmetry[j]
        base = level * law.coulomb[j] + law.load[j] * abs(load[j])
        excess = level * (law.static[j] - law.coulomb[j])
        drawn = 1.0 - math.exp(-law.attraction[j] * dt)
        shaken = 0.0
        if speed < REST_SPEED:
            for k in range(n):
                shaken += law.loosening[j, k] * abs(dq[k])
            shaken = 1.0 - math.exp(-shaken * dt) if shaken > 0.0 else 0.0
        total = 0.0
        for e in range(elements):
            curve = base + excess * (math.exp(-speed / law.stribeck[j, e]) if speed > 1e-9 else 1.0)
            limit = law.share[j, e] * curve
            force = state.force[j, e]
            if state.slipping[j, e] and (dq[j] * force <= 0.0 or speed < 1e-7):
                state.slipping[j, e] = False
            if state.slipping[j, e]:
                force += drawn * (math.copysign(limit, dq[j]) - force)
            else:
                force += law.stiffness[j, e] * travel[j]
                if abs(force) >= limit and force * travel[j] > 0.0:
                    force = math.copysign(limit, force)
                    state.slipping[j, e] = True
            if speed >= REST_SPEED:
                state.anchor[j, e] = force
            elif shaken > 0.0:
                force -= shaken * (force - law.kept[j] * state.anchor[j, e])
            state.force[j, e] = force
            total += force
        total += level * law.viscous[j] * dq[j] / (1.0 + speed / law.thinning[j])
        power = abs(total) * speed
        state.heat[j] += dt / law.heat_time[j] * (power / law.heat_power[j] - heat)
        torque[j] = total


@compiled
def friction_scan(
    law: FrictionLaw,
    state: FrictionState,
    q: FloatArray,
    dq: FloatArray,
    load: FloatArray,
    before: FloatArray,
    dt: float,
) -> FloatArray:
    """Return the friction torque along a motion, (N, n), for ``q``, ``dq``, ``load`` (N, n) sampled every ``dt``.

    ``before`` (n,) is the position one step earlier; ``state`` is left as it is after the last sample.
    """
    torque = np.empty_like(q)
    last = before.copy()
    for row in range(len(q)):
        friction_step(law, state, q[row], q[row] - last, dq[row], load[row], dt, torque[row])
        last[:] = q[row]
    return torque


class CrossFriction(NamedTuple):
    """Friction in parts that several joints turn, such as the seals of wrist gears; P such pairs.

    Attributes:
        first, second: the joints (from 0) whose motion adds up in the part, (P,).
        ratio: turns of the part for one turn of the second joint, against one turn for the first, (P,).
        force: torque [N m] at high speed, (P,).
        speed: speed [rad/s] at which half of the torque is reached, (P,).
    """

    first: FloatArray
    second: FloatArray
    ratio: FloatArray
    force: FloatArray
    speed: FloatArray


def cross_friction(law: CrossFriction, dq: FloatArray) -> FloatArray:
    """Return the torque (N, n) that shared parts cost at the joint velocities ``dq`` (N, n)."""
    torque = np.zeros_like(dq)
    for k in range(len(law.force)):
        first, second = int(law.first[k]), int(law.second[k])
        part = law.force[k] * 2.0 / np.pi * np.arctan((dq[:, first] + law.ratio[k] * dq[:, second]) / law.speed[k])
        torque[:, first] += part
        torque[:, second] += law.ratio[k] * part
    return torque
