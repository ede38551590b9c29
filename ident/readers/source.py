"""A file that is walked as a log, checked on the way."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.log import JointLog
from ident.log_check import LogChecker
from ident.readers.columns import Columns

if TYPE_CHECKING:
    from ident.robot import Robot


class FileLog:
    """A log in a file (a LogSource): read piece by piece, each piece checked before it is handed on.

    A reader subclasses it and yields the file's rows, in order, from ``_pieces``.
    """

    def __init__(self, path: Path, robot: Robot) -> None:
        self.path = path
        self.robot = robot

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self.path)!r})"

    @property
    def name(self) -> str:
        """Stem of the file the log came from."""
        return self.path.stem

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield consecutive pieces of at most ``rows`` rows, none of them across a segment's end.

        Raises:
            InputError: the file cannot be read or what it holds is not a log of this robot.
        """
        return _regroup(self._checked(), rows)

    def read(self) -> JointLog:
        """Return the whole log in memory.

        Raises:
            InputError: the file cannot be read or what it holds is not a log of this robot.
        """
        return join(list(self._checked()))

    def _pieces(self) -> Iterator[tuple[JointLog, Columns]]:
        """Yield the file's rows in pieces of any size, with the names of the columns they came from."""
        raise NotImplementedError

    def _checked(self) -> Iterator[JointLog]:
        checker = LogChecker(self.robot, self.path)
        for piece, columns in self._pieces():
            yield checker.check(piece, columns.names)
        checker.finish()


def join(pieces: list[JointLog]) -> JointLog:
    """Put consecutive pieces of one log back together, keeping their segment numbers."""
    if len(pieces) == 1:
        return pieces[0]
    first = pieces[0]
    arrays = {
        field.name: np.concatenate([getattr(piece, field.name) for piece in pieces])
        for field in dataclasses.fields(first)
        if isinstance(getattr(first, field.name), np.ndarray)
    }
    return first.replace(**arrays)


def _regroup(pieces: Iterable[JointLog], rows: int) -> Iterator[JointLog]:
    """Cut and join pieces into blocks of ``rows`` rows, shorter only at the end of a segment."""
    held: list[JointLog] = []
    count = 0
    for piece in pieces:
        for segment in piece.segments():
            part = piece[segment]
            if held and held[-1].segment[-1] != part.segment[0]:
                yield join(held)
                held, count = [], 0
            start = 0
            while count + len(part) - start >= rows:
                stop = start + rows - count
                yield join([*held, part[start:stop]])
                held, count, start = [], 0, stop
            if start < len(part):
                held.append(part[start:])
                count += len(part) - start
    if held:
        yield join(held)
