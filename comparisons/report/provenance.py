"""Where a result comes from: what has to be known to get it again."""

from __future__ import annotations

import importlib.metadata
import platform
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ident.readers import log_files

LIBRARIES = ("numpy", "scipy", "pin", "numba")
"""Libraries whose version may change a figure."""


@dataclass(frozen=True)
class Provenance:
    """The run behind a result.

    Attributes:
        command: the command line, as it can be pasted into a shell.
        date: when, in UTC, ISO 8601 to the second.
        versions: of the program, of Python and of libraries, by name.
        machine: operating system and architecture.
        seed: of every random draw, where there was one.
        inputs: (path, bytes) of the files read.
    """

    command: str
    date: str
    versions: dict[str, str]
    machine: str
    seed: int | None
    inputs: tuple[tuple[str, int], ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in result.json."""
        inputs = [{"path": path, "bytes": size} for path, size in self.inputs]
        return {
            "command_line": self.command,
            "date": self.date,
            "versions": self.versions,
            "machine": self.machine,
            "seed": self.seed,
            "inputs": inputs,
        }


def provenance(
    inputs: Sequence[str | Path] = (),
    *,
    seed: int | None = None,
    command: Sequence[str] | None = None,
    libraries: Sequence[str] = (),
) -> Provenance:
    """Note the run under way.

    Args:
        inputs: files read, or globs of them; a folder counts with all files in it.
        seed: of the random draws, if there were any.
        command: its words; those of the process unless given.
        libraries: further distributions whose version matters, such as torch; one that is absent is left out.
    """
    words = [Path(sys.argv[0]).name, *sys.argv[1:]] if command is None else list(command)
    versions = {"sensorless": _version("sensorless"), "python": platform.python_version()}
    versions |= {name: _version(name) for name in [*LIBRARIES, *libraries]}
    return Provenance(
        command=shlex.join(words),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        versions={name: version for name, version in versions.items() if version},
        machine=f"{platform.system()} {platform.machine()}",
        seed=seed,
        inputs=tuple((str(path), _size(path)) for given in inputs for path in _read(Path(given))),
    )


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _read(given: Path) -> list[Path]:
    return [given] if given.exists() else log_files(given) or [given]


def _size(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())
