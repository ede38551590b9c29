"""A current that comes late blurs the sign of velocity: once it is known how late, how signs turn is chosen anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from ident.arrays import FloatArray
from ident.gap.presliding import built_anew
from ident.gap.rests import Rests
from ident.gap.smoothing import smoothed
from ident.log import JointLog, LogSource, concatenate
from ident.model import CurrentModel

EDGE = 0.2
"""Seconds on from a row that its motion's spline is told by, as good as all of them."""


@dataclass(frozen=True, eq=False)
class InTime:
    """A log whose currents come late by some seconds, beside the motion of that much earlier.

    It is the motion that is taken between samples: it is smooth, and friction's steps are not. Rows whose earlier
    motion their segment does not have are left out.
    """

    source: LogSource
    late: float

    @property
    def name(self) -> str:
        """Name of the log."""
        return self.source.name

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield consecutive pieces, none of them across a segment's end, made from pieces of at most so many rows."""
        reach = abs(self.late) + EDGE
        seen: JointLog | None = None  # what the rows to come need of their segment, and those themselves
        done = -np.inf
        for block in self.source.blocks(rows):
            if seen is not None and seen.segment[0] == block.segment[0]:
                seen = concatenate([seen, block], block.name).replace(
                    segment=np.full(len(seen) + len(block), block.segment[0])
                )
            else:
                if seen is not None:
                    yield from self._in_time(seen, done, np.inf)
                seen, done = block, -np.inf
            until = float(seen.t[-1]) - reach
            yield from self._in_time(seen, done, until)
            done, seen = until, seen[seen.t > until - 2.0 * reach]
        if seen is not None:
            yield from self._in_time(seen, done, np.inf)

    def read(self) -> JointLog:
        """Return the whole log in memory."""
        whole = self.source.read()
        pieces = list(InTime(whole, self.late).blocks(max(len(whole), 1)))
        return concatenate(pieces, self.name) if pieces else whole[:0]

    def _in_time(self, log: JointLog, after: float, until: float) -> Iterator[JointLog]:
        """Rows of a segment's piece stamped later than one instant and up to another, if there are any."""
        then = log.t - self.late
        rows = (log.t > after) & (log.t <= until) & (then >= log.t[0]) & (then <= log.t[-1])
        if rows.any():
            motion = {name: getattr(log, name) for name in ("q", "dq", "ddq")}
            earlier = {
                name: CubicSpline(log.t, values)(then[rows]) for name, values in motion.items() if values is not None
            }
            yield log[rows].replace(**earlier)


def turned_in_time(model: CurrentModel, sources: Sequence[LogSource], rests: Rests, late: FloatArray) -> CurrentModel:
    """A model whose dry friction turns as logs ask for whose currents come late by some seconds (n,)."""
    turned = model
    for seconds in np.unique(late[late != 0.0]).tolist():
        in_time = [InTime(source, seconds) for source in sources]
        found = built_anew(smoothed(model, in_time, rests, ends=0.0).model, in_time)
        chosen = [
            new if new.effect.joint is not None and late[new.effect.joint] == seconds else old
            for new, old in zip(found.terms, turned.terms, strict=True)
        ]
        turned = replace(turned, terms=tuple(chosen))
    return turned
