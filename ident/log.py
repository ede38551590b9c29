"""A log of joint motion and motor current."""

from __future__ import annotations

import dataclasses
import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.errors import InputError


@dataclass(frozen=True, eq=False)
class Sample:
    """One instant of a log: ``t`` [s], ``q`` [rad or m], ``current`` [the card's unit], each (n,).

    ``dq`` and ``ddq`` are the measured derivatives where the robot reports them.
    """

    t: float
    q: FloatArray
    current: FloatArray
    dq: FloatArray | None = None
    ddq: FloatArray | None = None


class LogSource(Protocol):
    """Something that can be walked as a log without holding all of it in memory."""

    @property
    def name(self) -> str:
        """Stem of the file the log came from."""

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield consecutive pieces of at most ``rows`` rows, none of them across a segment's end."""

    def read(self) -> JointLog:
        """Return the whole log in memory."""


@dataclass(frozen=True, eq=False)
class JointLog:
    """Motion and current of an n-joint robot at N instants; rows of one segment are contiguous in time.

    Attributes:
        t: time [s], (N,), strictly increasing inside a segment, not necessarily uniform.
        q: joint positions [rad, prismatic m], (N, n).
        current: motor currents in the card's unit, positive drives +q, (N, n).
        dq, ddq: measured velocities and accelerations where logged, (N, n).
        tau_ext: true external joint torque [N m] where known, positive acts along +q, (N, n).
        wrench: wrench at the tool (fx fy fz mx my mz) [N, N m] where measured, (N, 6).
        temperature: joint temperatures [degC] where measured, (N, n).
        segment: number of the segment each row belongs to, (N,); default one segment.
        name: stem of the file the log came from.
    """

    t: FloatArray
    q: FloatArray
    current: FloatArray
    dq: FloatArray | None = None
    ddq: FloatArray | None = None
    tau_ext: FloatArray | None = None
    wrench: FloatArray | None = None
    temperature: FloatArray | None = None
    segment: IntArray = dataclasses.field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    name: str = "log"

    def __post_init__(self) -> None:
        rows = len(self.t)
        if len(self.segment) == 0 and rows:
            object.__setattr__(self, "segment", np.zeros(rows, dtype=np.int64))
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, np.ndarray):
                continue
            if len(value) != rows:
                what = f"{field.name} has {len(value)} rows where t has {rows}"
                raise InputError(what, f"log {self.name}", "give one row a sample")
            frozen = value.view()
            frozen.flags.writeable = False
            object.__setattr__(self, field.name, frozen)

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, rows: slice | BoolArray) -> JointLog:
        """Return some rows as a log of its own; those of a slice are views, no copies."""
        return self._map(lambda value: value[rows])

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]: one over the median time step inside segments."""
        steps = np.diff(self.t)[np.diff(self.segment) == 0]
        if len(steps) == 0:
            raise InputError("fewer than two rows in every segment", f"log {self.name}", "give a longer log")
        return float(1.0 / np.median(steps))

    def segments(self) -> list[slice]:
        """Rows of each segment, in order."""
        edges = np.flatnonzero(np.diff(self.segment)) + 1
        bounds = [0, *edges.tolist(), len(self)]
        return [slice(a, b) for a, b in itertools.pairwise(bounds) if b > a]

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield consecutive pieces of at most ``rows`` rows, none of them across a segment's end."""
        for segment in self.segments():
            for start in range(segment.start, segment.stop, rows):
                yield self[start : min(start + rows, segment.stop)]

    def read(self) -> JointLog:
        """Return the log itself: it is in memory already."""
        return self

    def samples(self) -> Iterator[Sample]:
        """Yield the rows one by one, as a control loop would see them."""
        for k in range(len(self)):
            yield Sample(
                float(self.t[k]),
                self.q[k],
                self.current[k],
                None if self.dq is None else self.dq[k],
                None if self.ddq is None else self.ddq[k],
            )

    def replace(self, **changes: Any) -> JointLog:
        """Return the log with some of its arrays replaced."""
        return dataclasses.replace(self, **changes)

    def positions_only(self) -> JointLog:
        """Return the log without its velocities and accelerations, which are then derived from the positions."""
        return self.replace(dq=None, ddq=None)

    def _map(self, take: Any) -> JointLog:
        arrays = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return JointLog(**{k: take(v) if isinstance(v, np.ndarray) else v for k, v in arrays.items()})


@dataclass(frozen=True)
class Altered(ABC):
    """A source of logs with something changed in every row."""

    source: LogSource

    @abstractmethod
    def alter(self, log: JointLog) -> JointLog:
        """Return a piece of the log as changed."""

    @property
    def name(self) -> str:
        """Name of the log."""
        return self.source.name

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield consecutive pieces of at most ``rows`` rows."""
        return map(self.alter, self.source.blocks(rows))

    def read(self) -> JointLog:
        """Return the whole log."""
        return self.alter(self.source.read())


@dataclass(frozen=True)
class PositionsOnly(Altered):
    """A source of logs whose velocities and accelerations are left out."""

    def alter(self, log: JointLog) -> JointLog:
        """Return a piece without them."""
        return log.positions_only()


@dataclass(frozen=True)
class Later(Altered):
    """A source of logs whose time stamps are later by some seconds."""

    seconds: float

    def alter(self, log: JointLog) -> JointLog:
        """Return a piece with those."""
        return log.replace(t=log.t + self.seconds)


@dataclass(frozen=True, eq=False)
class WithoutStretches:
    """A source of logs with stretches cut out; what is left of a segment on either side are segments of their own.

    Attributes:
        source: the logs.
        stretches: number of the segment, first and last time [s] of each.
    """

    source: LogSource
    stretches: tuple[tuple[int, float, float], ...]

    @property
    def name(self) -> str:
        """Name of the log."""
        return self.source.name

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield consecutive pieces of at most ``rows`` rows, none of them across a cut."""
        number, before = -1, None
        for block in self.source.blocks(rows):
            own, left = int(block.segment[0]), np.ones(len(block), dtype=bool)
            for segment, first, last in self.stretches:
                left &= (block.t < first) | (block.t > last) | (segment != own)
            edges = np.flatnonzero(np.diff(left, prepend=False, append=False)).tolist()
            for a, b in zip(edges[::2], edges[1::2], strict=True):
                number += before != own or a > 0
                yield block[a:b].replace(segment=np.full(b - a, number, dtype=np.int64))
                before = own
            before = own if left[-1] else None

    def read(self) -> JointLog:
        """Return what is left of the log."""
        whole = self.source.read()
        return concatenate(list(WithoutStretches(whole, self.stretches).blocks(len(whole))), self.name)


def concatenate(logs: list[JointLog], name: str = "log") -> JointLog:
    """Join logs of one robot end to end, each beginning segments of its own; columns missing in one are dropped.

    Args:
        logs: at least one, of the same joints.
        name: of the joined log.
    """
    arrays: dict[str, Any] = {}
    for field in dataclasses.fields(JointLog):
        values = [getattr(log, field.name) for log in logs]
        if field.name not in ("segment", "name") and all(v is not None for v in values):
            arrays[field.name] = np.concatenate(values)
    segment: list[IntArray] = []
    first = 0
    for log in logs:
        segment.append(np.cumsum(np.diff(log.segment, prepend=log.segment[:1]) != 0) + first)
        first = int(segment[-1][-1]) + 1 if len(log) else first
    return JointLog(**arrays, segment=np.concatenate(segment), name=name)
