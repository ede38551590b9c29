"""A checkpoint of training, whole or not there at all, whenever the process is killed."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import torch


def write_whole(path: Path, content: dict[str, Any]) -> None:
    """Write ``content`` so that ``path`` holds either the old checkpoint or the new one, also after a loss of power."""
    beside = path.with_suffix(".part")
    with beside.open("wb") as file:
        torch.save(content, file)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)


def read_matching(path: Path, fingerprint: str) -> dict[str, Any] | None:
    """Return a checkpoint of the same training, else None; tensors and plain values only, nothing that can run code."""
    if not path.is_file():
        return None
    content: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    return content if content["fingerprint"] == fingerprint else None
