"""A page that shows the arm making a motion; it opens offline and needs no library."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from ident.arrays import FloatArray, IntArray
from ident.excitation.geometry import ArmGeometry, Surroundings
from ident.multibody import Multibody
from ident.signals import Motion

TEMPLATE = "arm_view.html"
FRAMES_PER_SECOND = 25.0
STICK = 0.02  # [m] half width of the bars drawn for links without geometry


def write_arm_view(
    path: Path,
    title: str,
    multibody: Multibody,
    geometry: ArmGeometry | None,
    motion: Motion,
    surroundings: Surroundings,
) -> None:
    """Write the page.

    Args:
        path: of the page.
        title: of the page.
        multibody: the arm.
        geometry: its bodies; without them bars between the joints are drawn.
        motion: what it does.
        surroundings: whose ground is drawn.
    """
    step = max(1, round(1.0 / (FRAMES_PER_SECOND * float(np.median(np.diff(motion.t))))))
    rows = np.unique(np.append(np.arange(0, len(motion), step), len(motion) - 1))
    scene = {
        "times": np.round(motion.t[rows], 4).tolist(),
        "poses": [_poses(multibody, q) for q in motion.q[rows]],
        "bodies": _bodies(multibody, geometry),
        "path": [np.round(multibody.frame_pose(q)[1], 4).tolist() for q in motion.q[rows]],
        "ground": surroundings.ground,
    }
    page = (Path(__file__).parent / TEMPLATE).read_text(encoding="utf-8")
    data = json.dumps(scene, separators=(",", ":")).replace("<", "\\u003c")
    safe = title.replace("&", "&amp;").replace("<", "&lt;")
    path.write_text(page.replace("@TITLE@", safe).replace("@SCENE@", data), encoding="utf-8")


def _poses(multibody: Multibody, q: FloatArray) -> list[list[float]]:
    """Rotation row by row, then origin, of every joint's frame in the base."""
    found = []
    for name in multibody.joint_names:
        rotation, origin = multibody.frame_pose(q, name)
        found.append(np.round(np.concatenate([rotation.ravel(), origin]), 4).tolist())
    return found


def _bodies(multibody: Multibody, geometry: ArmGeometry | None) -> list[dict[str, object]]:
    """Triangles of every body, in the frame of the joint that carries it."""
    points = [] if geometry is None else [(body.joint, body.points) for body in geometry.bodies]
    if not points:
        points = [(int(tree_parent), _bar(end)) for tree_parent, end in _bars(multibody)]
    found: list[dict[str, object]] = []
    for joint, corners in points:
        hull = ConvexHull(corners)
        used, places = np.unique(hull.simplices, return_inverse=True)
        faces = _outward(corners[used], places.reshape(-1, 3).astype(np.int64))
        found.append({"joint": joint, "points": np.round(corners[used], 4).tolist(), "faces": faces.tolist()})
    return found


def _bars(multibody: Multibody) -> list[tuple[int, FloatArray]]:
    """Joint that carries a bar and the bar's far end, from each joint to those it carries."""
    tree = multibody.tree
    return [
        (int(tree.parent[k]), tree.translation[k])
        for k in range(multibody.n)
        if float(np.linalg.norm(tree.translation[k])) > STICK
    ]


def _bar(end: FloatArray) -> FloatArray:
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * STICK
    return np.vstack([cube, cube + end])


def _outward(points: FloatArray, faces: IntArray) -> IntArray:
    """Turn triangles so that their corners run counter-clockwise seen from outside."""
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, corners[:, 0] - points.mean(axis=0)) < 0
    turned = faces.copy()
    turned[inward] = faces[inward][:, ::-1]
    return turned
