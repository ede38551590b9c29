"""Which columns or arrays of a file hold which quantity of a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, FloatArray
from ident.errors import InputError
from ident.log import JointLog

if TYPE_CHECKING:
    from ident.robot import Robot

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
"""Contract names of the wrench columns."""

PREFIXES = {
    "q": "q",
    "current": "i",
    "dq": "dq",
    "ddq": "ddq",
    "tau_ext": "tau_ext",
    "temperature": "temp",
}
"""Contract prefix of the columns q1..qn and so on, by field of JointLog."""

MAPPING_KEYS = {
    "t": "time",
    "q": "position",
    "current": "current",
    "dq": "velocity",
    "ddq": "acceleration",
    "tau_ext": "tau_ext",
    "wrench": "wrench",
    "temperature": "temperature",
    "segment": "segment",
}
"""Key of the card's ``[log]`` table, by field of JointLog."""

REQUIRED = ("t", "q", "current")


@dataclass(frozen=True)
class Columns:
    """Names of the columns that make up each field of a log, and the factors that bring them to contract units.

    Attributes:
        names: field of JointLog -> column names in joint order, or the one name of an array with all joints.
        scale: field of JointLog -> factor, scalar or one a joint; 1 where left out.
    """

    names: Mapping[str, tuple[str, ...]]
    scale: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def all(self) -> list[str]:
        """Every column that is read, in order."""
        return [name for names in self.names.values() for name in names]


def contract_columns(n: int) -> dict[str, tuple[str, ...]]:
    """Return the contract's column names of an n-joint log, by field of JointLog."""
    names: dict[str, tuple[str, ...]] = {"t": ("t",)}
    for key, prefix in PREFIXES.items():
        names[key] = tuple(f"{prefix}{joint}" for joint in range(1, n + 1))
    names["wrench"] = WRENCH
    names["segment"] = ("segment",)
    return names


def find_columns(available: Sequence[str], robot: Robot, path: Path, contract: bool = False) -> Columns:
    """Find the columns of a log among those a file has.

    The card's ``[log]`` names count where the file has them; a file without them that has the contract's names is read
    as a contract log, unscaled, so that one card reads both a foreign log and what ``sensorless convert`` made of it.

    Args:
        available: names in the file.
        robot: whose log it is.
        path: of the file, for messages.
        contract: the file is known to hold contract columns; the ``[log]`` table is passed over.

    Raises:
        InputError: required columns are missing, or the file holds another number of joints.
    """
    have = set(available)
    standard = contract_columns(robot.n)
    mapping = None if contract else robot.card.log
    if mapping is not None:
        mapped = mapped_columns(robot)
        missing = _missing(mapped.names, have)
        if not missing:
            return Columns(_present(mapped.names, have), mapped.scale)
        if _missing(standard, have):
            what = f"the [log] table of the card names {_listing(missing)}, which the file does not have"
            raise InputError(what, str(path), f"name some of {_listing(list(available))}")
    missing = _missing(standard, have)
    if missing:
        how = f"add the columns or name the file's own in [log] of the card; it has {_listing(list(available))}"
        raise InputError(f"missing columns {_listing(missing)}", str(path), how)
    _check_joint_count(have, robot, path)
    return Columns(_present(standard, have))


def mapped_columns(robot: Robot) -> Columns:
    """Return the columns that the card's ``[log]`` table names, with its scales.

    Raises:
        InputError: a list in the table has neither one name nor one a joint.
    """
    mapping = robot.card.log
    if mapping is None:
        raise InputError("no [log] table", f"card of {robot.name}", "add one that names the log's columns")
    names: dict[str, tuple[str, ...]] = {}
    scale: dict[str, FloatArray] = {}
    for key, table_key in MAPPING_KEYS.items():
        given = getattr(mapping, table_key, None)
        if given is None:
            continue
        listed = (given,) if isinstance(given, str) else tuple(given)
        width = _width(key, robot.n)
        if len(listed) not in (1, width):
            what = f"[log] {table_key} lists {len(listed)} names for {width} channels"
            raise InputError(what, f"card of {robot.name}", "give one name a channel or the name of one array")
        names[key] = listed
    for key, table_key in MAPPING_KEYS.items():
        factor = np.asarray(getattr(mapping.scale, table_key, 1.0), dtype=np.float64)
        if (factor != 1.0).any():
            scale[key] = factor
    return Columns(names, scale)


def assemble(arrays: Mapping[str, Array], columns: Columns, n: int, path: Path) -> JointLog:
    """Put the columns or arrays of a file together into a log.

    Args:
        arrays: by name, (N,) columns or (N, k) arrays; all of ``columns.all``.
        columns: which of them make up which field.
        n: number of joints.
        path: of the file, for messages and the log's name.

    Raises:
        InputError: an array has the wrong shape.
    """
    fields: dict[str, Array] = {}
    for key, names in columns.names.items():
        width = _width(key, n)
        parts = [arrays[name] for name in names]
        value = parts[0] if len(parts) == 1 else np.column_stack(parts)
        if value.ndim == 2 and key in ("t", "segment") and 1 in value.shape:
            value = value.ravel()
        if key not in ("t", "segment"):
            value = value.reshape(-1, 1) if value.ndim == 1 and width == 1 else value
            if value.ndim != 2 or value.shape[1] != width:
                what = f"{names[0]} has shape {'x'.join(map(str, value.shape))} where {width} columns are expected"
                raise InputError(what, str(path), "name one column a joint, or an array with one column a joint")
        if key in columns.scale:
            value = value * columns.scale[key]
        fields[key] = value if key == "segment" else value.astype(np.float64, copy=False)
    rows = {key: len(value) for key, value in fields.items()}
    if len(set(rows.values())) > 1:
        listing = ", ".join(f"{columns.names[key][0]} {count}" for key, count in rows.items())
        raise InputError(f"arrays of different length: {listing}", str(path), "give one row a sample")
    return JointLog(**fields, name=path.stem)


def _width(key: str, n: int) -> int:
    return {"t": 1, "segment": 1, "wrench": len(WRENCH)}.get(key, n)


def _missing(names: Mapping[str, tuple[str, ...]], have: set[str]) -> list[str]:
    """Names that are required, or that belong to an optional field of which only a part is there."""
    missing: list[str] = []
    for key, listed in names.items():
        absent = [name for name in listed if name not in have]
        if absent and (key in REQUIRED or len(absent) < len(listed)):
            missing += absent
    return missing


def _present(names: Mapping[str, tuple[str, ...]], have: set[str]) -> dict[str, tuple[str, ...]]:
    return {key: listed for key, listed in names.items() if all(name in have for name in listed)}


def _check_joint_count(have: set[str], robot: Robot, path: Path) -> None:
    """Refuse a contract log with columns of more joints than the robot has."""
    for key in ("q", "current"):
        name = f"{PREFIXES[key]}{robot.n + 1}"
        if name in have:
            what = f"column {name} belongs to more joints than the {robot.n} of {robot.name}"
            raise InputError(what, str(path), "use the card of the robot that made the log")


def _listing(names: list[str], limit: int = 24) -> str:
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return (", ".join(names[:limit]) or "nothing") + more
