"""Rigid-body dynamics of a tree as CasADi expressions, for optimisation with exact derivatives.

Everything stands in the links' own frames, as in ``link_motion``: recursive Newton-Euler for torques (Luh, Walker and
Paul 1980; Featherstone 2008, ch. 5) and virtual power for the regressor (Khalil and Dombre 2002, ch. 12).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ident.arrays import FloatArray
from ident.coupling import Coupling
from ident.multibody import Tree

NOTHING = 1e-15  # entry of a placement that is rounding of zero: made structural, so that no operation is spent on it


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """Motion of every link in its own axes, lists over the joints in the card's order.

    Attributes:
        rotation: of link k in its parent, (3, 3); maps the link's coordinates to the parent's.
        translation: of link k's origin in its parent [m], (3, 1).
        omega, alpha: angular velocity and acceleration, (3, 1).
        acceleration: of the origin, less gravity [m/s^2], (3, 1).
    """

    rotation: list[ca.SX]
    translation: list[ca.SX]
    omega: list[ca.SX]
    alpha: list[ca.SX]
    acceleration: list[ca.SX]


def placements(tree: Tree, q: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Rotations (3, 3) and translations (3, 1) [m] of every link in its parent, for joint positions q (n, 1)."""
    rotations, translations = [], []
    for k in range(len(tree.order)):
        axis, fixed = _constant(tree.axis[k]), _constant(tree.rotation[k])
        offset = _constant(tree.translation[k])
        if tree.prismatic[k]:
            rotations.append(fixed)
            translations.append(offset + fixed @ axis * q[k])
            continue
        cross = ca.sparsify(ca.skew(axis))  # Rodrigues' formula about the joint's axis
        turn = ca.SX.eye(3) + ca.sin(q[k]) * cross + (1 - ca.cos(q[k])) * ca.sparsify(cross @ cross)
        rotations.append(fixed @ turn)
        translations.append(offset)
    return rotations, translations


