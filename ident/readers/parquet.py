"""Logs in Parquet, walked row group by row group."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from ident.arrays import Array
from ident.errors import InputError
from ident.log import JointLog
from ident.readers.columns import Columns, assemble, find_columns
from ident.readers.source import FileLog

CONTRACT_MARK = b"sensorless"
"""Key in the schema's metadata of files written here: their columns are the contract's, whatever the card maps."""
BATCH_ROWS = 65536


class ParquetLog(FileLog):
    """A Parquet file; only the needed columns of one batch are in memory at a time."""

    def _pieces(self) -> Iterator[tuple[JointLog, Columns]]:
        try:
            with pyarrow.parquet.ParquetFile(self.path) as file:
                marked = CONTRACT_MARK in (file.schema_arrow.metadata or {})
                columns = find_columns(file.schema_arrow.names, self.robot, self.path, contract=marked)
                for batch in file.iter_batches(BATCH_ROWS, columns=columns.all):
                    arrays = {name: self._array(batch.column(name), name) for name in columns.all}
                    yield assemble(arrays, columns, self.robot.n, self.path), columns
        except (pa.ArrowException, OSError) as error:
            reason = str(error).splitlines()[0]
            raise InputError(f"cannot be read as Parquet ({reason})", str(self.path), "write the file again") from None

    def _array(self, column: pa.Array, name: str) -> Array:
        """Return a column as (N,) numbers, or (N, k) where each cell is a list."""
        if pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type):
            cells = self._array(column.flatten(), name)
            if len(column) and len(cells) % len(column):
                what = f"the lists in column {name} differ in length"
                raise InputError(what, str(self.path), "give every row one value a joint")
            return cells.reshape(len(column), -1)
        if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
            raise InputError(f"column {name} holds {column.type}, not numbers", str(self.path), "write it as float64")
        values: Array = column.to_numpy(zero_copy_only=False)
        return values if values.dtype.kind in "iu" else values.astype(np.float64)
