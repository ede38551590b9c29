"""Training many networks side by side: methods, sizes and seeds, on the cores of one machine or of many."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from joblib import Parallel, delayed

from ident.log import LogSource
from ident.predictor import CurrentPredictor
from learned.model_file import TrainedModel
from learned.options import TrainingOptions
from learned.predictor import LearnedModel

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True)
class Run:
    """One training of a sweep; ``name`` is also the folder of its model."""

    name: str
    method: str
    options: TrainingOptions


def sweep(
    robot: Robot,
    train_logs: Sequence[LogSource],
    validation_logs: Sequence[LogSource] | None,
    runs: Sequence[Run],
    physics: CurrentPredictor | None = None,
    out: Path | None = None,
    jobs: int = 1,
) -> dict[str, LearnedModel]:
    """Train all runs and return their models by name, in the order of ``runs``.

    With ``out`` each run keeps its checkpoint and model in a folder of its own there; a run whose model is there is
    read, so a sweep that was killed goes on. Which cores do the work is joblib's affair: within its
    ``parallel_config`` with the Dask backend they may be those of a cluster.

    Args:
        robot: the robot.
        train_logs, validation_logs: as of ``train``.
        runs: what to train.
        physics: the identified model that hybrids stand on; other methods do without.
        out: folder for the models.
        jobs: trainings at a time, -1 for one a core; each has its share of the cores.

    Raises:
        InputError: as ``train`` does.
    """
    share = max(1, (os.cpu_count() or 1) // (jobs if jobs > 0 else (os.cpu_count() or 1)))
    tasks = (
        delayed(_one)(robot, train_logs, validation_logs, run, physics, None if out is None else out / run.name, share)
        for run in runs
    )
    trained = Parallel(n_jobs=jobs)(tasks)
    below = {run.name: physics if run.method == "hybrid" else None for run in runs}
    return {run.name: LearnedModel(model, below[run.name]) for run, model in zip(runs, trained, strict=True)}


def _one(
    robot: Robot,
    train_logs: Sequence[LogSource],
    validation_logs: Sequence[LogSource] | None,
    run: Run,
    physics: CurrentPredictor | None,
    out: Path | None,
    threads: int,
) -> TrainedModel:
    """Train one run on its share of the cores, unless it is done."""
    import torch

    from learned.model_file import is_trained_model
    from learned.stages import CHECKPOINT
    from learned.training import train

    if out is not None and is_trained_model(out) and not (out / CHECKPOINT).exists():
        return TrainedModel.load(out)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        below = physics if run.method == "hybrid" else None
        return train(robot, train_logs, validation_logs, run.method, run.options, out, physics=below).trained
    finally:
        torch.set_num_threads(before)
