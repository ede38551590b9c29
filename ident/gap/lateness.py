"""A current that comes late blurs the sign of velocity: once it is known how late, how signs turn is chosen anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from ident.arrays import FloatArray
from ident.gap.rests import Rests
from ident.gap.smoothing import smoothed
from ident.log import JointLog, LogSource
from ident.model import CurrentModel


@dataclass(frozen=True, eq=False)
class InTime:
    """A log whose currents come late by some seconds, beside the motion of that much earlier.

    It is the motion that is taken between samples: it is smooth, and friction's steps are not.
    """

    source: LogSource
    late: float

    @property
    def name(self) -> str:
        """Name of the log."""
        return self.source.name

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield pieces of at most so many rows, without those whose earlier motion they do not have."""
        return (self._in_time(log) for log in self.source.blocks(rows))

    def read(self) -> JointLog:
        """Return the whole log in memory."""
        return self._in_time(self.source.read())

    def _in_time(self, log: JointLog) -> JointLog:
        moved, there = log, np.zeros(len(log), dtype=bool)
        for name in ("q", "dq", "ddq"):
            values = getattr(log, name)
            if values is not None:
                pieces = [self._earlier(log.t[rows], values[rows]) for rows in log.segments()]
                moved = moved.replace(**{name: np.concatenate(pieces)})
        for rows in log.segments():
            then = log.t[rows] - self.late
            there[rows] = (then >= log.t[rows][0]) & (then <= log.t[rows][-1])
        return moved[there]

    def _earlier(self, t: FloatArray, values: FloatArray) -> FloatArray:
        if len(t) == 1:
            return values
        return np.asarray(CubicSpline(t, values)(np.clip(t - self.late, t[0], t[-1])))


def turned_in_time(model: CurrentModel, sources: Sequence[LogSource], rests: Rests, late: FloatArray) -> CurrentModel:
    """A model whose signs of velocity turn as logs ask for whose currents come late by some seconds (n,)."""
    turned = model
    for seconds in np.unique(late[late != 0.0]).tolist():
        found = smoothed(model, [InTime(source, seconds) for source in sources], rests, ends=0.0).model
        chosen = [
            new if new.effect.joint is not None and late[new.effect.joint] == seconds else old
            for new, old in zip(found.terms, turned.terms, strict=True)
        ]
        turned = replace(turned, terms=tuple(chosen))
    return turned
