"""Which thresholds serve the motion discriminator: the paper's series of screening experiments, cross-validated.

Run it by ``python -m comparisons.experiments.screening --out DIR``; ``--jobs 2`` trains two candidates at a time,
``--scheduler tcp://HOST:8786`` on the workers of a Dask cluster (extra ``cluster``; workers must see logs and DIR under
the same paths). A run that was killed goes on when it is started again. It writes ``screening.json``, ``screening.md``
and ``screening.png`` into DIR, and keeps logs and models there. Each candidate is trained without each fold of the logs
in turn and judged on that fold.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import cyclopts

from comparisons.cli import run_alone
from comparisons.cluster import workers
from comparisons.comparison.held_out import HeldOut
from comparisons.experiments.candidates import Candidate, load_grid
from comparisons.experiments.screening_page import ranked, screening_figure, screening_page
from comparisons.metrics import error_figures
from comparisons.output import to_json
from comparisons.progress import Progress, show_progress
from comparisons.protocols import named
from comparisons.report.compliance_figures import save
from comparisons.report.provenance import provenance
from comparisons.virtual_robot import VirtualRobot
from ident.errors import InputError
from ident.log import LogSource
from ident.log_writer import write_log
from ident.readers import open_logs
from ident.robot import Robot, load_robot
from learned.options import TrainingOptions
from learned.predictor import LearnedModel
from learned.sweep import Run, cross_validate

if TYPE_CHECKING:
    from ident.arrays import FloatArray

By = Literal["rmse", "rmse_static", "rmse_moving", "rmse_transition"]
Many = cyclopts.Parameter(consume_multiple=True, negative="")


def screening(
    *,
    out: Path,
    robot: str = "vs060",
    logs: Annotated[list[Path] | None, Many] = None,
    grid: Path | None = None,
    folds: int = 3,
    seconds: float = 1200.0,
    epochs: int = 4,
    width: int = 64,
    batch: int = 512,
    by: By = "rmse_static",
    jobs: int = 1,
    scheduler: str | None = None,
    seed: int = 0,
) -> None:
    """Choose the thresholds of the motion discriminator by cross-validation over logs.

    Args:
        out: directory for the result, logs and models.
        robot: a robot card, or the name of a built-in robot.
        logs: to learn from and to judge by: files, globs or folders; by default stop-and-go motion is recorded.
        grid: TOML file of candidates; by default the paper's groups and what surrounds them.
        folds: that the logs are dealt to.
        seconds: of motion recorded for each fold, where no logs are given.
        epochs: of each training.
        width: of the hidden layers.
        batch: frames a step.
        by: figure that the choice goes by.
        jobs: trainings at a time on this machine, -1 for one a core.
        scheduler: address of a Dask scheduler whose workers train instead.
        seed: of weights and, where no logs are given, of motion.
    """
    if folds < 2:
        raise InputError(f"{folds} fold(s)", "--folds", "give at least 2")
    if jobs == 0:
        raise InputError("no training at a time", "--jobs 0", "give how many, or -1 for one a core")
    candidates = load_grid(grid)
    loaded = load_robot(robot)
    out.mkdir(parents=True, exist_ok=True)
    with show_progress() as progress, workers(scheduler):
        # workers need not stand where this process does
        home, given = out.absolute(), [path.absolute() for path in logs or []]
        sources = open_logs(given, loaded) if given else recorded(loaded, home / "logs", folds, seconds, seed, progress)
        dealt = [sources[k::folds] for k in range(folds)]
        if not all(dealt):
            what = f"{len(sources)} logs for {folds} folds"
            raise InputError(what, "--logs", "give as many logs as folds, or fewer folds")
        options = TrainingOptions(epochs=epochs, width=width, batch=batch, learning_rate=2e-3, seed=seed)
        runs = {run_of(one, options, sources): one for one in candidates}
        figures = cross_validate(
            loaded, dealt, list(runs), judge, None, home / "models", -1 if scheduler else jobs,
            partial(progress, "screening"),
        )  # fmt: skip
    words = ["python", "-m", "comparisons.experiments.screening", *sys.argv[1:]]
    note = provenance([*(logs or [out / "logs"])], seed=seed, command=words, libraries=("torch", "joblib", "dask"))
    result: dict[str, Any] = {
        "unit": loaded.unit,
        "by": by,
        "folds": [[log.name for log in fold] for fold in dealt],
        "epochs": epochs,
        "width": width,
        "candidates": {one.name: {**one.result(), "folds": figures[run.name]} for run, one in runs.items()},
        "provenance": note.to_dict(),
    }
    result["chosen"] = ranked(result)[0].name
    (out / "screening.json").write_text(to_json(result), encoding="utf-8")
    (out / "screening.md").write_text(screening_page(result), encoding="utf-8")
    save(screening_figure(result), out / "screening")
    print(f"{result['chosen']}: {out / 'screening.md'}")


def judge(model: LearnedModel, logs: Sequence[LogSource]) -> dict[str, FloatArray]:
    """Return the errors (n,) of a model on logs it has not seen, by regime."""
    import numpy as np

    tests = HeldOut.of(logs)
    error = np.concatenate([model.predict(log) - log.current for log in tests.logs])
    return {name: value for name, value in error_figures(error, tests.regimes).items() if name.startswith("rmse")}


def run_of(candidate: Candidate, options: TrainingOptions, logs: Sequence[LogSource]) -> Run:
    """Return the training of a candidate; its name tells all that decides what comes of it."""
    own = candidate.options(options)
    paths = [getattr(log, "path", log.name) for log in logs]
    stamps = [(str(p), p.stat().st_size, p.stat().st_mtime_ns) if isinstance(p, Path) else p for p in paths]
    key = hashlib.sha256(f"{candidate.method} {own} {stamps}".encode()).hexdigest()[:10]
    return Run(f"{candidate.name}-{key}", candidate.method, own)


def recorded(robot: Robot, folder: Path, folds: int, seconds: float, seed: int, progress: Progress) -> list[LogSource]:
    """Record a log of stop-and-go motion for each fold, unless it is there."""
    folder.mkdir(parents=True, exist_ok=True)
    virtual, paths = VirtualRobot(robot), []
    for number in range(folds):
        path = folder / f"{robot.name}_{seconds:g}_{seed}_{number}.parquet"
        if not path.is_file():
            own = 1000 * seed + number
            part = path.with_name(f"part-{path.name}")
            write_log(virtual.record(named("stop_and_go")(robot, seconds=seconds, seed=own), own), part)
            part.replace(path)
        paths.append(path)
        progress("recording", (number + 1) / folds)
    return open_logs(paths, robot)


if __name__ == "__main__":
    run_alone(screening)
