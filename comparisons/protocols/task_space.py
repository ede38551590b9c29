"""Via-point paths planned in task space and turned into joint motion that keeps the limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from comparisons.protocols.excitation import limits
from comparisons.protocols.smoothing import ButterworthSmoothing
from comparisons.virtual_robot.kinematics import Kinematics, link_poses, point_jacobian
from ident.arrays import BoolArray, FloatArray, IntArray
from ident.compiled import compiled
from ident.robot import Robot

EDGE = 1.2  # times the range that `limits` gives is never left: 96 % of the joint limits
LEG = 3.0  # [s] from one via point to the next, on average
FASTEST = 0.75  # of the speed that `limits` gives
CUTOFF = 2.0  # [Hz] of the Butterworth filter on the joint path
BLEND = 0.6  # speed along the path swings by this share
SWING = 37.0  # [s] in which it does so
SPREAD = 0.95  # of the joint ranges from which via points are drawn
POSTURE = 0.4  # pull [m or rad] of the joints towards the via points' own postures, against that of the tool's path
GROWTH = 100.0  # of that pull at the end of a joint's range
PULL = 8.0  # [1/s] at which errors of tool and posture are closed
VIAS = 64  # via points planned at a time


@compiled
def _orientation_error(turn: FloatArray, wanted: FloatArray, error: FloatArray) -> None:
    """Write half the sum of cross products of the axes: the rotation vector to the wanted axes, for small angles."""
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        error[3 + a] = 0.0
        for k in range(3):
            error[3 + a] += 0.5 * (turn[b, k] * wanted[c, k] - turn[c, k] * wanted[b, k])


@compiled
def _solve(matrix: FloatArray, right: FloatArray) -> None:
    """Solve a positive definite system in place by Cholesky factors; the answer is left in ``right``."""
    n = len(right)
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]
    for i in range(n):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]


@compiled
def _track(
    tree: tuple[IntArray, IntArray, BoolArray, FloatArray, FloatArray, FloatArray],
    last: int,
    tool: FloatArray,
    place: FloatArray,
    axes: FloatArray,
    posture: FloatArray,
    phase: FloatArray,
    q: FloatArray,
    velocity: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    dt: float,
    out: FloatArray,
) -> None:
    """Follow B-splines through via ``place`` (K, 3), ``axes`` (K, 3, 3), ``posture`` (K, n); ``phase`` counts vias."""
    order, parent, prismatic, axis, rotation, translation = tree
    n = len(q)
    turns, places, jacobian = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((6, n))
    point, error, wanted = np.empty(3), np.empty(6), np.empty((3, 3))
    normal, step = np.empty((n, n)), np.empty(n)
    for row in range(len(phase)):
        k = int(phase[row])
        u = phase[row] - k
        v = 1.0 - u
        weights = (v**3 / 6, (3 * u**3 - 6 * u**2 + 4) / 6, (3 * v**3 - 6 * v**2 + 4) / 6, u**3 / 6)
        link_poses(order, parent, prismatic, axis, rotation, translation, q, turns, places)
        for a in range(3):
            point[a] = places[last, a]
            error[a] = 0.0
            for b in range(3):
                point[a] += turns[last, a, b] * tool[b]
                wanted[a, b] = 0.0
        for i in range(4):
            for a in range(3):
                error[a] += weights[i] * place[k + i, a]
                for b in range(3):
                    wanted[a, b] += weights[i] * axes[k + i, a, b]
        for a in range(3):
            error[a] -= point[a]
        _orientation_error(turns[last], wanted, error)
        point_jacobian(parent, prismatic, axis, turns, places, last, point, jacobian)
        for i in range(n):
            aim = 0.0
            for w in range(4):
                aim += weights[w] * posture[k + w, i]
            # the pull grows towards the end of the range, so that no joint comes to lie against its stop
            out_of = (2.0 * q[i] - lower[i] - upper[i]) / (upper[i] - lower[i])
            pull = POSTURE**2 * (1.0 + GROWTH * out_of**16)
            step[i] = pull * PULL * (aim - q[i])
            for a in range(6):
                step[i] += jacobian[a, i] * PULL * error[a]
            for j in range(i + 1):
                normal[i, j] = pull if i == j else 0.0
                for a in range(6):
                    normal[i, j] += jacobian[a, i] * jacobian[a, j]
        _solve(normal, step)
        for i in range(n):
            speed = min(max(step[i], -velocity[i]), velocity[i])
            q[i] = min(max(q[i] + dt * speed, lower[i]), upper[i])
            out[row, i] = q[i]


def via_point_motion(robot: Robot, rate: float, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Yield joint positions (N, n) along a path through random via points in task space, without end.

    Via poses are tool poses of random postures, joined by cubic B-splines in position and axes; damped least squares
    turns them into joint speeds within 60 % of the limits, a third-order Butterworth filter smooths the result.
    """
    middle, half, velocity, _ = limits(robot)
    kinematics = Kinematics(robot.multibody)
    lower, upper = middle - EDGE * half, middle + EDGE * half
    first = middle + SPREAD * half * rng.uniform(-1.0, 1.0, robot.n)
    posture = np.tile(first, (3, 1))
    smoothing = ButterworthSmoothing(CUTOFF, rate, first)
    q, clock, phase = first.copy(), rng.uniform(0.0, SWING), 0.0
    while True:
        fresh = middle + SPREAD * half * rng.uniform(-1.0, 1.0, (VIAS, robot.n))
        posture = np.concatenate([posture[-3:], fresh])
        poses = [kinematics.poses(p) for p in posture]
        axes = np.array([turns[kinematics.last] for turns, _ in poses])
        place = np.array([p[kinematics.last] + t[kinematics.last] @ kinematics.tool for t, p in poses])
        times = clock + np.arange(round(VIAS * LEG * rate / (1.0 - BLEND))) / rate
        ahead = phase + np.cumsum((1.0 + BLEND * np.sin(2.0 * np.pi * times / SWING)) / (LEG * rate))
        ahead = ahead[ahead < VIAS]
        out = np.empty((len(ahead), robot.n))
        tool, last, fastest = kinematics.tool, kinematics.last, FASTEST * velocity
        _track(kinematics.tree, last, tool, place, axes, posture, ahead, q, fastest, lower, upper, 1.0 / rate, out)
        clock, phase = float(times[len(ahead)]), float(ahead[-1]) - VIAS
        yield smoothing.smooth(out)
