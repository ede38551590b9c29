"""How many threads a training takes on the CPU."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import nn

WORTH_SHARING = 1e8
"""Multiply-adds of a batch's forward pass below which threads wait for one another longer than they calculate."""


@contextmanager
def at_most(threads: int) -> Iterator[None]:
    """Let Torch take at most so many threads, or fewer where the environment asks for fewer."""
    before = torch.get_num_threads()
    torch.set_num_threads(min(threads, before))
    try:
        yield
    finally:
        torch.set_num_threads(before)


def worth_having(module: nn.Module, rows: int) -> int:
    """Return the threads that a step of a network on so many rows is quickest with: one, or all there are."""
    weights = sum(weight.numel() for weight in module.parameters())
    return torch.get_num_threads() if rows * weights >= WORTH_SHARING else 1
