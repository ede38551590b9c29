"""What lies between motor and link: elasticity, backlash, and the ripple that gears and motor poles print on torque."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled


class Spring(NamedTuple):
    """An elastic transmission with play, n joints.

    Attributes:
        stiffness: torque per unit of wind-up [N m/rad], (n,); 0 marks a rigid joint.
        inertia: link inertia seen by the spring [kg m^2], (n,).
        damping: damping ratio of the link on its spring, (n,).
        gap: play [rad], (n,).
    """

    stiffness: FloatArray
    inertia: FloatArray
    damping: FloatArray
    gap: FloatArray

    def settled(self, torque: FloatArray) -> FloatArray:
        """Return the wind-up (n,) that carries a constant ``torque`` (n,); zero in rigid joints."""
        soft = self.stiffness > 0.0
        wind = torque / np.where(soft, self.stiffness, 1.0) + np.copysign(0.5 * self.gap, torque)
        settled: FloatArray = np.where(soft, wind, 0.0)
        return settled


@compiled
def spring_scan(law: Spring, state: FloatArray, rigid: FloatArray, dt: float) -> FloatArray:
    """Return the torque (N, n) that the motors feel where links of torque ``rigid`` (N, n) hang on springs.

    The wind-up ``d`` of each joint obeys ``I d'' = rigid - spring(d) - damper(d')``, the spring being dead inside the
    gap; ``state`` (2, n) holds wind-up and its rate and is changed in place. Semi-implicit Euler: resonances must lie
    well below ``1 / dt``.
    """
    felt = rigid.copy()
    for j in range(rigid.shape[1]):
        stiffness, inertia = law.stiffness[j], law.inertia[j]
        if stiffness <= 0.0:
            continue
        half = 0.5 * law.gap[j]
        damper = 2.0 * law.damping[j] * np.sqrt(stiffness * inertia)
        wind, rate = state[0, j], state[1, j]
        for row in range(len(rigid)):
            stretch = wind - half if wind > half else (wind + half if wind < -half else 0.0)
            drag = damper * rate if stretch != 0.0 else 0.05 * damper * rate
            rate += dt / inertia * (rigid[row, j] - stiffness * stretch - drag)
            wind += dt * rate
            stretch = wind - half if wind > half else (wind + half if wind < -half else 0.0)
            felt[row, j] = stiffness * stretch + (damper * rate if stretch != 0.0 else 0.0)
        state[0, j], state[1, j] = wind, rate
    return felt


class Ripple(NamedTuple):
    """A torque that repeats with the motor's turn, n joints.

    Attributes:
        force: amplitude [N m], (n,).
        per_joint_radian: phase gained a radian of the joint, gear ratio times periods a motor turn, (n,).
        phase: phase at q = 0 [rad], (n,).
        load: growth of the amplitude with the transmitted torque [1/(N m)], (n,); 0 for cogging.
    """

    force: FloatArray
    per_joint_radian: FloatArray
    phase: FloatArray
    load: FloatArray


def ripple(law: Ripple, q: FloatArray, transmitted: FloatArray) -> FloatArray:
    """Return the torque (N, n) of a ripple at the positions ``q`` under ``transmitted`` torque, both (N, n)."""
    amplitude = law.force * (1.0 + law.load * np.abs(transmitted))
    wave: FloatArray = amplitude * np.sin(law.per_joint_radian * q + law.phase)
    return wave
