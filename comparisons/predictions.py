"""Predictions row for row with test logs, and how far they are from what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import JointLog, LogSource
from ident.predictor import CurrentPredictor

FOLDER = "predictions"


@dataclass
class Errors:
    """Running errors of predictions against the current as logged, in its unit; rows without a prediction are skipped.

    Attributes:
        squares, power: sums of squared errors and squared currents, (n,).
        rows: rows predicted.
        skipped: rows that could not be predicted, by log.
    """

    squares: FloatArray
    power: FloatArray
    rows: int = 0
    skipped: dict[str, int] = field(default_factory=dict)

    @staticmethod
    def of(n: int) -> Errors:
        """Return errors of n joints, with nothing in them yet."""
        return Errors(np.zeros(n), np.zeros(n))

    def add(self, log: JointLog, predicted: FloatArray) -> None:
        """Take in a log and its prediction (N, n)."""
        known = np.isfinite(predicted).all(axis=1) & np.isfinite(log.current).all(axis=1)
        measured = log.current[known]
        self.squares += np.sum((measured - predicted[known]) ** 2, axis=0)
        self.power += np.sum(measured**2, axis=0)
        self.rows += len(measured)
        self.skipped[log.name] = int(np.sum(~known))

    @property
    def rmse(self) -> FloatArray:
        """Root mean square error, (n,)."""
        return np.asarray(np.sqrt(self.squares / self.rows) if self.rows else np.full(len(self.squares), np.nan))

    def as_dict(self) -> dict[str, Any]:
        """Figures as result.json holds them."""
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = 100.0 * np.sqrt(self.squares / self.power)
        return {"rmse": self.rmse, "relative_error_percent": relative, "rows": self.rows}


def errors_on(predictor: CurrentPredictor, logs: Sequence[LogSource]) -> Errors:
    """Return the errors of a predictor on logs, with the filters that run online; nothing is written."""
    errors = Errors.of(predictor.n)
    for source in logs:
        log = source.read()
        errors.add(log, predictor.predict(log, causal=True))
    return errors


def write_predictions(predictor: CurrentPredictor, logs: Sequence[LogSource], folder: Path) -> Errors:
    """Write ``predictions/<log>.parquet`` for each log into ``folder``: t, measured i1..in, predicted p1..pn.

    The filters are those that run online.

    Raises:
        InputError: two logs have the same name, so one would overwrite the other.
    """
    names = [source.name for source in logs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two test logs are named {name}", "--test", "rename one of them")
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    errors = Errors.of(predictor.n)
    for source in logs:
        log = source.read()
        predicted = predictor.predict(log, causal=True)
        errors.add(log, predicted)
        write_columns(folder / FOLDER / f"{source.name}.parquet", log, {"p": predicted})
    return errors


def write_columns(path: Path, log: JointLog, predictions: dict[str, FloatArray]) -> None:
    """Write t and i1..in of a log and predictions (N, n), a letter each, as a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {"t": log.t}
    for letter, values in {"i": log.current, **predictions}.items():
        columns |= {f"{letter}{joint + 1}": values[:, joint] for joint in range(log.n)}
    pq.write_table(pa.table({name: pa.array(values) for name, values in columns.items()}), path)
