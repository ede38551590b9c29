"""Any readable log to the contract's CSV or Parquet."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ident.errors import InputError
from ident.log_writer import LogWriter
from ident.readers import open_log
from ident.robot import Robot

BLOCK_ROWS = 65536


def convert(
    robot: Robot, source: str | Path, target: str | Path, start: float | None = None, stop: float | None = None
) -> int:
    """Convert a log, block by block, and return the number of rows written.

    Args:
        robot: whose log it is.
        source: a log of any readable format.
        target: the file to write, .csv or .parquet; one there before is replaced when all is written.
        start: seconds after the first sample at which to begin; from the first sample where left out.
        stop: seconds after the first sample before which to end; to the last sample where left out.

    Raises:
        InputError: the log cannot be read, nothing is left of it, or the target cannot be written.
    """
    source, target = Path(source), Path(target)
    if target.exists() and target.resolve() == source.resolve():
        raise InputError("source and target are the same file", str(source), "give the target another name")
    low = -np.inf if start is None else start
    high = np.inf if stop is None else stop
    rows, first = 0, None
    with LogWriter(target) as writer:
        for block in open_log(source, robot).blocks(BLOCK_ROWS):
            first = float(block.t[0]) if first is None else first
            since = block.t - first
            # Inside a block time increases, so what is kept is one stretch.
            a, b = np.searchsorted(since, [low, high])
            writer.write(block[int(a) : int(b)])
            rows += max(0, int(b) - int(a))
        if rows == 0:
            what = f"no sample from {low:g} s to {high:g} s after the first"
            raise InputError(what, str(source), "choose start and stop inside the log")
    return rows
