"""Logs in NumPy's .npz, through the card's [log] names."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator

import numpy as np

from ident.errors import InputError
from ident.log import JointLog
from ident.readers.arrays import numeric
from ident.readers.columns import Columns, assemble, find_columns
from ident.readers.source import FileLog


class NpzLog(FileLog):
    """An .npz file with a (N,) or (N, n) array a quantity."""

    def _pieces(self) -> Iterator[tuple[JointLog, Columns]]:
        try:
            with np.load(self.path, allow_pickle=False) as file:
                columns = find_columns(file.files, self.robot, self.path)
                arrays = {name: file[name] for name in columns.all}
        except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
            raise InputError(f"cannot be read as .npz ({error})", str(self.path), "write the file again") from None
        yield assemble(numeric(arrays, str(self.path)), columns, self.robot.n, self.path), columns
