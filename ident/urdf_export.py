"""An identified URDF: the user's own, with the masses and inertias that were found."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.pseudo_inertia import inertia_of, pseudo_inertia
from ident.urdf import read_urdf


def write_urdf(
    source: Path, joints: Sequence[str], parameters: FloatArray, target: Path, geometry: bool = True
) -> None:
    """Write a URDF with other inertial parameters.

    What hangs rigidly on a moving link was identified together with it: its mass is in that link's, so its own
    ``<inertial>`` goes. Joints that are not among ``joints`` were locked at zero; they become fixed. Links that do
    not move, comments and everything else stay.

    Args:
        source: the robot's URDF.
        joints: its identified joints, in the order of the parameters.
        parameters: standard inertial parameters (10 n,), in Pinocchio's order about the joints' frames; feasible.
        target: file to write.
        geometry: keep visual and collision shapes; paths of meshes relative to the source are made relative to the
            target. Without it the file loads where the meshes are not, in MuJoCo too.

    Raises:
        InputError: the URDF is unreadable, lacks a joint, or no body has a link's parameters.
    """
    read_urdf(source).choose(joints, ())
    root = ET.parse(source, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))).getroot()
    links = {link.get("name", ""): link for link in root.findall("link")}
    children: dict[str, list[tuple[str, str]]] = {}
    for joint in root.findall("joint"):
        parent, child = _end(joint, "parent"), _end(joint, "child")
        children.setdefault(parent, []).append((joint.get("name", ""), child))
        if joint.get("type") != "fixed" and joint.get("name") not in joints:
            _fix(joint)
    for number, (name, values) in enumerate(zip(joints, np.reshape(parameters, (-1, 10)), strict=True)):
        carrier = next(child for pairs in children.values() for joint, child in pairs if joint == name)
        for link in _carried(carrier, children, joints):
            for inertial in links[link].findall("inertial"):
                links[link].remove(inertial)
        links[carrier].insert(0, _inertial(values, number + 1))
    for element in links.values():
        _move_geometry(element, source.parent, target.parent, geometry)
    ET.indent(root)
    ET.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)


def _end(joint: ET.Element, side: str) -> str:
    element = joint.find(side)
    return "" if element is None else element.get("link", "")


def _fix(joint: ET.Element) -> None:
    joint.set("type", "fixed")
    for tag in ("mimic", "limit", "axis", "dynamics", "safety_controller", "calibration"):
        for element in joint.findall(tag):
            joint.remove(element)


def _carried(link: str, children: dict[str, list[tuple[str, str]]], joints: Sequence[str]) -> list[str]:
    """Return the link and all that hangs rigidly on it."""
    found = [link]
    for joint, child in children.get(link, []):
        if joint not in joints:
            found += _carried(child, children, joints)
    return found


def _inertial(values: FloatArray, joint: int) -> ET.Element:
    matrix = pseudo_inertia(values)
    if np.linalg.eigvalsh(matrix)[0] <= 0.0:
        what = f"no body has the parameters of the link of joint {joint}"
        raise InputError(what, "identified URDF", "export the feasible parameters")
    mass, first = matrix[3, 3], matrix[:3, 3]
    inertia = inertia_of(matrix[:3, :3] - np.outer(first, first) / mass)
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "origin", xyz=" ".join(repr(float(x)) for x in first / mass), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(mass)))
    axes = "xyz"
    entries = {f"i{axes[a]}{axes[b]}": repr(float(inertia[a, b])) for a in range(3) for b in range(a, 3)}
    ET.SubElement(inertial, "inertia", entries)
    return inertial


def _move_geometry(link: ET.Element, source: Path, target: Path, keep: bool) -> None:
    for shape in [*link.findall("visual"), *link.findall("collision")]:
        if not keep:
            link.remove(shape)
        for mesh in shape.iter("mesh"):
            name = mesh.get("filename", "")
            if name and "://" not in name and not os.path.isabs(name):
                mesh.set("filename", os.path.relpath(source.resolve() / name, target.resolve()))
