"""A current model as a readable file."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import FloatArray
from ident.effects import load_catalogue
from ident.effects.base import Effect, Term
from ident.errors import InputError
from ident.model import CurrentModel
from ident.robot import Robot

FILE = "model.json"
FORMAT = 1

NUMBERS = re.compile(r"\[\s+[-+.e\d]+(,\s+[-+.e\d]+)*\s+\]")
"""A list of numbers, which takes one line."""

ELSEWHERE = 1e-3
"""A joint that lies further [m] from where the model's URDF has it is another robot's."""

DIGITS = 4
"""Significant digits of errors."""


def save_model(model: CurrentModel, folder: Path) -> None:
    """Write the model to ``folder/model.json``: effects, parameters with units, standard deviations, joint errors.

    Args:
        model: what to write.
        folder: that is there already.
    """
    content = {
        "format": FORMAT,
        "robot": model.robot.name,
        "joints": list(model.robot.joints),
        "origins": np.round(model.robot.multibody.tree.translation, 6).tolist(),
        "unit": model.unit,
        "force_unit": model.force_unit,
        "gain": model.gain.tolist(),
        "cutoff_hertz": model.cutoff,
        "rate_hertz": model.rate,
        "positions_only": model.positions_only,
        "terms": [_write(model, term) for term in model.terms],
    }
    written = json.dumps(content, indent=1)
    (folder / FILE).write_text(NUMBERS.sub(lambda row: "[" + " ".join(row.group()[1:-1].split()) + "]", written) + "\n")


def load_model(folder: str | Path, robot: Robot) -> CurrentModel:
    """Read a model that ``save_model`` wrote.

    Args:
        folder: that holds model.json, as identify and gap write it, or that file.
        robot: that the model was identified of.

    Raises:
        InputError: there is no model, it cannot be read, or it belongs to another robot.
    """
    path = Path(folder) if Path(folder).name == FILE else Path(folder) / FILE
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise InputError("no model", str(path), "give the folder that identify, gap or train wrote") from error
    except ValueError as error:
        raise InputError(f"not a model file ({error})", str(path), "identify again") from error
    if not isinstance(content, dict):
        raise InputError("not a model file (no table)", str(path), "identify again")
    for key, here in (("joints", list(robot.joints)), ("unit", robot.unit)):
        there = content.get(key, "(none)")
        if there != here:
            are = "are" if key == "joints" else "is"
            what = f"the model's {key} {there} {are} not the robot's {here}"
            raise InputError(what, str(path), "give this robot's model")
    try:
        _check_origins(robot, content, path)
        return CurrentModel(
            robot,
            _terms(robot, content["terms"], path),
            float(content["cutoff_hertz"]),
            float(content["rate_hertz"]),
            np.array(content["gain"], dtype=float),
            content["force_unit"],
            bool(content.get("positions_only", False)),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"the model lacks or spoils {error}", str(path), "identify again") from error


def _check_origins(robot: Robot, content: dict[str, Any], path: Path) -> None:
    """Refuse a model of other links; where the base stands is nobody's concern, nor is it of files without origins."""
    tree = robot.multibody.tree
    there = np.array(content.get("origins", tree.translation), dtype=float)
    off = np.linalg.norm(there - tree.translation, axis=1) * (tree.parent >= 0)
    joint = int(np.argmax(off))
    if off[joint] > ELSEWHERE:
        what = f"joint {joint + 1} lies {off[joint]:.3g} m elsewhere in its link than in the model's URDF"
        raise InputError(what, str(path), f"give a model of {robot.name}, or the URDF it was identified with")


def _write(model: CurrentModel, term: Term) -> dict[str, Any]:
    effect = term.effect
    options = {f.name: getattr(effect, f.name) for f in fields(effect) if f.name != "joint"}
    return {
        "effect": effect.name,
        "joint": None if effect.joint is None else effect.joint + 1,
        **({"options": options} if options else {}),
        "shape": [
            {"name": s.name, "value": v, "std": _number(d), "unit": model.unit_of(effect, s)}
            for s, v, d in zip(effect.shapes, term.shape.tolist(), term.shape_std.tolist(), strict=True)
        ],
        "coefficients": [
            {"name": c.name, "value": v, "std": _number(d), "unit": model.unit_of(effect, c)}
            for c, v, d in zip(
                effect.coefficients(model.robot), term.coefficients.tolist(), term.std.tolist(), strict=True
            )
        ],
        **({"errors": [[_rounded(e) for e in row] for row in term.errors.tolist()]} if term.errors.size else {}),
    }


def _terms(robot: Robot, written: list[dict[str, Any]], path: Path) -> tuple[Term, ...]:
    terms = tuple(_read(robot, term, path) for term in written)
    if len({term.errors.shape[1] for term in terms} - {0}) > 1:
        raise ValueError("errors, of which some terms have more than others")
    return terms


def _read(robot: Robot, written: dict[str, Any], path: Path) -> Term:
    kinds = load_catalogue()
    if written["effect"] not in kinds:
        what = f"unknown effect {written['effect']!r}"
        raise InputError(what, str(path), "import the module that defines it, or update sensorless")
    options = {k: tuple(v) if isinstance(v, list) else v for k, v in written.get("options", {}).items()}
    joint = None if written["joint"] is None else int(written["joint"]) - 1
    if joint is not None and not 0 <= joint < robot.n:
        raise ValueError(f"joint {joint + 1}")
    effect: Effect = kinds[written["effect"]](joint, **options)
    if [s["name"] for s in written["shape"]] != [s.name for s in effect.shapes]:
        raise InputError(f"another version's law of {effect.name}", str(path), "identify again")
    names = [c["name"] for c in written["coefficients"]]
    if names != [c.name for c in effect.coefficients(robot)]:
        what = f"parameters of {effect.name} do not fit the robot's URDF"
        raise InputError(what, str(path), "give the URDF that the model was identified with")
    return Term(
        effect,
        np.array([s["value"] for s in written["shape"]], dtype=float),
        np.array([c["value"] for c in written["coefficients"]], dtype=float),
        np.array([np.nan if c["std"] is None else c["std"] for c in written["coefficients"]], dtype=float),
        np.array([np.nan if s["std"] is None else s["std"] for s in written["shape"]], dtype=float),
        _errors(written, len(names)),
    )


def _errors(written: dict[str, Any], count: int) -> FloatArray:
    """Errors (count, k) of a term's coefficients; none where they were not known."""
    if "errors" not in written:
        return np.zeros((count, 0))
    try:
        found = np.array(written["errors"], dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.ndim != 2 or len(found) != count or not np.isfinite(found).all():
        raise ValueError(f"errors of {written['effect']}")
    return found


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _number(value: float) -> float | None:
    return None if np.isnan(value) else value
