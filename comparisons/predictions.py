"""Predictions row for row with test logs, and how far they are from what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import JointLog, LogSource
from ident.model import CurrentModel
from ident.predictor import CurrentPredictor
from ident.signals import zero_phase

FOLDER = "predictions"


@dataclass
class Errors:
    """Running errors of predictions against the current as logged, in its unit; rows without a prediction are skipped.

    Attributes:
        squares, power: sums of squared errors and squared currents, (n,).
        cutoff: cut-off [Hz] of the zero-phase filter behind which errors are told apart from sensor noise; None: none.
        squares_filtered, power_filtered: the same sums behind that filter, (n,).
        rows: rows predicted.
        skipped: rows that could not be predicted, by log.
    """

    squares: FloatArray
    power: FloatArray
    squares_filtered: FloatArray
    power_filtered: FloatArray
    cutoff: float | None = None
    rows: int = 0
    skipped: dict[str, int] = field(default_factory=dict)

    @staticmethod
    def of(n: int, cutoff: float | None = None) -> Errors:
        """Return errors of n joints, with nothing in them yet."""
        return Errors(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), cutoff)

    def add(self, log: JointLog, predicted: FloatArray) -> None:
        """Take in a log and its prediction (N, n)."""
        known = np.isfinite(predicted).all(axis=1) & np.isfinite(log.current).all(axis=1)
        measured = log.current[known]
        self.squares += np.sum((measured - predicted[known]) ** 2, axis=0)
        self.power += np.sum(measured**2, axis=0)
        self.rows += len(measured)
        if self.cutoff is not None and len(measured) > 1:
            both = np.hstack([measured - predicted[known], measured])
            filtered = np.nan_to_num(zero_phase(both, log.rate, self.cutoff))
            squares, power = np.split(np.sum(filtered**2, axis=0), 2)
            self.squares_filtered += squares
            self.power_filtered += power
        self.skipped[log.name] = self.skipped.get(log.name, 0) + int(np.sum(~known))

    @property
    def rmse(self) -> FloatArray:
        """Root mean square error, (n,)."""
        return np.asarray(np.sqrt(self.squares / self.rows) if self.rows else np.full(len(self.squares), np.nan))

    def as_dict(self) -> dict[str, Any]:
        """Figures as result.json holds them."""
        with np.errstate(divide="ignore", invalid="ignore"):
            figures = {
                "rmse": self.rmse,
                "relative_error_percent": 100.0 * np.sqrt(self.squares / self.power),
                "relative_error_percent_overall": 100.0 * float(np.sqrt(self.squares.sum() / self.power.sum())),
                "rows": self.rows,
                "skipped": sum(self.skipped.values()),
            }
            if self.cutoff is None:
                return figures
            behind, power = self.squares_filtered, self.power_filtered
            overall = 100.0 * float(np.sqrt(behind.sum() / power.sum()))
            return figures | {
                "rmse_filtered": np.sqrt(behind / self.rows),
                "relative_error_percent_filtered": 100.0 * np.sqrt(behind / power),
                "relative_error_percent_filtered_overall": overall,
            }


def predictions(predictor: CurrentPredictor, source: LogSource, causal: bool) -> Iterator[tuple[JointLog, FloatArray]]:
    """Walk a log with its prediction (rows, n); in bounded memory where the predictor can predict block by block."""
    if isinstance(predictor, CurrentModel) and not causal:
        yield from predictor.predict_blocks(source)
    else:
        log = source.read()
        yield log, predictor.predict(log, causal)


def errors_on(
    predictor: CurrentPredictor, logs: Sequence[LogSource], causal: bool = True, cutoff: float | None = None
) -> Errors:
    """Return the errors of a predictor on logs; nothing is written.

    Args:
        predictor: what predicts.
        logs: logs with measured currents.
        causal: use the filters that run online, rather than those without lag.
        cutoff: of the filter [Hz] behind which the errors are given as well.
    """
    errors = Errors.of(predictor.n, cutoff)
    for source in logs:
        for log, predicted in predictions(predictor, source, causal):
            errors.add(log, predicted)
    return errors


def write_predictions(
    predictor: CurrentPredictor,
    logs: Sequence[LogSource],
    folder: Path,
    causal: bool = True,
    cutoff: float | None = None,
) -> Errors:
    """Write ``predictions/<log>.parquet`` for each log into ``folder``: t, measured i1..in, predicted p1..pn.

    Options are those of `errors_on`.

    Raises:
        InputError: two logs have the same name, so one would overwrite the other.
    """
    refuse_same_names(logs)
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    errors = Errors.of(predictor.n, cutoff)
    for source in logs:
        with PredictionWriter(folder / FOLDER / f"{source.name}.parquet") as writer:
            for log, predicted in predictions(predictor, source, causal):
                errors.add(log, predicted)
                writer.write(log, {"p": predicted})
    return errors


def refuse_same_names(logs: Sequence[LogSource]) -> None:
    """Raise InputError where two logs have the same name, so that one's predictions would overwrite the other's."""
    names = [source.name for source in logs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two test logs are named {name}", "--test", "rename one of them")


class PredictionWriter:
    """Writes t, the measured i1..in and predictions of a log, block by block, as Parquet; use it in a ``with``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: Any = None

    def __enter__(self) -> PredictionWriter:
        return self

    def __exit__(self, *failure: object) -> None:
        if self._file is not None:
            self._file.close()

    def write(self, log: JointLog, predicted: dict[str, FloatArray]) -> None:
        """Write rows of a log with predictions (rows, n), each under a letter of its own."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = {"t": log.t}
        for letter, values in {"i": log.current, **predicted}.items():
            columns |= {f"{letter}{joint + 1}": values[:, joint] for joint in range(log.n)}
        table = pa.table({name: pa.array(values) for name, values in columns.items()})
        if self._file is None:
            self._file = pq.ParquetWriter(self.path, table.schema)
        self._file.write_table(table)
