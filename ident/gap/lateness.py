"""A current that comes late blurs the sign of velocity: once it is known how late, how signs turn is chosen anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.gap.rests import Rests
from ident.gap.smoothing import smoothed
from ident.log import JointLog, LogSource
from ident.model import CurrentModel


@dataclass(frozen=True, eq=False)
class InTime:
    """A log whose currents would come late by some seconds (n,), as if they did not."""

    source: LogSource
    late: FloatArray

    @property
    def name(self) -> str:
        """Name of the log."""
        return self.source.name

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield pieces of at most so many rows, at whose ends the current stands still for as long as it is late."""
        return (self._in_time(log) for log in self.source.blocks(rows))

    def read(self) -> JointLog:
        """Return the whole log in memory."""
        whole = self.source.read()
        pieces = [self._in_time(whole[rows]).current for rows in whole.segments()]
        return whole.replace(current=np.concatenate(pieces))

    def _in_time(self, log: JointLog) -> JointLog:
        later = [np.interp(log.t + late, log.t, log.current[:, j]) for j, late in enumerate(self.late)]
        return log.replace(current=np.stack(later, axis=1))


def turned_in_time(model: CurrentModel, sources: Sequence[LogSource], rests: Rests, late: FloatArray) -> CurrentModel:
    """A model whose signs of velocity turn as logs ask for whose currents come late by some seconds (n,)."""
    return smoothed(model, [InTime(source, late) for source in sources], rests, ends=0.0).model
