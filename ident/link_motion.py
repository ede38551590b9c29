"""Compiled steps of ``rigid_body_kernels``: one motion sample, everything in the links' own frames.

A link's motion is its angular velocity and the velocity of its frame's origin, in its own axes. ``s_jk``, joint j's
unit twist seen from link k, is that motion per unit speed of joint j. By virtual power every quantity of joint j is a
sum over the links k that it carries, and linear in their ten parameters (Featherstone 2008, ch. 2 and 5):

    torque_j   = sum_k s_jk . (rate of change of link k's momentum)
    momentum_j = sum_k s_jk . (momentum of link k)
    [C^T dq]_j = sum_k (v_j x s_j)_k . (momentum of link k) = d(kinetic energy) / dq_j
    mass_ij    = sum_k s_ik . (momentum of link k per unit speed of joint j)

Twists are stored [angular, linear], (6,). A row of ten multiplies ``m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.compiled import compiled

Vector: TypeAlias = tuple[float, float, float]


class Chain(NamedTuple):
    """The tree as the kernels take it; ``supports[j, k]``: joint j carries link k, (n, n). See ``Tree``."""

    order: IntArray
    parent: IntArray
    prismatic: BoolArray
    axis: FloatArray
    rotation: FloatArray
    translation: FloatArray
    supports: BoolArray


class Work(NamedTuple):
    """Room for one sample.

    ``rotation`` (n, 3, 3), ``translation`` (n, 3): link k in its parent. ``omega``, ``velocity``, ``alpha``,
    ``acceleration`` (n, 3): motion of link k in its own axes, ``acceleration`` that of its origin, less gravity.
    ``twist``, ``bias`` (n, 6): one joint's unit twist s and ``v x s`` seen from each link. ``row`` (10,).
    """

    rotation: FloatArray
    translation: FloatArray
    omega: FloatArray
    velocity: FloatArray
    alpha: FloatArray
    acceleration: FloatArray
    twist: FloatArray
    bias: FloatArray
    row: FloatArray


@compiled
def room(n: int) -> Work:
    """Make room for a robot of n joints; one allocation, so that a single sample stays cheap."""
    block = np.empty(n * 36 + 10)
    vectors = block[12 * n : 24 * n].reshape(4, n, 3)
    twists = block[24 * n : 36 * n].reshape(2, n, 6)
    rotation, translation = block[: 9 * n].reshape(n, 3, 3), block[9 * n : 12 * n].reshape(n, 3)
    return Work(
        rotation, translation, vectors[0], vectors[1], vectors[2], vectors[3], twists[0], twists[1], block[36 * n :]
    )


@compiled
def _get(array: FloatArray, k: int, at: int) -> Vector:
    return array[k, at], array[k, at + 1], array[k, at + 2]


@compiled
def _put(array: FloatArray, k: int, at: int, value: Vector) -> None:
    array[k, at], array[k, at + 1], array[k, at + 2] = value


@compiled
def _add(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def _scale(a: Vector, factor: float) -> Vector:
    return a[0] * factor, a[1] * factor, a[2] * factor


@compiled
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _into(work: Work, k: int, a: Vector) -> Vector:
    """Turn a vector from the axes of link k's parent into those of link k."""
    r = work.rotation
    return (
        r[k, 0, 0] * a[0] + r[k, 1, 0] * a[1] + r[k, 2, 0] * a[2],
        r[k, 0, 1] * a[0] + r[k, 1, 1] * a[1] + r[k, 2, 1] * a[2],
        r[k, 0, 2] * a[0] + r[k, 1, 2] * a[1] + r[k, 2, 2] * a[2],
    )


@compiled
def place(chain: Chain, q: FloatArray, work: Work) -> None:
    """Place every link in its parent (Rodrigues' formula about the joint's axis)."""
    for k in range(len(q)):
        axis = _get(chain.axis, k, 0)
        slide = q[k] if chain.prismatic[k] else 0.0
        turn = q[k] - slide
        cosine, sine = np.cos(turn), np.sin(turn)
        for i in range(3):
            fixed = (chain.rotation[k, i, 0], chain.rotation[k, i, 1], chain.rotation[k, i, 2])
            along = _dot(fixed, axis)
            turned = _add(_scale(fixed, cosine), _scale(_cross(fixed, axis), sine))
            turned = _add(turned, _scale(axis, (1.0 - cosine) * along))
            work.rotation[k, i, 0], work.rotation[k, i, 1], work.rotation[k, i, 2] = turned
            work.translation[k, i] = chain.translation[k, i] + slide * along


@compiled
def velocities(chain: Chain, dq: FloatArray, work: Work) -> None:
    """Angular velocity of every link and velocity of its origin."""
    for k in chain.order:
        p = chain.parent[k]
        omega, velocity = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if p >= 0:
            omega = _get(work.omega, p, 0)
            velocity = _add(_get(work.velocity, p, 0), _cross(omega, _get(work.translation, k, 0)))
            omega, velocity = _into(work, k, omega), _into(work, k, velocity)
        own = _scale(_get(chain.axis, k, 0), dq[k])
        if chain.prismatic[k]:
            velocity = _add(velocity, own)
        else:
            omega = _add(omega, own)
        _put(work.omega, k, 0, omega)
        _put(work.velocity, k, 0, velocity)


