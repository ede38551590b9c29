"""The robot: its card, checked against its URDF, and the mechanism and limits made from them."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from ident.arrays import FloatArray
from ident.card import Limits, LogMapping, RobotCard
from ident.coupling import Coupling
from ident.errors import InputError
from ident.multibody import EARTH_GRAVITY, Multibody
from ident.rigid_body import RigidBody
from ident.signals import Motion

__all__ = ["JointLimits", "LogMapping", "Robot", "RobotCard", "built_in_robots", "load_robot"]

ROBOTS = Path(__file__).parent / "robots"
TORQUE_UNITS = ("N*m", "Nm", "N m", "N.m", "N·m", "N")


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the joints [rad, rad/s, rad/s^2, N m; prismatic m, N], each (n,), inf where unknown.

    Attributes:
        lower, upper: positions [rad; prismatic m].
        velocity: greatest speed [rad/s; m/s].
        acceleration: greatest acceleration [rad/s^2; m/s^2].
        effort: greatest force [N m; N].
    """

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    effort: FloatArray


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot: its card, its mechanism, its limits and the file of its URDF; arrays are in the order of ``joints``.

    Attributes:
        card: what was read from robot.toml.
        multibody: the mechanism.
        limits: of the joints, the card's before the URDF's.
        urdf: file of the mechanism, if it came from one.
    """

    card: RobotCard
    multibody: Multibody
    limits: JointLimits
    urdf: Path | None = None

    @property
    def name(self) -> str:
        """The card's name for the robot."""
        return self.card.name

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, in the order of the log's columns."""
        return self.multibody.joint_names

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.multibody.n

    @property
    def unit(self) -> str:
        """Unit of the motor current."""
        return self.card.current_unit

    def displacement_unit(self, joint: int) -> str:
        """Return the unit of a joint's position: rad, or m where it slides.

        Args:
            joint: from 0.
        """
        return "m" if self.multibody.prismatic[joint] else "rad"

    @cached_property
    def rigid_body(self) -> RigidBody:
        """Batch dynamics of the links, as the motors feel them."""
        return RigidBody(self.multibody, self.coupling)

    @cached_property
    def gain(self) -> FloatArray | None:
        """Joint torque per unit of current [N m, prismatic N], (n,); None when unknown, ones where torque is logged."""
        if self.card.drive.gain is not None:
            return np.array(self.card.drive.gain)
        return np.ones(self.n) if self.unit in TORQUE_UNITS else None

    @cached_property
    def gear_ratio(self) -> FloatArray | None:
        """Motor turns per joint turn, (n,); None when unknown."""
        ratio = self.card.drive.gear_ratio
        return None if ratio is None else np.array(ratio)

    @cached_property
    def coupling(self) -> Coupling | None:
        """How gears couple joints; None where every motor moves its own joint alone."""
        rows = self.card.drive.coupling
        if rows is None or not np.any(rows - np.diag(np.diagonal(rows))):
            return None
        return Coupling(np.array(rows))

    def motors(self, motion: Motion) -> Motion:
        """Return the motion of the motors, each in its own joint's units: that of the joints where none are coupled.

        Args:
            motion: of the joints.
        """
        return motion if self.coupling is None else self.coupling.motors(motion)

    def by_joints(self, inertia: FloatArray) -> FloatArray:
        """Return by how much the motors' forces grow with each joint's acceleration (..., n, n).

        Args:
            inertia: by how much they do with each motor's.
        """
        return inertia if self.coupling is None else inertia @ self.coupling.matrix


def built_in_robots() -> list[str]:
    """Names of the robots that need no path."""
    return sorted(card.parent.name for card in ROBOTS.glob("*/robot.toml"))


def load_robot(robot: str | Path) -> Robot:
    """Load a robot by built-in name or by the path of its card.

    Args:
        robot: name or path.

    Raises:
        InputError: the card or its URDF is missing or wrong; ``what`` lists every mistake as ``key: problem``.
    """
    path = _card_path(robot)
    raw = _read_toml(path)
    problems: dict[str, str] = {}
    card = _validate(raw, problems)
    multibody = _read_urdf(raw, path, problems)
    joints = multibody.joint_names if multibody is not None else raw.get("joints")
    if isinstance(joints, (list, tuple)):
        _check_lengths(raw, len(joints), problems)
    if card is not None and multibody is not None and not problems:
        limits = _limits(card.limits, multibody, problems)
        _check_coupling(card, problems)
        if not problems:
            return Robot(card, multibody, limits, path.parent / card.urdf)
    raise InputError("; ".join(f"{key}: {text}" for key, text in problems.items()), f"card {path}", "mend these keys")


