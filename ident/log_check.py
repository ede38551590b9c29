"""Refuses a log that would make every later figure wrong, naming file, row and column."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.errors import InputError
from ident.log import JointLog

if TYPE_CHECKING:
    from ident.robot import Robot

SHORTEST_STEP = 20e-6
"""Median time step [s] below which the time unit must be wrong (50 kHz)."""
LONGEST_STEP = 1.0
"""Median time step [s] above which the time unit must be wrong."""
LIMIT_MARGIN = 0.2
"""Least excess over a joint limit [rad or m] that is refused: real robots overrun a limit by a little."""
DEGREES_FACTOR = 2.5
"""Positions beyond the limits by this factor are taken for degrees."""
UNLIMITED_TURNS = 20 * np.pi
"""Positions [rad] of a joint that turns freely beyond this are taken for degrees (63 degrees, or ten turns)."""
FULL_TURN = 2 * np.pi - 0.1
"""A joint whose limits span as much [rad] turns freely: the URDF bounds its cables, and real robots turn further."""
SPEED_FACTOR = 5.0
"""Typical fast motion above the speed limit by this factor betrays a wrong unit of time."""
SPIKE, SPIKES = 1000.0, (4, 1000)
"""A current so many times larger than any but a few is none: but four, or one in a thousand if that is more."""


class LogChecker:
    """Checks a log piece by piece.

    Rows are counted from 1, the first row of data, over all pieces.

    Args:
        robot: whose log it is.
        path: of the file, for messages.
    """

    def __init__(self, robot: Robot, path: Path) -> None:
        self.robot = robot
        self.where = str(path)
        self.rows = 0
        self._last_t = np.nan
        self._last_segment = 0

    def check(self, piece: JointLog, names: Mapping[str, tuple[str, ...]] | None = None) -> JointLog:
        """Return the piece, its segment numbers whole numbers, or refuse it.

        Args:
            piece: rows that follow those checked before.
            names: column names by field of JointLog, for messages; the contract's where left out.

        Raises:
            InputError: what is wrong, in which row and column, and how to mend it.
        """
        if piece.q.shape[1:] != (self.robot.n,) or piece.current.shape[1:] != (self.robot.n,):
            what = f"{piece.n} joints where {self.robot.name} has {self.robot.n}"
            raise InputError(what, self.where, "use the card of the robot that made the log")
        if len(piece) == 0:
            return piece
        self._check_finite(piece, names or {})
        piece = self._whole_segments(piece, names or {})
        self._check_time(piece)
        self._check_position(piece)
        self._check_speed(piece)
        self._check_current(piece, names or {})
        self.rows += len(piece)
        self._last_t, self._last_segment = float(piece.t[-1]), int(piece.segment[-1])
        return piece

    def finish(self) -> None:
        """Refuse a log that had no row at all.

        Raises:
            InputError: the log is empty.
        """
        if self.rows == 0:
            raise InputError("no rows", self.where, "give a log with at least one sample")

    def _check_finite(self, piece: JointLog, names: Mapping[str, tuple[str, ...]]) -> None:
        for field in dataclasses.fields(piece):
            key, value = field.name, getattr(piece, field.name)
            if not isinstance(value, np.ndarray) or np.isfinite(value).all():
                continue
            row, channel = np.argwhere(~np.isfinite(value.reshape(len(value), -1)))[0]
            bad = value.reshape(len(value), -1)[row, channel]
            what = f"{_column(key, int(channel), names)} is {'empty or NaN' if np.isnan(bad) else 'infinite'}"
            raise InputError(what, self._at(int(row)), "repair or remove the row")

    def _whole_segments(self, piece: JointLog, names: Mapping[str, tuple[str, ...]]) -> JointLog:
        """Turn segment numbers, which some formats hold as floats, into integers."""
        if piece.segment.dtype.kind == "i":
            return piece
        broken = np.flatnonzero(piece.segment != np.round(piece.segment))
        if len(broken):
            what = f"{_column('segment', 0, names)} = {piece.segment[broken[0]]:g} is not a whole number"
            raise InputError(what, self._at(int(broken[0])), "number the segments")
        return piece.replace(segment=piece.segment.astype(np.int64))

    def _check_time(self, piece: JointLog) -> None:
        last = self._last_t if self.rows else piece.t[0] - 1.0
        last_segment = self._last_segment if self.rows else piece.segment[0]
        inside = np.diff(piece.segment, prepend=last_segment) == 0
        steps = np.diff(piece.t, prepend=last)
        bad = np.flatnonzero((steps <= 0) & inside)
        if len(bad):
            row = int(bad[0])
            stamp = f"{piece.t[row]:.9g}"
            if steps[row] == 0:
                raise InputError(f"t = {stamp} s is repeated", self._at(row), "keep one row a time stamp")
            how = "sort the rows, or number contiguous stretches in a column segment"
            raise InputError(f"t = {stamp} s goes backward by {-steps[row]:.6g} s", self._at(row), how)
        inside[0] &= bool(self.rows)
        if not inside.any():
            return
        step = float(np.median(steps[inside]))
        if not SHORTEST_STEP <= step <= LONGEST_STEP:
            what = f"the median time step is {step:.3g} s: t does not look like seconds"
            how = "set scale time in [log] of the card (1e-3 for ms, 1e-6 for us, 1e-9 for ns)"
            raise InputError(what, self._at(0), how)

    def _check_position(self, piece: JointLog) -> None:
        lower, upper = self.robot.limits.lower, self.robot.limits.upper
        prismatic = self.robot.multibody.prismatic
        allowed = np.maximum(LIMIT_MARGIN, 0.1 * (upper - lower))
        excess = np.maximum(lower - piece.q, piece.q - upper) - allowed
        free = (upper - lower >= FULL_TURN) & ~prismatic
        far = np.where(free, UNLIMITED_TURNS, DEGREES_FACTOR * np.maximum(np.abs(lower), np.abs(upper)))
        beyond = excess > 0
        self._refuse_degrees(piece, (beyond | free) & (np.abs(piece.q) > far) & ~prismatic)
        outside = beyond & ~free
        if outside.any():
            row, joint = np.argwhere(outside)[0]
            unit = self.robot.displacement_unit(int(joint))
            what = (
                f"q{joint + 1} = {piece.q[row, joint]:.4g} {unit} is outside the limits "
                f"{lower[joint]:.4g} to {upper[joint]:.4g} of joint {joint + 1} ({self.robot.joints[joint]})"
            )
            how = "check the order of the joints, the unit and the robot, or set [limits] of the card"
            raise InputError(what, self._at(int(row)), how)
        # One joint may turn further than its limits say; most of them at once do not.
        crowd = beyond.sum(axis=1) > max(1.0, 0.5 * self.robot.n)
        self._refuse_degrees(piece, beyond & crowd[:, None])

    def _refuse_degrees(self, piece: JointLog, suspect: BoolArray) -> None:
        if suspect.any():
            row, joint = np.argwhere(suspect)[0]
            what = f"q{joint + 1} = {piece.q[row, joint]:.6g} looks like degrees"
            how = (
                "set scale position = 0.0174533 in [log] of the card, or the joint's [limits] if it does turn that far"
            )
            raise InputError(what, self._at(int(row)), how)

    def _check_speed(self, piece: JointLog) -> None:
        limit = self.robot.limits.velocity
        if piece.dq is not None:
            speed: FloatArray = np.abs(piece.dq)
            how = "set scale velocity in [log] of the card (0.0174533 for deg/s)"
        else:
            inside = np.diff(piece.segment) == 0
            speed = np.abs(np.diff(piece.q, axis=0)[inside]) / np.diff(piece.t)[inside, None]
            how = "check the unit of t, and set scale time in [log] of the card"
        if len(speed) < 20:
            return
        # Single steps may be wild where stamps jitter; the fast twentieth of the rows is not.
        typical = np.quantile(speed, 0.95, axis=0)
        bad = np.flatnonzero(typical > SPEED_FACTOR * limit)
        if len(bad):
            joint = int(bad[0])
            what = (
                f"joint {joint + 1} ({self.robot.joints[joint]}) moves at {typical[joint]:.3g}, "
                f"{typical[joint] / limit[joint]:.0f} times its limit of {limit[joint]:.3g}"
            )
            raise InputError(what, self._at(0), how)

    def _check_current(self, piece: JointLog, names: Mapping[str, tuple[str, ...]]) -> None:
        size = np.abs(piece.current)
        few = max(SPIKES[0], len(size) // SPIKES[1])
        if len(size) <= few:
            return
        usual = float(np.partition(size.max(axis=1), -few - 1)[-few - 1])
        spikes = np.argwhere(size > SPIKE * usual)
        if usual > 0.0 and len(spikes):
            row, joint = (int(k) for k in spikes[0])
            times = size[row, joint] / usual
            spike = f"{_column('current', joint, names)} = {piece.current[row, joint]:.4g}"
            what = f"{spike} is {times:.2g} times what other rows have"
            raise InputError(what, self._at(row), "repair or remove the row")

    def _at(self, row: int) -> str:
        return f"{self.where} row {self.rows + row + 1}"


def check(log: JointLog, robot: Robot, path: Path) -> JointLog:
    """Check a whole log in memory and return it, its segment numbers whole numbers.

    Args:
        log: to be checked.
        robot: whose log it should be.
        path: of the file it came from, for messages.

    Raises:
        InputError: what is wrong, in which row and column, and how to mend it.
    """
    checker = LogChecker(robot, path)
    checked = checker.check(log)
    checker.finish()
    return checked


def _column(key: str, channel: int, names: Mapping[str, tuple[str, ...]]) -> str:
    """Return the name of a column as the user knows it."""
    from ident.readers.columns import contract_columns

    known = names.get(key)
    if known is None:
        return contract_columns(channel + 1)[key][channel]
    return known[channel] if len(known) > 1 else f"{known[0]} column {channel + 1}" if channel else known[0]
