"""A smooth stand-in for the distances of an arm's bodies: balls that cover them, for the optimiser alone.

What the optimiser returns is examined with the bodies themselves (``clearance``); the balls need only be about right.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial import ConvexHull

from ident.arrays import FloatArray, IntArray
from ident.excitation.clearance import STEADY, ClearanceModel
from ident.symbolic import base_poses

MOST = 4  # balls along a body
DENSITY = 40  # points along the longest side of a body from which its balls are made
SHARPNESS = 120.0  # [1/m] of the smooth minimum over the pairs of a pose
NEAR = 0.1  # [m] distances at which the balls are levelled with the bodies
CAUTION = 0.25  # quantile of the shortfall that is made up for
MOST_STRETCH = 3.0
POSES = 300
SEED = 1


@dataclass(frozen=True, eq=False)
class Balls:
    """Balls of one body: centres (k, 3) and radius (k,) [m] in the frame of its joint."""

    joint: int
    centres: FloatArray
    radius: FloatArray


def cover(joint: int, points: FloatArray) -> Balls:
    """Cover the convex hull of points (k, 3) with balls in a row along its longest axis."""
    hull = ConvexHull(points)
    surface = _on_triangles(points[hull.simplices])
    middle = surface.mean(axis=0)
    axes = np.linalg.svd(surface - middle, full_matrices=False)[2]
    along = (surface - middle) @ axes.T
    extent = np.ptp(along, axis=0)
    count = int(np.clip(round(extent[0] / max(extent[1], 1e-6)), 1, MOST))
    cell = np.clip(((along[:, 0] - along[:, 0].min()) / extent[0] * count).astype(int), 0, count - 1)
    groups = [surface[cell == k] for k in range(count)]
    centres = np.array([0.5 * (g.min(axis=0) + g.max(axis=0)) for g in groups])
    radius = np.array([np.linalg.norm(g - c, axis=1).max() for g, c in zip(groups, centres, strict=True)])
    return Balls(joint, centres, radius)


def gap(model: ClearanceModel, span: FloatArray) -> ca.Function | None:
    """Smooth least gap over all pairs beyond their clearance [m], as a function of q (n, 1); None without pairs.

    Each pair's gap between balls is shifted by how much it falls short of the bodies' own distance where they are
    near, over random poses in ``span`` (2, n). Pairs whose distance never changes are left out, and gaps of pairs
    built close count in proportion to what they keep: a smooth minimum over several gaps that are small in every pose
    would be below zero everywhere.
    """
    if not model.watched():
        return None
    q = ca.SX.sym("q", model.multibody.n)
    gaps = _pair_gaps(model, q)
    shift, changing = _shift(model, ca.Function("gaps", [q], [gaps], {"cse": True}), span)
    if not len(changing):
        return None
    # Built close is what keeps less than the clearance; pairs that keep nothing are not stretched without end.
    stretch = np.minimum(model.surroundings.clearance / np.maximum(model.wanted, 1e-9), MOST_STRETCH)
    beyond = ((gaps + ca.DM(shift - model.wanted)) * ca.DM(stretch))[changing.tolist()]
    least = ca.mmin(beyond)
    smooth = least - ca.log(ca.sum1(ca.exp(-SHARPNESS * (beyond - least)))) / SHARPNESS
    return ca.Function("gap", [q], [smooth], {"cse": True})


def _pair_gaps(model: ClearanceModel, q: ca.SX) -> ca.SX:
    """Least gap between the balls of each pair, (P, 1)."""
    covers = [cover(body.joint, body.points) for body in model.geometry.bodies]
    poses = base_poses(model.multibody.tree, q)
    centres = []
    for balls in covers:
        local = ca.SX(ca.DM(balls.centres.T))
        if balls.joint >= 0:
            rotation, origin = poses[balls.joint]
            local = rotation @ local + ca.repmat(origin, 1, local.shape[1])
        centres.append(local)
    planes = model.surroundings.planes()
    rows = []
    for a, b in model.pairs:
        mine = centres[a]
        if b >= len(covers):
            _, normal, offset = planes[b - len(covers)]
            distances = [offset - ca.dot(ca.DM(normal), mine[:, i]) - r for i, r in enumerate(covers[a].radius)]
        else:
            distances = [
                ca.sqrt(ca.sumsqr(mine[:, i] - centres[b][:, k]) + 1e-8) - r - s
                for i, r in enumerate(covers[a].radius)
                for k, s in enumerate(covers[b].radius)
            ]
        rows.append(ca.mmin(ca.vertcat(*distances)))
    gaps: ca.SX = ca.vertcat(*rows)
    return gaps


def _shift(model: ClearanceModel, gaps: ca.Function, span: FloatArray) -> tuple[FloatArray, IntArray]:
    """Shortfall of each pair's balls where its bodies are near, (P,), and the pairs whose distance changes."""
    q = np.random.default_rng(SEED).uniform(span[0], span[1], (POSES, model.multibody.n))
    true = np.array([model.distances(pose) for pose in q])
    balls = gaps(q.T).full().T if len(model.pairs) > 1 else gaps(q.T).full().reshape(-1, 1)
    shift = np.zeros(len(model.pairs))
    for p in range(len(shift)):
        near = np.abs(true[:, p]) < NEAR
        if not np.any(near):
            near = true[:, p] <= np.quantile(true[:, p], 0.1)
        shift[p] = np.quantile(true[near, p] - balls[near, p], CAUTION)
    return shift, np.flatnonzero(np.ptp(true, axis=0) > STEADY)


def _on_triangles(corners: FloatArray) -> FloatArray:
    """Points spread over triangles (k, 3, 3), denser than a fraction of the whole's size."""
    size = np.ptp(corners.reshape(-1, 3), axis=0).max()
    found = [corners.reshape(-1, 3)]
    for triangle in corners:
        edge = max(np.linalg.norm(triangle[0] - triangle[1]), np.linalg.norm(triangle[0] - triangle[2]))
        steps = int(np.clip(np.ceil(edge / size * DENSITY), 1, DENSITY))
        u, v = np.meshgrid(np.arange(steps + 1) / steps, np.arange(steps + 1) / steps)
        inside = u + v <= 1.0
        u, v = u[inside], v[inside]
        found.append(np.outer(1 - u - v, triangle[0]) + np.outer(u, triangle[1]) + np.outer(v, triangle[2]))
    return np.vstack(found)
