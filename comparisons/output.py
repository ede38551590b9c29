"""The output directory of a command: written whole or not at all."""

from __future__ import annotations

import errno
import json
import math
import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any

import numpy as np

from ident.errors import InputError

RESULT = "result.json"


class OutputDirectory:
    """Collects what a command makes and puts it into its directory at the end, if the command comes to its end.

    Used as a context manager: files are written under ``path``, a hidden folder beside or inside the directory. Leaving
    the block normally moves them into place; leaving it by an exception removes them and the directory stays as it was.
    Files that a former run of the same command listed in its result.json and this one did not make are removed, so that
    results of two runs never mix; all other files in the directory are kept.

    Args:
        directory: where the files belong; made, with its parents, if it does not exist.
        command: name of the command that makes them.

    Raises:
        InputError: the directory cannot be made or written.
    """

    def __init__(self, directory: str | Path, command: str) -> None:
        self.directory = Path(directory)
        self.command = command
        self.path = self.directory
        self._result: Mapping[str, Any] | None = None
        self._made: list[Path] = []

    def __enter__(self) -> OutputDirectory:
        try:
            # Inside the directory where it exists: it may be a mount of its own, or somebody's working directory.
            home = self.directory if self.directory.exists() else self._make_parents()
            self.path = Path(tempfile.mkdtemp(prefix=".sensorless-", dir=home))
        except OSError as error:
            self._remove_parents()
            raise self._unwritable(error) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._publish()
                self._made = []
        except OSError as failure:
            raise self._unwritable(failure) from failure
        finally:
            shutil.rmtree(self.path, ignore_errors=True)
            self._remove_parents()

    def result(self, result: Mapping[str, Any]) -> None:
        """Set what result.json will hold; ``command`` and ``files``, the list of all files made, are added to it.

        Args:
            result: JSON-like values; numpy arrays and scalars are converted, NaN and infinities become null.
        """
        self._result = result

    def _publish(self) -> None:
        stale = listed_files(self.directory, self.command)
        if self._result is not None:
            account = {"command": self.command, "files": sorted([*_files(self.path), RESULT])}
            (self.path / RESULT).write_text(to_json({**self._result, **account}), encoding="utf-8")
        if not self.directory.exists():
            # Made anew rather than renamed: mkdtemp gave its folder to its owner alone.
            self.directory.mkdir()
            self._made.append(self.directory)
        made = _files(self.path)
        with tempfile.TemporaryDirectory(prefix=".sensorless-", dir=self.directory) as attic:
            _move(self.path, self.directory, Path(attic), made, [name for name in stale if name not in made])

    def _make_parents(self) -> Path:
        """Make the parents of the directory, remembering which: a failing run takes them away again."""
        parent = self.directory.absolute().parent
        missing = [folder for folder in [parent, *parent.parents] if not folder.exists()]
        for folder in reversed(missing):
            folder.mkdir()
            self._made.append(folder)
        return parent

    def _remove_parents(self) -> None:
        for folder in reversed(self._made):
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()

    def _unwritable(self, error: OSError) -> InputError:
        reason = error.strerror or type(error).__name__
        return InputError(f"output cannot be written ({reason})", str(self.directory), "give another --out")


def listed_files(directory: Path, command: str) -> list[str]:
    """Files that a run of a command made, as the directory's result.json says; those of them that are still there.

    Args:
        directory: of the run.
        command: whose run it must have been.
    """
    try:
        former = json.loads((directory / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    if not isinstance(former, dict) or former.get("command") != command:
        return []
    listed = former.get("files")
    names = [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []
    # The file may have been edited: nothing outside the directory is ever ours.
    inside = [name for name in names if not PurePosixPath(name).is_absolute() and ".." not in PurePosixPath(name).parts]
    return [name for name in inside if (directory / name).is_file()]


def to_json(result: Mapping[str, Any]) -> str:
    """Write a result as JSON: numpy values converted, numbers that JSON lacks (NaN, infinities) as null.

    Args:
        result: numbers, arrays, strings, and mappings and sequences of them.
    """
    return json.dumps(_plain(result), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no place in a result")


def _files(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def _move(source: Path, target: Path, attic: Path, names: list[str], stale: list[str]) -> None:
    """Move files into ``target``; what they replace and what is stale goes to ``attic``, and back if one step fails."""
    undo: list[tuple[Path, Path]] = []

    def rename(old: Path, new: Path) -> None:
        new.parent.mkdir(parents=True, exist_ok=True)
        os.rename(old, new)
        undo.append((new, old))

    try:
        for name in [*stale, *names]:
            if (target / name).is_dir():
                raise IsADirectoryError(errno.EISDIR, f"{name} is a folder there")
            if (target / name).exists():
                rename(target / name, attic / name)
        for name in names:
            rename(source / name, target / name)
    except BaseException:
        for new, old in reversed(undo):
            os.rename(new, old)
        raise
    for folder in {(target / name).parent for name in stale} - {target}:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
