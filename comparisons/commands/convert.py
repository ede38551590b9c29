"""``sensorless convert``: any readable log in the columns and units of the contract."""

from __future__ import annotations

from pathlib import Path


def convert(
    robot: str, source: Path, target: Path, /, *, start: float | None = None, stop: float | None = None
) -> None:
    """Convert a log to CSV or Parquet, in the columns and units of the contract.

    Args:
        robot: a robot card, or the name of a built-in robot; its [log] table says how to read foreign columns.
        source: the log to read: .csv, .parquet, .db3, .mcap, .bag, .npz, .mat, or a folder of a rosbag2.
        target: the file to write, .csv or .parquet.
        start: seconds after the first sample at which to begin.
        stop: seconds after the first sample before which to end.
    """
    from ident.convert import convert as write_converted
    from ident.robot import load_robot

    rows = write_converted(load_robot(robot), source, target, start, stop)
    print(f"{target}: {rows} rows")
