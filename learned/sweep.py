"""Training many networks side by side: methods, sizes and seeds, on the cores of one machine or of many."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from joblib import Parallel, delayed

from ident.errors import InputError
from ident.log import LogSource
from ident.predictor import CurrentPredictor
from learned.model_file import TrainedModel, is_trained_model
from learned.options import TrainingOptions
from learned.predictor import LearnedModel

if TYPE_CHECKING:
    from ident.robot import Robot

Figures = TypeVar("Figures")


@dataclass(frozen=True)
class Run:
    """One training of a sweep; ``name`` is also the folder of its model.

    Attributes:
        name: of the run, unlike any other's.
        method: one of `learned.networks.METHODS`.
        options: how it is trained.
    """

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
    share = _share(jobs)
    places = [None if out is None else out / run.name for run in runs]
    tasks = (
        delayed(_one)(robot, train_logs, validation_logs, run, physics, place, share)
        for run, place in zip(runs, places, strict=True)
    )
    trained = Parallel(n_jobs=jobs)(tasks)
    below = {run.name: physics if run.method == "hybrid" else None for run in runs}
    return {run.name: LearnedModel(model, below[run.name]) for run, model in zip(runs, trained, strict=True)}


Judge = Callable[[LearnedModel, Sequence[LogSource]], Figures]
"""Takes a model and logs it has not seen, and returns figures; called where the training was, so it must pickle."""


def cross_validate(
    robot: Robot,
    folds: Sequence[Sequence[LogSource]],
    runs: Sequence[Run],
    judge: Judge[Figures],
    physics: CurrentPredictor | None = None,
    out: Path | None = None,
    jobs: int = 1,
    done: Callable[[float], None] | None = None,
) -> dict[str, list[Figures]]:
    """Train all runs without each fold of the logs in turn, and judge them on that fold.

    Early stopping takes its frames from the training folds: what a model is judged by has no part in it. Parallel and
    resumable as `sweep` is; models that cannot be written by those who train them, because they are on other machines,
    are written here when they come back.

    Args:
        robot: the robot.
        folds: logs, at least two folds of them.
        runs: what to train.
        judge: what is asked of each model.
        physics: the identified model that hybrids stand on; it should not have seen the logs.
        out: folder for the models, ``RUN/fold-K``.
        jobs: trainings at a time, as of `sweep`.
        done: told the share that is done.

    Returns:
        Figures of each run by name, one of each fold.

    Raises:
        InputError: fewer than two folds, or as ``train`` does.
    """
    if len(folds) < 2:
        raise InputError(f"{len(folds)} fold", "cross-validation", "give at least two folds, with a log in each")
    share = _share(jobs)
    pairs = [(run, k) for run in runs for k in range(len(folds))]
    tasks = (
        delayed(_judged)(
            number, robot, [log for j, fold in enumerate(folds) if j != k for log in fold], folds[k], run, judge,
            physics, _fold(out, run, k), share,
        )
        for number, (run, k) in enumerate(pairs)
    )  # fmt: skip
    found: dict[tuple[str, int], Figures] = {}
    for number, trained, figures in Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks):
        run, k = pairs[number]
        place = _fold(out, run, k)
        if place is not None and not is_trained_model(place):
            trained.save(place)
        found[run.name, k] = figures
        if done is not None:
            done(len(found) / len(pairs))
    return {run.name: [found[run.name, k] for k in range(len(folds))] for run in runs}


def _fold(out: Path | None, run: Run, k: int) -> Path | None:
    return None if out is None else out / run.name / f"fold-{k + 1}"


def _share(jobs: int) -> int:
    """Cores that each of ``jobs`` trainings may use."""
    cores = os.cpu_count() or 1
    return max(1, cores // (jobs if jobs > 0 else cores))


def _judged(
    number: int,
    robot: Robot,
    train_logs: Sequence[LogSource],
    held_out: Sequence[LogSource],
    run: Run,
    judge: Judge[Figures],
    physics: CurrentPredictor | None,
    out: Path | None,
    threads: int,
) -> tuple[int, TrainedModel, Figures]:
    trained = _one(robot, train_logs, None, run, physics, out, threads)
    model = LearnedModel(trained, physics if run.method == "hybrid" else None)
    return number, trained, judge(model, held_out)


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
    from learned.stages import CHECKPOINT
    from learned.threads import at_most
    from learned.training import train

    if out is not None and is_trained_model(out) and not (out / CHECKPOINT).exists():
        return TrainedModel.load(out)
    with at_most(threads):
        below = physics if run.method == "hybrid" else None
        return train(robot, train_logs, validation_logs, run.method, run.options, out, physics=below).trained