@compiled
def accelerations(chain: Chain, dq: FloatArray, ddq: FloatArray, gravity: FloatArray, work: Work) -> None:
    """Angular acceleration of every link and acceleration of its origin, less gravity; after ``velocities``."""
    for k in chain.order:
        p = chain.parent[k]
        alpha, acceleration = (0.0, 0.0, 0.0), (-gravity[0], -gravity[1], -gravity[2])
        if p >= 0:
            arm, omega, alpha = _get(work.translation, k, 0), _get(work.omega, p, 0), _get(work.alpha, p, 0)
            acceleration = _add(_get(work.acceleration, p, 0), _cross(alpha, arm))
            acceleration = _add(acceleration, _cross(omega, _cross(omega, arm)))
        alpha, acceleration = _into(work, k, alpha), _into(work, k, acceleration)
        axis = _get(chain.axis, k, 0)
        own = _scale(axis, ddq[k])
        carried = _cross(_get(work.omega, k, 0), _scale(axis, dq[k]))  # the axis turns with the link
        if chain.prismatic[k]:
            acceleration = _add(_add(acceleration, own), _scale(carried, 2.0))  # Coriolis
        else:
            alpha = _add(_add(alpha, own), carried)
        _put(work.alpha, k, 0, alpha)
        _put(work.acceleration, k, 0, acceleration)


@compiled
def at_rest(chain: Chain, gravity: FloatArray, work: Work) -> None:
    """Acceleration less gravity of every link's origin, the robot standing still."""
    for k in chain.order:
        p = chain.parent[k]
        up = (-gravity[0], -gravity[1], -gravity[2])
        if p >= 0:
            up = _get(work.acceleration, p, 0)
        _put(work.acceleration, k, 0, _into(work, k, up))


@compiled
def unit_twist(chain: Chain, j: int, twist: FloatArray) -> None:
    """Joint j's unit twist, in its own link's row."""
    none = (0.0, 0.0, 0.0)
    axis = _get(chain.axis, j, 0)
    _put(twist, j, 0, none if chain.prismatic[j] else axis)
    _put(twist, j, 3, axis if chain.prismatic[j] else none)


@compiled
def bias(j: int, work: Work) -> None:
    """``v_j x s_j`` (motion cross product) in link j's row."""
    omega, velocity = _get(work.omega, j, 0), _get(work.velocity, j, 0)
    angular, linear = _get(work.twist, j, 0), _get(work.twist, j, 3)
    _put(work.bias, j, 0, _cross(omega, angular))
    _put(work.bias, j, 3, _add(_cross(velocity, angular), _cross(omega, linear)))


@compiled
def carry(chain: Chain, k: int, work: Work, twist: FloatArray) -> None:
    """Carry a twist from the row of link k's parent to that of link k."""
    p = chain.parent[k]
    angular = _get(twist, p, 0)
    linear = _add(_get(twist, p, 3), _cross(angular, _get(work.translation, k, 0)))
    _put(twist, k, 0, _into(work, k, angular))
    _put(twist, k, 3, _into(work, k, linear))


@compiled
def _inertia_entries(s: Vector, w: Vector, row: FloatArray) -> None:
    """Add ``s . I w`` in the six entries of I."""
    row[4] += s[0] * w[0]
    row[5] += s[0] * w[1] + s[1] * w[0]
    row[6] += s[1] * w[1]
    row[7] += s[0] * w[2] + s[2] * w[0]
    row[8] += s[1] * w[2] + s[2] * w[1]
    row[9] += s[2] * w[2]


@compiled
def force_row(k: int, work: Work, row: FloatArray) -> None:
    """Write the row that gives ``s_jk . (rate of change of link k's momentum)``."""
    angular, linear = _get(work.twist, k, 0), _get(work.twist, k, 3)
    omega, alpha, acceleration = _get(work.omega, k, 0), _get(work.alpha, k, 0), _get(work.acceleration, k, 0)
    row[0] = _dot(linear, acceleration)
    first = _add(_cross(linear, alpha), _cross(omega, _cross(omega, linear)))
    row[1], row[2], row[3] = _add(first, _cross(acceleration, angular))
    row[4:] = 0.0
    _inertia_entries(angular, alpha, row)
    _inertia_entries(_cross(angular, omega), omega, row)


@compiled
def momentum_row(s: FloatArray, k: int, work: Work, row: FloatArray) -> None:
    """Write the row that gives ``s_k . (momentum of link k)``."""
    angular, linear = _get(s, k, 0), _get(s, k, 3)
    omega, velocity = _get(work.omega, k, 0), _get(work.velocity, k, 0)
    row[0] = _dot(linear, velocity)
    row[1], row[2], row[3] = _add(_cross(linear, omega), _cross(velocity, angular))
    row[4:] = 0.0
    _inertia_entries(angular, omega, row)


@compiled
def weight_row(k: int, work: Work, row: FloatArray) -> None:
    """Write the four entries (m, mc) of the row that gives ``s_jk . (minus the weight of link k)``."""
    up = _get(work.acceleration, k, 0)
    row[0] = _dot(_get(work.twist, k, 3), up)
    row[1], row[2], row[3] = _cross(up, _get(work.twist, k, 0))


@compiled
def value(row: FloatArray, parameters: FloatArray, j: int, k: int, entries: int) -> float:
    """First ``entries`` of the row times link k's parameters as joint j knows them."""
    total = 0.0
    for i in range(entries):
        total += row[i] * parameters[j, 10 * k + i]
    return total