def base_poses(tree: Tree, q: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    """Rotation (3, 3) and origin (3, 1) [m] of every link in the base, for joint positions q (n, 1)."""
    rotations, translations = placements(tree, q)
    poses: list[tuple[ca.SX, ca.SX]] = [(ca.SX(), ca.SX())] * len(tree.order)
    for k in tree.order:
        rotation, origin = rotations[k], translations[k]
        if tree.parent[k] >= 0:
            above, at = poses[tree.parent[k]]
            rotation, origin = above @ rotation, at + above @ origin
        poses[k] = (rotation, origin)
    return poses


def link_motion(tree: Tree, gravity: FloatArray, q: ca.SX, dq: ca.SX, ddq: ca.SX) -> LinkMotion:
    """Velocities and accelerations of all links, from the base outwards; q, dq, ddq are (n, 1)."""
    rotations, translations = placements(tree, q)
    n = len(tree.order)
    omega, alpha, acceleration = [ca.SX()] * n, [ca.SX()] * n, [ca.SX()] * n
    for k in tree.order:
        p = tree.parent[k]
        above_omega, above_alpha, above = ca.SX(3, 1), ca.SX(3, 1), _constant(-np.asarray(gravity))
        if p >= 0:
            above_omega, above_alpha, above = omega[p], alpha[p], acceleration[p]
            arm = translations[k]
            above = above + ca.cross(above_alpha, arm) + ca.cross(above_omega, ca.cross(above_omega, arm))
        into, axis = rotations[k].T, _constant(tree.axis[k])
        omega[k], alpha[k], acceleration[k] = into @ above_omega, into @ above_alpha, into @ above
        carried = ca.cross(omega[k], axis * dq[k])  # the axis turns with the parent
        if tree.prismatic[k]:
            acceleration[k] += axis * ddq[k] + 2 * carried  # Coriolis
        else:
            omega[k] += axis * dq[k]
            alpha[k] += axis * ddq[k] + carried
    return LinkMotion(rotations, translations, omega, alpha, acceleration)


def inverse_dynamics(
    tree: Tree, gravity: FloatArray, parameters: ca.SX | FloatArray, q: ca.SX, dq: ca.SX, ddq: ca.SX
) -> ca.SX:
    """Joint torques (n, 1) [N m, N] by recursive Newton-Euler.

    Args:
        tree: the mechanism.
        gravity: in the base frame [m/s^2], (3,).
        parameters: inertial parameters (10 n,), numbers or symbols, ten a joint in Pinocchio's order.
        q, dq, ddq: joint motion, (n, 1) each.
    """
    motion = link_motion(tree, gravity, q, dq, ddq)
    n = len(tree.order)
    force, moment = [ca.SX(3, 1)] * n, [ca.SX(3, 1)] * n
    torque = ca.SX(n, 1)
    pi = ca.SX(ca.DM(parameters)) if isinstance(parameters, np.ndarray) else parameters
    for k in tree.order[::-1]:
        omega, alpha, acceleration = motion.omega[k], motion.alpha[k], motion.acceleration[k]
        mass, first, inertia = pi[10 * k], pi[10 * k + 1 : 10 * k + 4], _inertia(pi[10 * k + 4 : 10 * k + 10])
        force[k] += mass * acceleration + ca.cross(alpha, first) + ca.cross(omega, ca.cross(omega, first))
        moment[k] += inertia @ alpha + ca.cross(omega, inertia @ omega) + ca.cross(first, acceleration)
        torque[k] = ca.dot(_constant(tree.axis[k]), force[k] if tree.prismatic[k] else moment[k])
        p = tree.parent[k]
        if p >= 0:
            carried = motion.rotation[k] @ force[k]
            force[p] = force[p] + carried
            moment[p] = moment[p] + motion.rotation[k] @ moment[k] + ca.cross(motion.translation[k], carried)
    return torque


def motor_motion(coupling: Coupling | None, motion: ca.SX) -> ca.SX:
    """Position, velocity or acceleration (n, 1) of the motors by that (n, 1) of the joints.

    Args:
        coupling: of the motors; None where every motor moves its own joint alone.
        motion: of the joints.
    """
    return motion if coupling is None else ca.DM(coupling.matrix) @ motion


def motor_forces(coupling: Coupling | None, forces: ca.SX) -> ca.SX:
    """Forces of the motors, or rows of their regressor, (n, k), by those (n, k) of the joints.

    Args:
        coupling: of the motors; None where every motor moves its own joint alone.
        forces: of the joints.
    """
    return forces if coupling is None else ca.DM(coupling.joints.T) @ forces


def regressor(tree: Tree, gravity: FloatArray, q: ca.SX, dq: ca.SX, ddq: ca.SX) -> ca.SX:
    """Regressor Y (n, 10 n), sparse where a joint carries no link: torques are ``Y @ parameters``.

    Arguments as for `inverse_dynamics`.
    """
    motion = link_motion(tree, gravity, q, dq, ddq)
    n = len(tree.order)
    rows = ca.SX(n, 10 * n)
    for k in range(n):
        wrench = _link_wrench(motion.omega[k], motion.alpha[k], motion.acceleration[k])
        force, moment = wrench[:3, :], wrench[3:, :]
        j = k
        while j >= 0:  # carry the link's wrench down the chain, taking each joint's share
            rows[j, 10 * k : 10 * k + 10] = _constant(tree.axis[j]).T @ (force if tree.prismatic[j] else moment)
            force = motion.rotation[j] @ force
            moment = motion.rotation[j] @ moment + ca.skew(motion.translation[j]) @ force
            j = int(tree.parent[j])
    return rows


def _link_wrench(omega: ca.SX, alpha: ca.SX, acceleration: ca.SX) -> ca.SX:
    """Force and moment about its origin that a link needs, per unit of its ten parameters, (6, 10)."""
    turning = ca.skew(omega)
    wrench = ca.SX(6, 10)
    wrench[:3, 0] = acceleration
    wrench[:3, 1:4] = ca.skew(alpha) + turning @ turning
    wrench[3:, 1:4] = -ca.skew(acceleration)
    wrench[3:, 4:] = _inertia_columns(alpha) + turning @ _inertia_columns(omega)
    return wrench


def _inertia_columns(w: ca.SX) -> ca.SX:
    """Matrix (3, 6) with ``I w`` as its product with Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    x, y, z = w[0], w[1], w[2]
    columns = ca.SX(3, 6)
    columns[0, 0], columns[0, 1], columns[0, 3] = x, y, z
    columns[1, 1], columns[1, 2], columns[1, 4] = x, y, z
    columns[2, 3], columns[2, 4], columns[2, 5] = x, y, z
    return columns


def _inertia(entries: ca.SX) -> ca.SX:
    xx, xy, yy, xz, yz, zz = ca.vertsplit(entries)
    return ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))


def _constant(values: FloatArray) -> ca.SX:
    return ca.SX(ca.sparsify(ca.DM(np.where(np.abs(values) < NOTHING, 0.0, values))))
