"""Where the links are, and what a force on one of them asks of the joints: compiled walks along the tree."""

from __future__ import annotations

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.compiled import compiled
from ident.multibody import Multibody


@compiled
def link_poses(
    order: IntArray,
    parent: IntArray,
    prismatic: BoolArray,
    axis: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    q: FloatArray,
    turn: FloatArray,
    place: FloatArray,
) -> None:
    """Write the links' rotations (n, 3, 3) and origins (n, 3) in the base at ``q`` (n,); see `ident.multibody.Tree`."""
    own = np.empty((3, 3))
    fixed = np.empty((3, 3))
    start = np.empty(3)
    for k in order:
        up = parent[k]
        for a in range(3):
            start[a] = translation[k, a] if up < 0 else place[up, a]
            for b in range(3):
                fixed[a, b] = rotation[k, a, b]
        if up >= 0:
            for a in range(3):
                for b in range(3):
                    start[a] += turn[up, a, b] * translation[k, b]
                    fixed[a, b] = 0.0
                    for c in range(3):
                        fixed[a, b] += turn[up, a, c] * rotation[k, c, b]
        x, y, z = axis[k, 0], axis[k, 1], axis[k, 2]
        angle = 0.0 if prismatic[k] else q[k]
        c, s = np.cos(angle), np.sin(angle)
        v = 1.0 - c
        own[0, 0], own[0, 1], own[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
        own[1, 0], own[1, 1], own[1, 2] = x * y * v + z * s, c + y * y * v, y * z * v - x * s
        own[2, 0], own[2, 1], own[2, 2] = x * z * v - y * s, y * z * v + x * s, c + z * z * v
        for a in range(3):
            place[k, a] = start[a]
            for b in range(3):
                if prismatic[k]:
                    place[k, a] += fixed[a, b] * axis[k, b] * q[k]
                turn[k, a, b] = 0.0
                for d in range(3):
                    turn[k, a, b] += fixed[a, d] * own[d, b]


@compiled
def point_jacobian(
    parent: IntArray,
    prismatic: BoolArray,
    axis: FloatArray,
    turn: FloatArray,
    place: FloatArray,
    link: int,
    point: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Write the Jacobian [linear; angular] (6, n) of a point fixed to a link, ``point`` (3,) in the base frame."""
    jacobian[:] = 0.0
    k = link
    while k >= 0:
        w = np.empty(3)
        for a in range(3):
            w[a] = turn[k, a, 0] * axis[k, 0] + turn[k, a, 1] * axis[k, 1] + turn[k, a, 2] * axis[k, 2]
        if prismatic[k]:
            for a in range(3):
                jacobian[a, k] = w[a]
        else:
            x, y, z = point[0] - place[k, 0], point[1] - place[k, 1], point[2] - place[k, 2]
            jacobian[0, k] = w[1] * z - w[2] * y
            jacobian[1, k] = w[2] * x - w[0] * z
            jacobian[2, k] = w[0] * y - w[1] * x
            for a in range(3):
                jacobian[3 + a, k] = w[a]
        k = parent[k]


@compiled
def _push_torques(
    order: IntArray,
    parent: IntArray,
    prismatic: BoolArray,
    axis: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    q: FloatArray,
    link: int,
    point: FloatArray,
    force: FloatArray,
    torque: FloatArray,
    where: FloatArray,
) -> None:
    n = q.shape[1]
    turn, place, jacobian = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((6, n))
    for row in range(len(q)):
        if force[row, 0] == 0.0 and force[row, 1] == 0.0 and force[row, 2] == 0.0:
            continue
        link_poses(order, parent, prismatic, axis, rotation, translation, q[row], turn, place)
        for a in range(3):
            where[row, a] = place[link, a]
            for b in range(3):
                where[row, a] += turn[link, a, b] * point[b]
        point_jacobian(parent, prismatic, axis, turn, place, link, where[row], jacobian)
        for j in range(n):
            for a in range(3):
                torque[row, j] += jacobian[a, j] * force[row, a]


class Kinematics:
    """Positions and Jacobians of a mechanism's links; the tool is the last frame of the chain."""

    def __init__(self, multibody: Multibody) -> None:
        tree = multibody.tree
        self.n = multibody.n
        self.tree = (tree.order, tree.parent, tree.prismatic, tree.axis, tree.rotation, tree.translation)
        self.last = int(tree.order[-1])
        turn, place = self.poses(np.zeros(self.n))
        _, tool = multibody.frame_pose(np.zeros(self.n))
        self.tool: FloatArray = turn[self.last].T @ (tool - place[self.last])

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the rotations (n, 3, 3) and origins (n, 3) [m] of all links at ``q`` (n,)."""
        turn, place = np.empty((self.n, 3, 3)), np.empty((self.n, 3))
        link_poses(*self.tree, np.ascontiguousarray(q), turn, place)
        return turn, place

    def jacobian(self, q: FloatArray, link: int, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the Jacobian (6, n) of ``point`` (3,) in the frame of ``link`` (from 0), and where it is (3,)."""
        turn, place = self.poses(q)
        where: FloatArray = place[link] + turn[link] @ point
        jacobian = np.empty((6, self.n))
        _, parent, prismatic, axis, _, _ = self.tree
        point_jacobian(parent, prismatic, axis, turn, place, link, where, jacobian)
        return jacobian, where

    def push_torques(
        self, q: FloatArray, link: int, point: FloatArray, force: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the joint torques (N, n) of forces (N, 3) on a link's point, and where that point is (N, 3).

        ``point`` (3,) is in the frame of ``link`` (from 0), the forces and places in the base frame; places are left
        at zero where the force is zero.
        """
        torque, where = np.zeros_like(q), np.zeros((len(q), 3))
        _push_torques(*self.tree, np.ascontiguousarray(q), link, point, np.ascontiguousarray(force), torque, where)
        return torque, where
