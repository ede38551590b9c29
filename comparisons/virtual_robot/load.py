"""What hangs on the links: a payload, a tilted base, a cable that bends, a spring that balances gravity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ident.arrays import FloatArray
from ident.pseudo_inertia import body_parameters, pseudo_inertia


def perturbed(parameters: FloatArray, spread: float, seed: int) -> FloatArray:
    """Return link parameters (10n,) changed at random by about ``spread`` (relative), each body still feasible.

    A pseudo-inertia stays positive semi-definite under any congruence: stretch and shear of the body's mass
    distribution, a shift by a share of its radius of gyration, a change of mass.
    """
    rng = np.random.default_rng(seed)
    bodies = []
    for body in parameters.reshape(-1, 10):
        matrix = pseudo_inertia(body)
        radius = np.sqrt(max(np.trace(matrix[:3, :3]), 0.0) / body[0]) if body[0] > 0 else 0.0
        change = np.eye(4)
        change[:3, :3] += 0.5 * spread * rng.standard_normal((3, 3))
        change[:3, 3] = spread * radius * rng.standard_normal(3)
        change[3, 3] += 0.5 * spread * rng.standard_normal()
        bodies.append(body_parameters(change @ matrix @ change.T))
    return np.concatenate(bodies)


def payload_parameters(mass: float, com: FloatArray, inertia: FloatArray) -> FloatArray:
    """Return a load's parameters (10,): mass [kg], com (3,) [m] in the last link's frame, inertia (3, 3) about it."""
    about_joint = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    i = about_joint
    return np.array([mass, *(mass * com), i[0, 0], i[0, 1], i[1, 1], i[0, 2], i[1, 2], i[2, 2]])


def tilted(gravity: FloatArray, roll: float, pitch: float) -> FloatArray:
    """Return gravity (3,) seen in a base turned by ``pitch`` about y after ``roll`` about x [rad]."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    turn = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    seen: FloatArray = turn.T @ gravity
    return seen


class Cable(NamedTuple):
    """A hose or cable that stiffens as it bends, n joints.

    Attributes:
        stiffness: torque per radian near the neutral position [N m/rad], (n,).
        neutral: position where it is relaxed [rad], (n,).
        reach: bend over which it stiffens by a factor of about 1.5 [rad], (n,).
    """

    stiffness: FloatArray
    neutral: FloatArray
    reach: FloatArray


def cable(law: Cable, q: FloatArray) -> FloatArray:
    """Return the motor torque (N, n) that bending the cables costs at the positions ``q`` (N, n)."""
    bend = np.clip((q - law.neutral) / law.reach, -6.0, 6.0)
    torque: FloatArray = law.stiffness * law.reach * np.sinh(bend)
    return torque


class Balancer(NamedTuple):
    """A coil spring between two pins that relieves gravity, n joints.

    Attributes:
        torque: largest torque it gives [N m], (n,); 0 for none.
        neutral: position where its line of force passes through the axis [rad], (n,).
        lever: distance of the moving pin from the axis over that of the fixed pin, below 1.
    """

    torque: FloatArray
    neutral: FloatArray
    lever: float = 0.35


def balancer(law: Balancer, q: FloatArray) -> FloatArray:
    """Return the motor torque (N, n) that the balancers save (as a negative cost) at the positions ``q`` (N, n).

    The pins are ``l = sqrt(1 + a^2 - 2 a cos(angle))`` apart; a spring of rest length ``1 - a`` preloaded to half its
    force there pulls them together with a lever arm of ``a sin(angle) / l``.
    """
    a = law.lever

    def pull(angle: FloatArray) -> FloatArray:
        length = np.sqrt(1.0 + a * a - 2.0 * a * np.cos(angle))
        drawn: FloatArray = (length - 0.5 * (1.0 - a)) * a * np.sin(angle) / length
        return drawn

    largest = float(np.max(pull(np.linspace(0.0, np.pi, 721))))
    torque: FloatArray = -law.torque * pull(q - law.neutral) / largest
    return torque
