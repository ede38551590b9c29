"""What the outside world adds to the motor currents: the interface of every estimator, and its result."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from ident.arrays import Array, BoolArray, FloatArray, IntArray
from ident.coupling import Coupling
from ident.errors import InputError
from ident.log import JointLog, Sample


class Flag(IntFlag):
    """What was the matter with a sample; the residual of a ``MISSING`` or ``REPEATED`` one is that of the one before.

    ``MISSING``: the sample holds NaN or infinity. ``REPEATED``: its time stamp is not after the one before.
    ``GAP``: samples were dropped before it. ``SETTLING``: filters have not forgotten the start yet, the residual is
    nought (or, where a network lacks history, that of the sample before).
    """

    GOOD = 0
    MISSING = 1
    REPEATED = 2
    GAP = 4
    SETTLING = 8


def joint_torque(current: FloatArray, gain: FloatArray | None, coupling: Coupling | None) -> FloatArray | None:
    """Return the joints' torques (N, n) [N m, prismatic N] that currents tell of; None where gains are unknown.

    Args:
        current: of the motors, (N, n).
        gain: torque per unit of it (n,).
        coupling: of the motors, if gears couple joints.
    """
    if gain is None:
        return None
    return current * gain if coupling is None else coupling.joint_force(current * gain)


UNUSABLE = int(Flag.MISSING | Flag.REPEATED)


@dataclass(frozen=True, eq=False)
class Residual:
    """What the outside world adds to the joints along a log; positive acts along +q.

    Attributes:
        t: time [s], (N,).
        current: external joint force as the current that would cause it, in the robot's current unit, (N, n).
        torque: external joint torque [N m, prismatic N], (N, n); None where the drive gains are unknown.
        flags: `Flag` of each row, (N,).
        segment: number of the segment each row belongs to, (N,).
        unit: of ``current``.
    """

    t: FloatArray
    current: FloatArray
    torque: FloatArray | None
    flags: IntArray
    segment: IntArray
    unit: str

    def __len__(self) -> int:
        return len(self.t)

    @property
    def good(self) -> BoolArray:
        """Rows whose residual is their own and settled, (N,)."""
        good: BoolArray = (self.flags & (UNUSABLE | int(Flag.SETTLING))) == 0
        return good

    def save(self, path: Path) -> None:
        """Write columns ``t``, ``r1..rn``, ``tau1..taun`` (where known), ``flags`` and ``segment`` as Parquet."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns: dict[str, Array] = {"t": self.t}
        for name, values in (("r", self.current), ("tau", self.torque)):
            if values is not None:
                columns |= {f"{name}{j + 1}": values[:, j] for j in range(values.shape[1])}
        columns |= {"flags": self.flags, "segment": self.segment}
        table = pa.table({name: pa.array(values) for name, values in columns.items()})
        pq.write_table(table.replace_schema_metadata({"unit": self.unit}), path)

    @staticmethod
    def load(path: Path) -> Residual:
        """Read what ``save`` wrote.

        Raises:
            InputError: there is no such file, or it holds no residual.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(path)
            unit = (table.schema.metadata or {})[b"unit"].decode()
            t, flags, segment = (table[name].to_numpy() for name in ("t", "flags", "segment"))
        except (OSError, pa.ArrowException, KeyError) as error:
            raise InputError("no residual", str(path), "give the residual.parquet of `sensorless observe`") from error

        def columns(letter: str) -> FloatArray | None:
            names = [n for n in table.column_names if n.rstrip("0123456789") == letter and n != letter]
            return np.stack([table[n].to_numpy() for n in names], axis=1) if names else None

        current = columns("r")
        if current is None:
            raise InputError("no column r1", str(path), "give the residual.parquet of `sensorless observe`")
        return Residual(t, current, columns("tau"), flags, segment, unit)


@runtime_checkable
class ResidualEstimator(Protocol):
    """Estimates what the outside world adds to the joints.

    ``step`` after ``reset``, sample by sample, gives the ``current`` of ``run`` for each segment of a log (to 1e-9).
    """

    @property
    def unit(self) -> str:
        """Unit of the residual current."""

    @property
    def n(self) -> int:
        """Number of joints."""

    @property
    def flag(self) -> Flag:
        """What was the matter with the last sample."""

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""

    def step(self, sample: Sample) -> FloatArray:
        """Take one sample and return the residual current (n,), positive where the world pushes along +q."""

    def run(self, log: JointLog) -> Residual:
        """Return the residual of a whole log, beginning anew at each of its segments."""


def hold(values: FloatArray, usable: BoolArray, before: FloatArray) -> FloatArray:
    """Spread the values of usable rows over all rows: an unusable row has that of the last usable one.

    Args:
        values: of the usable rows, (K, n).
        usable: which rows those are, (N,), K of them true.
        before: what stood before the first row, (n,).
    """
    held: FloatArray = np.concatenate([before[None], values])[np.cumsum(usable)]
    return held
