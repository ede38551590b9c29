"""Progress of long work: a bar on a terminal, nothing in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str, float], None]
"""Called with the name of the stage under way and the share of it done, 0 to 1."""


@contextmanager
def show_progress() -> Iterator[Progress]:
    """Give a function that shows progress on standard error while the block runs.

    Each new stage gets a line of its own below the former. Where standard error is no terminal nothing is printed.
    """
    if not sys.stderr.isatty():
        yield show_nothing
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    stages: dict[str, TaskID] = {}
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as bars:

        def advance(stage: str, share: float) -> None:
            if stage not in stages:
                stages[stage] = bars.add_task(stage, total=1.0)
            bars.update(stages[stage], completed=min(max(share, 0.0), 1.0))

        yield advance


def show_nothing(stage: str, share: float) -> None:
    """Show nothing.

    Args:
        stage: what is being done.
        share: of it that is done.
    """
