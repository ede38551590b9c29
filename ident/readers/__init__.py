"""Readers of logs, one file a format."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import InputError
from ident.log import LogSource

if TYPE_CHECKING:
    from ident.robot import Robot

SUFFIXES = (".csv", ".parquet", ".db3", ".mcap", ".bag", ".npz", ".mat")
"""Suffixes of the files that are read; a folder with metadata.yaml is a rosbag2."""


def open_log(path: str | Path, robot: Robot) -> LogSource:
    """Open a log of any readable format, by its suffix; nothing is read before it is walked.

    Args:
        path: a file, or the folder of a rosbag2 (without its metadata.yaml: a folder with one log in it).
        robot: whose log it is; its card may map foreign column names.

    Raises:
        InputError: there is no such file, or its format is not read.
    """
    path = Path(path)
    if not path.exists():
        raise InputError("no such log", str(path), "check the path")
    if path.is_dir() and not _is_bag_folder(path):
        inside = log_files(path)
        if len(inside) != 1:
            raise InputError(f"a folder with {len(inside)} logs in it", str(path), "name one of them")
        return open_log(inside[0], robot)
    suffix = ".bag" if _is_bag_folder(path) else path.suffix.lower()
    # The readers' libraries are heavy and mostly not needed: only the one that is asked for is imported.
    if suffix == ".csv":
        from ident.readers.csv import CsvLog

        return CsvLog(path, robot)
    if suffix == ".parquet":
        from ident.readers.parquet import ParquetLog

        return ParquetLog(path, robot)
    if suffix == ".npz":
        from ident.readers.npz import NpzLog

        return NpzLog(path, robot)
    if suffix == ".mat":
        from ident.readers.mat import MatLog

        return MatLog(path, robot)
    if suffix in (".db3", ".mcap", ".bag"):
        from ident.readers.rosbag import BagLog

        return BagLog(path, robot)
    raise InputError(f"format {suffix or 'without suffix'} is not read", str(path), f"give {', '.join(SUFFIXES)}")


def open_logs(patterns: Sequence[str | Path], robot: Robot) -> list[LogSource]:
    """Open every log that files, globs and folders name, sorted within each pattern, each only once.

    Args:
        patterns: files, globs (``**`` goes into folders) or folders, whose logs are taken without going deeper.
        robot: whose logs they are.

    Raises:
        InputError: a pattern names no log, or there is none at all.
    """
    paths: dict[Path, Path] = {}
    for pattern in patterns:
        found = log_files(Path(pattern))
        if not found:
            what = "no log in the folder" if Path(pattern).is_dir() else "no log matches"
            raise InputError(what, str(pattern), f"give files ({', '.join(SUFFIXES)}), a glob or a folder")
        for path in found:
            paths.setdefault(path.resolve(), path)
    if not paths:
        raise InputError("no logs", "the list of logs", "name at least one file, glob or folder")
    return [open_log(path, robot) for path in paths.values()]


def log_files(pattern: Path) -> list[Path]:
    """Return what a file, glob or folder names, sorted; nothing where it names no log.

    Args:
        pattern: a file, a glob (``**`` goes into folders), or a folder, whose logs are taken without going deeper.
    """
    if pattern.is_dir() and not _is_bag_folder(pattern):
        return sorted(path for path in pattern.iterdir() if _is_log(path))
    if pattern.exists():
        return [pattern]
    return sorted(path for path in map(Path, glob.glob(str(pattern), recursive=True)) if _is_log(path))


def _is_log(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES if path.is_file() else _is_bag_folder(path)


def _is_bag_folder(path: Path) -> bool:
    return path.is_dir() and (path / "metadata.yaml").is_file()
