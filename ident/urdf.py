"""What a URDF says about its joints, read before Pinocchio is asked to build it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class UrdfJoint:
    """A movable joint: its kind, the joint it mimics if any, and its limits (inf where the URDF gives none)."""

    name: str
    kind: str
    mimics: str | None
    lower: float
    upper: float
    velocity: float
    effort: float


@dataclass(frozen=True)
class Urdf:
    """A URDF's movable joints, and its text without geometry and with continuous joints as unlimited revolute ones.

    Dynamics need no meshes, and an angle a joint is what logs hold, where Pinocchio keeps a continuous joint as the
    cosine and sine of it.
    """

    path: Path
    text: str
    joints: dict[str, UrdfJoint]

    def choose(self, wanted: Sequence[str] | None, default_order: Sequence[str]) -> tuple[str, ...]:
        """Return the wanted joints, or those that do not mimic in ``default_order``.

        Raises:
            InputError: a wanted joint does not exist, mimics another or is named twice, or the robot has no joint.
        """
        free = [name for name in default_order if self.joints[name].mimics is None]
        if wanted is None:
            wanted = free
        for name in wanted:
            if name not in self.joints:
                raise InputError(f"no movable joint {name!r}", str(self.path), f"name joints among {', '.join(free)}")
            if self.joints[name].mimics is not None:
                what = f"joint {name!r} mimics {self.joints[name].mimics!r}"
                raise InputError(what, str(self.path), "name the joint that it follows")
        if len(set(wanted)) < len(wanted):
            twice = next(name for name in wanted if list(wanted).count(name) > 1)
            raise InputError(f"joint {twice!r} is named twice", str(self.path), "name each joint once")
        if not wanted:
            raise InputError("the robot has no joint that moves", str(self.path), "give the URDF of an arm")
        return tuple(wanted)

    def limits(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Lower and upper position, velocity and effort limits of the named joints, each (n,)."""
        rows = [(j.lower, j.upper, j.velocity, j.effort) for j in (self.joints[name] for name in names)]
        lower, upper, velocity, effort = np.array(rows, dtype=float).T.copy()
        return lower, upper, velocity, effort


def read_urdf(path: Path) -> Urdf:
    """Read a URDF file.

    Raises:
        InputError: the file is missing, is not XML, has no ``<robot name=...>``, or has a joint that is neither fixed
            nor revolute, continuous or prismatic.
    """
    try:
        root = ET.parse(path).getroot()
    except OSError as error:
        raise InputError(f"the URDF cannot be read ({error.strerror})", str(path), "give the path of a file") from error
    except (ET.ParseError, UnicodeError, ValueError) as error:
        raise InputError(f"the URDF is not valid XML ({error})", str(path), "mend the file") from error
    if root.tag != "robot":
        raise InputError(f"the root element is <{root.tag}>", str(path), "give a URDF, whose root is <robot name=...>")
    if not root.get("name"):
        raise InputError("the <robot> element has no name", str(path), "write <robot name=...>")
    joints = {}
    for element in root.findall("joint"):
        joint = _joint(element, path)
        if joint is not None:
            joints[joint.name] = joint
            element.set("type", "prismatic" if joint.kind == "prismatic" else "revolute")
    _strip_geometry(root)
    return Urdf(path, ET.tostring(root, encoding="unicode"), joints)


def _joint(element: ET.Element, path: Path) -> UrdfJoint | None:
    name, kind = element.get("name", ""), element.get("type", "")
    if kind == "fixed":
        return None
    if kind not in MOVING:
        what = f"joint {name!r} is {kind or 'of no type'}"
        raise InputError(what, str(path), "make it revolute, continuous, prismatic or fixed; the base must be fixed")
    limit = element.find("limit")
    if kind == "continuous" and limit is None:
        limit = ET.SubElement(element, "limit", effort="0", velocity="0")
    values = {key: _number(limit, key, name, path) for key in ("lower", "upper", "velocity", "effort")}
    lower, upper = values["lower"], values["upper"]
    if kind == "continuous" or lower >= upper:  # a URDF that leaves both out means 0 and 0
        lower, upper = -np.inf, np.inf
    mimic = element.find("mimic")
    return UrdfJoint(
        name,
        kind,
        None if mimic is None else mimic.get("joint", ""),
        lower,
        upper,
        values["velocity"] or np.inf,
        values["effort"] or np.inf,
    )


def _number(limit: ET.Element | None, key: str, joint: str, path: Path) -> float:
    text = "0" if limit is None else limit.get(key, "0")
    try:
        return float(text)
    except ValueError as error:
        what = f"limit {key} of joint {joint!r} is {text!r}"
        raise InputError(what, str(path), "write a number") from error


def _strip_geometry(root: ET.Element) -> None:
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                link.remove(shape)
