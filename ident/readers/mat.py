"""Logs in MATLAB's .mat (to version 7.2), through the card's [log] names."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.io

from ident.arrays import Array
from ident.errors import InputError
from ident.log import JointLog
from ident.readers.arrays import numeric
from ident.readers.columns import Columns, assemble, find_columns
from ident.readers.source import FileLog


class MatLog(FileLog):
    """A .mat file with a (N, 1), (1, N) or (N, n) array a quantity."""

    def _pieces(self) -> Iterator[tuple[JointLog, Columns]]:
        try:
            file: dict[str, Array] = scipy.io.loadmat(self.path)
        except NotImplementedError:
            how = "save it with save(..., '-v7')"
            raise InputError("MATLAB 7.3 files are not read", str(self.path), how) from None
        except (OSError, ValueError, TypeError, scipy.io.matlab.MatReadError) as error:
            raise InputError(f"cannot be read as .mat ({error})", str(self.path), "write the file again") from None
        available = [name for name in file if not name.startswith("__")]
        columns = find_columns(available, self.robot, self.path)
        arrays = numeric({name: file[name] for name in columns.all}, str(self.path))
        upright = {name: _upright(value) for name, value in arrays.items()}
        yield assemble(upright, columns, self.robot.n, self.path), columns


def _upright(value: Array) -> Array:
    """Turn MATLAB's row and column vectors into (N,)."""
    return np.ravel(value) if value.ndim == 2 and 1 in value.shape else value