def _card_path(robot: str | Path) -> Path:
    if isinstance(robot, str) and robot in built_in_robots():
        return ROBOTS / robot / "robot.toml"
    path = Path(robot)
    if path.is_dir():
        path = path / "robot.toml"
    if not path.is_file():
        names = ", ".join(built_in_robots())
        raise InputError(f"no robot {str(robot)!r}", "robot", f"give the path of a card or a built-in name: {names}")
    return path


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"the card is not valid TOML ({error})", f"card {path}", "mend that line") from error
    except UnicodeError as error:
        raise InputError("the card is not UTF-8 text", f"card {path}", "save it as UTF-8") from error
    except OSError as error:
        raise InputError(f"the card cannot be read ({error.strerror})", f"card {path}", "check the file") from error


def _validate(raw: dict[str, Any], problems: dict[str, str]) -> RobotCard | None:
    try:
        return RobotCard.model_validate(raw)
    except ValidationError as error:
        for detail in error.errors():
            text = "unknown key" if detail["type"] == "extra_forbidden" else _plain(detail["msg"])
            key = _key(raw, detail["loc"])
            if not any(known.startswith(key + ".") for known in problems):  # the other half of "a list or one name"
                problems.setdefault(key, text)
        return None


def _key(raw: dict[str, Any], location: tuple[int | str, ...]) -> str:
    """Name the key at fault, without the types pydantic tried there (``list[...]``, ``constrained-str``)."""
    parts: list[str] = []
    here: Any = raw
    for part in location:
        in_table = isinstance(here, dict)
        if in_table and "[" not in str(part) and "constrained" not in str(part):
            here = here.get(str(part))
        elif in_table or not isinstance(part, int):
            continue
        parts.append(str(part))
    return ".".join(parts)


def _plain(message: str) -> str:
    message = message.removeprefix("Value error, ").replace(" after validation", "")
    if message.startswith("Input should be a valid dictionary"):
        return "should be a table"
    return {"Field required": "missing"}.get(message, message[:1].lower() + message[1:])


def _read_urdf(raw: dict[str, Any], path: Path, problems: dict[str, str]) -> Multibody | None:
    urdf, joints, gravity = raw.get("urdf"), raw.get("joints"), raw.get("gravity", EARTH_GRAVITY)
    wrong = {key.split(".")[0] for key in problems}
    if not isinstance(urdf, str) or wrong & {"urdf", "gravity"}:
        return None
    try:
        return Multibody.from_urdf(path.parent / urdf, None if "joints" in wrong else joints, gravity)
    except InputError as error:
        names_joint = joints is not None and error.how.startswith("name ")
        problems["joints" if names_joint else "urdf"] = f"{error.what} in {error.where} ({error.how})"
        return None


def _check_lengths(raw: dict[str, Any], n: int, problems: dict[str, str]) -> None:
    """Report every list whose length is not the number of joints; works on a card that is wrong elsewhere too."""
    for table in ("drive", "limits", "log"):
        values = raw.get(table)
        if isinstance(values, dict):
            _check_table(table, values, n, problems)
            scale = values.get("scale")
            if table == "log" and isinstance(scale, dict):
                _check_table("log.scale", scale, n, problems)


def _check_table(table: str, values: dict[str, Any], n: int, problems: dict[str, str]) -> None:
    for key, value in values.items():
        count = 6 if key == "wrench" else n
        where = f"{table}.{key}"
        if isinstance(value, list) and len(value) != count:
            per = "values" if key == "wrench" else "joints"
            problems.setdefault(where, f"{len(value)} values where there are {count} {per}")
        elif key == "coupling" and isinstance(value, list):
            for index, row in enumerate(value):
                if isinstance(row, list) and len(row) != n:
                    problems.setdefault(f"{where}.{index}", f"{len(row)} values where there are {n} joints")


def _limits(table: Limits, multibody: Multibody, problems: dict[str, str]) -> JointLimits:
    def either(values: list[float] | None, default: FloatArray) -> FloatArray:
        return default if values is None else np.array(values)

    limits = JointLimits(
        either(table.lower, multibody.lower),
        either(table.upper, multibody.upper),
        either(table.velocity, multibody.velocity),
        either(table.acceleration, np.full(multibody.n, np.inf)),
        either(table.effort, multibody.effort),
    )
    crossed = np.flatnonzero(~(limits.lower < limits.upper)) + 1
    if len(crossed):
        key = "limits.lower" if table.lower is not None else "limits.upper"
        problems[key] = f"lower is not below upper at joint {', '.join(map(str, crossed))}"
    return limits


def _check_coupling(card: RobotCard, problems: dict[str, str]) -> None:
    coupling = card.drive.coupling
    if coupling is not None and np.linalg.matrix_rank(np.array(coupling)) < len(coupling):
        problems["drive.coupling"] = "singular: some joint speeds turn no motor"
