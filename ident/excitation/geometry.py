"""What an arm may touch: convex bodies on its links, the ground and the walls around it, read for coal by Pinocchio."""

from __future__ import annotations

import os
import warnings
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import FloatArray, IntArray
from ident.errors import InputError
from ident.multibody import Multibody
from ident.urdf import read_urdf

MESH_SCHEMES = ("package://", "model://", "file://")


@dataclass(frozen=True)
class Surroundings:
    """Where the arm may move, in its base frame.

    Attributes:
        ground: height [m] of the plane it must stay above; None for none.
        lower, upper: opposite corners [m] of the box it must stay in, (3,); infinite where open.
        clearance: distance [m] to keep from ground, walls and itself.
    """

    ground: float | None = 0.0
    lower: tuple[float, float, float] = (-np.inf, -np.inf, -np.inf)
    upper: tuple[float, float, float] = (np.inf, np.inf, np.inf)
    clearance: float = 0.02

    def __post_init__(self) -> None:
        if not np.all(np.less(self.lower, self.upper)):
            raise InputError(f"box from {self.lower} to {self.upper}", "work space", "give its lower corner first")
        if not self.clearance >= 0:
            raise InputError(f"clearance {self.clearance}", "work space", "give metres, not negative")

    def planes(self) -> list[tuple[str, FloatArray, float]]:
        """Name, outward normal n (3,) and offset d [m] of each plane; forbidden is where ``n @ x > d``."""
        low, high = np.array(self.lower), np.array(self.upper)
        found = [] if self.ground is None else [("the ground", np.array([0.0, 0.0, -1.0]), -self.ground)]
        for k, axis in enumerate("xyz"):
            found += [(f"the wall at {axis} = {low[k]:g} m", -np.eye(3)[k], -low[k])] if np.isfinite(low[k]) else []
            found += [(f"the wall at {axis} = {high[k]:g} m", np.eye(3)[k], high[k])] if np.isfinite(high[k]) else []
        return found


@dataclass(frozen=True, eq=False)
class Body:
    """A convex body on a link.

    Attributes:
        link: its name.
        joint: that carries it, -1 the base.
        points: whose convex hull holds it, in the frame of the joint [m], (k, 3).
    """

    link: str
    joint: int
    points: FloatArray

    @property
    def radius(self) -> float:
        """Distance [m] of its farthest point from the joint's origin."""
        return float(np.linalg.norm(self.points, axis=1).max())


@dataclass(frozen=True, eq=False)
class ArmGeometry:
    """Collision geometry of an arm, every mesh replaced by its convex hull.

    Attributes:
        model: Pinocchio's geometry model of the arm with its joints locked as in ``Multibody``.
        bodies: what it holds, in its order.
        missing: meshes that were not found, whose links are therefore not watched.
    """

    model: Any
    bodies: tuple[Body, ...]
    missing: tuple[str, ...]

    @staticmethod
    def from_urdf(path: Path, multibody: Multibody) -> ArmGeometry:
        """Read the collision geometry of a URDF.

        Meshes are looked for beside the URDF, in every folder above it taken as a package folder, and in those of
        ``ROS_PACKAGE_PATH``.

        Raises:
            InputError: the URDF or one of its meshes cannot be read.
        """
        urdf = read_urdf(path)
        folders = [folder for folder in path.resolve().parents if folder != folder.parent]
        folders += [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        text, missing = _with_meshes_found(path, folders)
        full = pin.buildModelFromXML(urdf.text)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # Pinocchio warns of its own overload
                geometry = pin.buildGeomFromUrdfString(full, text, pin.COLLISION, [str(f) for f in folders])
        except Exception as error:
            what = f"collision geometry that Pinocchio cannot read ({' '.join(str(error).split())})"
            raise InputError(what, str(path), "mend the meshes or remove their <collision>") from error
        locked = [k for k, name in enumerate(full.names) if k > 0 and name not in multibody.joint_names]
        _, geometry = pin.buildReducedModel(full, geometry, locked, pin.neutral(full))
        for each in geometry.geometryObjects:
            each.geometry = _convex(each.geometry)
        card = {multibody.model.getJointId(name): k for k, name in enumerate(multibody.joint_names)}
        frames = multibody.model.frames
        bodies = tuple(
            Body(frames[o.parentFrame].name, card.get(o.parentJoint, -1), _points(o)) for o in geometry.geometryObjects
        )
        return ArmGeometry(geometry, bodies, missing)

    def with_planes(self, planes: list[tuple[str, FloatArray, float]]) -> tuple[Any, IntArray]:
        """Return a geometry model with the planes added, and where each of them stands in it."""
        model = self.model.copy()
        places = []
        for name, normal, offset in planes:
            plane = pin.GeometryObject(name, 0, pin.SE3.Identity(), coal.Halfspace(-normal, -float(offset)))
            places.append(model.addGeometryObject(plane))
        return model, np.array(places, dtype=np.int64)


def _with_meshes_found(path: Path, folders: list[Path]) -> tuple[str, tuple[str, ...]]:
    """Return the URDF's text without the collision meshes that are not there, and the names of those."""
    root = ET.parse(path).getroot()
    missing = []
    for link in root.findall("link"):
        for collision in link.findall("collision"):
            mesh = collision.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            bare = name
            for scheme in MESH_SCHEMES:
                bare = bare.removeprefix(scheme)
            found = next((p for p in [Path(bare), *(f / bare for f in folders)] if p.is_file()), None)
            if found is None:
                missing.append(name)
                link.remove(collision)
            else:
                mesh.set("filename", str(found.resolve()))
    return ET.tostring(root, encoding="unicode"), tuple(missing)


def _convex(shape: Any) -> Any:
    """Convex hull of a mesh; a primitive is convex already."""
    if isinstance(shape, coal.BVHModelBase):
        shape.buildConvexHull(True, "Qt")
        return shape.convex
    return shape


def _points(geometry: Any) -> FloatArray:
    """Points whose convex hull holds a body (a ball is within its cube), in its joint's frame, (k, 3)."""
    shape, placement = geometry.geometry, geometry.placement
    if isinstance(shape, coal.ConvexBase):
        points = np.array(shape.points())
    else:
        shape.computeLocalAABB()
        low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
        if isinstance(shape, coal.Cylinder):
            turn = np.arange(16) * (np.pi / 8)
            ring = np.column_stack([np.cos(turn), np.sin(turn)]) * (shape.radius / np.cos(np.pi / 16))
            points = np.vstack([np.column_stack([ring, np.full(16, z)]) for z in (low[2], high[2])])
        else:
            points = np.array(
                [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
            )
    placed: FloatArray = points @ np.array(placement.rotation).T + np.array(placement.translation)
    return placed
