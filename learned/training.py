"""Training a model of the motor current from logs of a robot that touches nothing."""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.cutoff import choose_cutoff
from ident.errors import InputError
from ident.log import JointLog, LogSource
from ident.predictor import CurrentPredictor
from learned.dataset import FrameSpec, build
from learned.model_file import TrainedModel
from learned.motion_discriminator import DiscriminatorSpec, known_history
from learned.networks import DISCRIMINATED, Architecture, architecture
from learned.options import ProgressCallback, TrainingOptions, suggested
from learned.predictor import LearnedModel
from learned.stages import CHECKPOINT, Stages
from learned.window import Scaling, multiple

if TYPE_CHECKING:
    from ident.robot import Robot

EVERY = 8
"""One log in so many is held out for validation."""


def train(
    robot: Robot,
    train_logs: Sequence[LogSource],
    validation_logs: Sequence[LogSource] | None = None,
    method: str = "hrdl-md",
    options: TrainingOptions | None = None,
    out: Path | None = None,
    progress: ProgressCallback | None = None,
    physics: CurrentPredictor | None = None,
) -> LearnedModel:
    """Train a model and return it with its best weights.

    Training that was killed goes on where it last wrote a checkpoint when it is called again with the same arguments,
    and ends with the same model as if nothing had happened.

    Args:
        robot: the robot.
        train_logs: logs to learn from.
        validation_logs: logs to stop early by; by default every eighth training log is kept for that, or the end of
            each log where there are fewer than eight.
        method: one of ``METHODS``.
        options: how to train; by default as ``suggested``, which is the paper's way for its own methods.
        out: folder for the model, and for the checkpoint until it is done; None keeps nothing.
        progress: called after each epoch.
        physics: the identified model that a ``hybrid`` stands on.

    Raises:
        InputError: the logs do not fit the robot or each other, the method is unknown, or a hybrid has no physics.
    """
    options = options or suggested(method)
    if (method == "hybrid") != (physics is not None):
        what = "a hybrid needs a physical model" if physics is None else f"method {method} takes no physical model"
        raise InputError(what, "training", "identify one and train a hybrid with it")
    if not train_logs:
        raise InputError("no training logs", "training", "give at least one")
    train_logs, validation_logs = _held_out(train_logs, validation_logs, options)
    shape, frames = _plan(robot, train_logs, method, options)
    stages, scalings = _learn(train_logs, validation_logs, shape, frames, options, out, progress, physics)
    trained = TrainedModel(
        robot=robot.name,
        joints=tuple(robot.joints),
        unit=robot.unit,
        rate=frames.rate,
        cutoff=frames.cutoff,
        architecture=shape,
        discriminator=frames.discriminator,
        frame_scaling=scalings[0],
        held_scaling=scalings[1],
        output_gain=np.array(stages.gains),
        output_offset=stages.offset,
        weights=np.concatenate(stages.weights),
        training=stages.summary(),
    )
    model = LearnedModel(trained, physics)
    trained.training["validation"] = validation_figures(model, validation_logs)
    if out is not None:
        model.save(out)
        (out / CHECKPOINT).unlink(missing_ok=True)
    return model


def _learn(
    train_logs: Sequence[LogSource],
    validation_logs: Sequence[LogSource],
    shape: Architecture,
    frames: FrameSpec,
    options: TrainingOptions,
    out: Path | None,
    progress: ProgressCallback | None,
    physics: CurrentPredictor | None,
) -> tuple[Stages, tuple[Scaling, Scaling]]:
    """Make the data sets and run the stages; data sets on disk are gone afterwards."""
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out) if options.on_disk else contextlib.nullcontext() as folder:
        scratch = None if folder is None else Path(folder)
        data, scalings = build(train_logs, frames, physics, folder=scratch and scratch / "train")
        whole = dataclasses.replace(frames, zero_start_every=None)
        held_out, _ = build(validation_logs, whole, physics, scalings, scratch and scratch / "validation")
        stages = Stages(data, held_out, shape, options, out, progress)
        stages.run()
    return stages, scalings


def _plan(
    robot: Robot, logs: Sequence[LogSource], method: str, options: TrainingOptions
) -> tuple[Architecture, FrameSpec]:
    """Size the network, and settle how frames are made."""
    spec = options.discriminator if method in DISCRIMINATED else DiscriminatorSpec(())
    held = spec.rows(robot.n)
    shape = architecture(method, robot.n, held, options.hierarchies, options.width, options.memory, options.depth)
    rate = options.rate or _common_rate(logs)
    frames = FrameSpec(
        n=robot.n,
        rate=rate,
        cutoff=options.cutoff or min(choose_cutoff(logs[0].read()).hertz, 0.4 * rate),
        memory=shape.memory,
        discriminator=spec,
        unknown_history_weight=options.unknown_history_weight,
        zero_start_every=options.zero_start_every,
        seed=options.seed,
    )
    return shape, frames


def validation_figures(model: LearnedModel, logs: Sequence[LogSource]) -> dict[str, list[float | None]]:
    """RMSE of each joint on logs in the current's unit: of all rows, and of those before and after its first motion.

    Args:
        model: that was trained.
        logs: that it was not trained on.
    """
    squares, counts = np.zeros((2, model.n)), np.zeros((2, model.n))
    for source in logs:
        log = source.read()
        error = log.current - model.predict(log, causal=True)
        known = known_history(log.q, log.segments())
        for k, mask in enumerate((known, ~known)):
            use = mask & np.isfinite(error)
            squares[k] += np.sum(np.where(use, error, 0.0) ** 2, axis=0)
            counts[k] += use.sum(axis=0)

    def root(total: FloatArray, count: FloatArray) -> list[float | None]:
        return [float(np.sqrt(t / c)) if c > 0 else None for t, c in zip(total, count, strict=True)]

    whole = root(squares.sum(axis=0), counts.sum(axis=0))
    return {"rmse": whole, "rmse_known": root(squares[0], counts[0]), "rmse_unknown": root(squares[1], counts[1])}


@dataclass(frozen=True)
class _Part:
    """Rows of a log from one share of its length to another; a ``LogSource`` that reads the log when it is read."""

    source: LogSource
    start: float
    stop: float

    @property
    def name(self) -> str:
        """Name of the whole log."""
        return self.source.name

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield consecutive pieces of at most ``rows`` rows."""
        return self.read().blocks(rows)

    def read(self) -> JointLog:
        """Return the rows in memory."""
        log = self.source.read()
        return log[round(self.start * len(log)) : round(self.stop * len(log))]


def _held_out(
    logs: Sequence[LogSource], validation: Sequence[LogSource] | None, options: TrainingOptions
) -> tuple[Sequence[LogSource], Sequence[LogSource]]:
    """Training and validation logs; without any of the latter every eighth log, or of fewer logs the end of each."""
    if validation:
        return logs, validation
    if len(logs) >= EVERY:
        return [log for k, log in enumerate(logs) if (k + 1) % EVERY], logs[EVERY - 1 :: EVERY]
    cut = 1.0 - options.hold_out
    return [_Part(log, 0.0, cut) for log in logs], [_Part(log, cut, 1.0) for log in logs]


def _common_rate(logs: Sequence[LogSource]) -> float:
    """Lowest rate of the logs, of which that of each is a whole multiple; one log at a time is in memory."""
    rates = {}
    for source in logs:
        log = source.read()
        rates[source.name] = log.rate
    rate = min(rates.values())
    nominal = float(round(rate)) if abs(rate / max(round(rate), 1) - 1.0) < 0.005 else rate
    for name, value in rates.items():
        multiple(value, nominal, name)
    return nominal
