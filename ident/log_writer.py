"""Writes logs in the contract's columns, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from ident.arrays import Array
from ident.errors import InputError
from ident.log import JointLog
from ident.readers.columns import contract_columns
from ident.readers.parquet import CONTRACT_MARK
from ident.readers.source import join

GROUP_ROWS = 65536
"""Rows held back to make row groups of a useful size."""


def write_log(log: JointLog, path: str | Path) -> None:
    """Write a log to CSV or Parquet, by suffix; a file there before is replaced only when all is written.

    Args:
        log: what to write, in the columns of the contract.
        path: of the file, ending in .csv or .parquet.

    Raises:
        InputError: the suffix is neither, or the folder cannot be written to.
    """
    with LogWriter(path) as writer:
        writer.write(log)


class LogWriter:
    """Writes a log block by block to CSV or Parquet, by suffix; use it in a ``with`` statement.

    The rows go to a hidden file beside the target, which takes its place on leaving the ``with`` and vanishes on an
    error. The columns are those of the first block.

    Args:
        path: of the file to write.

    Raises:
        InputError: the suffix is neither, or the folder cannot be written to.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.suffix.lower() not in (".csv", ".parquet"):
            what = f"logs are not written as {self.path.suffix or 'files without suffix'}"
            raise InputError(what, str(self.path), "give a name that ends in .csv or .parquet")
        if not self.path.parent.is_dir():
            raise InputError("no such folder", str(self.path.parent), "make it first")
        self._draft = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        self._sink: Any = None
        self._schema: pa.Schema | None = None
        self._held: list[JointLog] = []

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._flush()
                if self._sink is None:
                    raise InputError("no rows to write", str(self.path), "give a log with at least one sample")
                self._sink.close()
                self._draft.replace(self.path)
        finally:
            if self._sink is not None:
                self._sink.close()
            self._draft.unlink(missing_ok=True)

    def write(self, block: JointLog) -> None:
        """Add rows after those written before.

        Raises:
            InputError: the block has other columns than the first one.
        """
        if len(block) == 0:
            return
        self._held.append(block)
        if sum(map(len, self._held)) >= GROUP_ROWS:
            self._flush()

    def _flush(self) -> None:
        for log in _alike(self._held):
            columns = _columns(log)
            table = pa.table(columns).replace_schema_metadata({CONTRACT_MARK: b"log"})
            if self._schema is None:
                self._open(table.schema)
            elif table.schema != self._schema:
                what = f"a block with columns {', '.join(table.schema.names)} after {', '.join(self._schema.names)}"
                raise InputError(what, str(self.path), "give every block the same columns")
            self._sink.write_table(table, 2 * GROUP_ROWS)  # so that a little over is no group of its own
        self._held = []

    def _open(self, schema: pa.Schema) -> None:
        self._schema = schema
        try:
            if self.path.suffix.lower() == ".parquet":
                self._sink = pyarrow.parquet.ParquetWriter(self._draft, schema, compression="zstd")
                return
            options = pyarrow.csv.WriteOptions(quoting_style="none", quoting_header="none")
            self._sink = pyarrow.csv.CSVWriter(self._draft, schema, write_options=options)
        except OSError as error:
            what = f"cannot be written ({error.strerror or error})"
            raise InputError(what, str(self.path), "check the folder's permissions and space") from None


def _alike(blocks: list[JointLog]) -> Iterator[JointLog]:
    """Join neighbouring blocks that have the same fields."""
    run: list[JointLog] = []
    for block in blocks:
        if run and _columns(run[0][:0]).keys() != _columns(block[:0]).keys():
            yield join(run)
            run = []
        run.append(block)
    if run:
        yield join(run)


def _columns(log: JointLog) -> dict[str, Array]:
    """Return a log's columns by their contract names."""
    columns: dict[str, Array] = {}
    for key, names in contract_columns(log.n).items():
        value = getattr(log, key)
        if value is not None:
            columns |= dict(zip(names, np.atleast_2d(value.T), strict=True))
    return columns
