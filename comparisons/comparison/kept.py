"""The residuals of all estimators, kept in files: one at a time is in memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from comparisons.comparison.held_out import HeldOut
from comparisons.comparison.scoring import Score
from comparisons.predictions import FOLDER, PredictionWriter
from ident.arrays import FloatArray


@dataclass
class Kept:
    """Residuals by the name of the run, in files of ``folder``.

    Attributes:
        folder: where the files are.
        direct: for each run whether it predicts the current itself.
    """

    folder: Path
    direct: dict[str, bool] = field(default_factory=dict)

    def put(self, scored: Score) -> None:
        """Keep the residuals of a score."""
        name = scored.contestant.name
        np.save(self.folder / f"{name}.npy", np.stack([scored.error, scored.smooth]))
        self.direct[name] = scored.contestant.observer is None

    def error(self, name: str, rows: slice) -> FloatArray:
        """Residual (rows, n) of a run against the current as logged."""
        return self._read(name, 0, rows)

    def smooth(self, name: str, rows: slice) -> FloatArray:
        """Residual (rows, n) of a run at the common bandwidth."""
        return self._read(name, 1, rows)

    def write(self, tests: HeldOut, folder: Path) -> None:
        """Write ``predictions/<log>.parquet`` of each test log into ``folder``.

        Columns: ``t``, the measured ``i1..in``, and for each run NAME the predicted current ``NAME.p1..NAME.pn`` (of
        observers, which predict none, there is none) and its residual at the common bandwidth ``NAME.r1..NAME.rn``.
        """
        (folder / FOLDER).mkdir(parents=True, exist_ok=True)
        for log, rows in zip(tests.logs, tests.rows, strict=True):
            columns: dict[str, FloatArray] = {}
            for name, direct in self.direct.items():
                if direct:
                    columns[f"{name}.p"] = self.error(name, rows) + log.current
                columns[f"{name}.r"] = self.smooth(name, rows)
            with PredictionWriter(folder / FOLDER / f"{log.name}.parquet") as writer:
                writer.write(log, columns)

    def _read(self, name: str, which: int, rows: slice) -> FloatArray:
        stored = np.load(self.folder / f"{name}.npy", mmap_mode="r")
        return np.array(stored[which, rows])
