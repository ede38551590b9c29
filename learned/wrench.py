"""The wrench at the tool from motor currents, by a network (the paper's Section V B).

Two schemes with the same number of parameters: ``compound`` reads what a current predictor leaves of the measured
current, ``single`` the measured current itself; both read position and velocity with it, M frames of each.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import JointLog, LogSource, Sample
from ident.signals import Motion
from learned.dataset import Dataset
from learned.gaps import OnlineMotion
from learned.model_file import TrainedModel
from learned.motion_discriminator import DiscriminatorSpec
from learned.networks import Architecture
from learned.options import ProgressCallback, TrainingOptions
from learned.predictor import LearnedModel
from learned.runtime import DenseRuntime
from learned.window import Frames, Moments, Scaling, complete, frames_of, pad

if TYPE_CHECKING:
    from ident.robot import Robot

Scheme = Literal["compound", "single"]
WIDTH = 128
"""Neurons of each of the three hidden layers, unless told otherwise."""
CURRENT = "current"
"""Folder, inside that of the wrench model, of the current predictor it reads the residual of."""


class WrenchModel:
    """Estimates the wrench at the tool; fx fy fz [N], mx my mz [N m], in the frame of the logs it was trained on.

    Args:
        trained: the network.
        predictor: what is subtracted from the measured current (``compound``); None reads the current (``single``).
    """

    def __init__(self, trained: TrainedModel, predictor: LearnedModel | None) -> None:
        self.trained = trained
        self.predictor = predictor
        self._runtime = DenseRuntime(trained)
        self._motion = OnlineMotion(trained.rate, trained.cutoff, len(trained.joints))

    @property
    def scheme(self) -> Scheme:
        """Which of the two schemes it is."""
        return "single" if self.predictor is None else "compound"

    @property
    def parameters(self) -> int:
        """Number of weights that turn signals into the wrench, those of the current predictor not counted."""
        return len(self.trained.weights)

    def reset(self) -> None:
        """Forget all memory, as at the start of a segment."""
        self._runtime.reset()
        self._motion.reset()
        if self.predictor is not None:
            self.predictor.reset()

    def step(self, sample: Sample) -> FloatArray:
        """Estimate the wrench (6,) at one sample at the model's rate."""
        q, dq, _ = self._motion.step(sample)
        if self._motion.restarted:
            self._runtime.reset()
        signal = sample.current if self.predictor is None else sample.current - self.predictor.step(sample)
        return self._runtime.step(signal, q, dq)

    def predict(self, log: JointLog) -> FloatArray:
        """Estimate the wrench (N, 6) of a whole log at the model's rate; what ``step`` gives sample by sample."""
        if log.n != len(self.trained.joints) or round(log.rate / self.trained.rate) != 1:
            own = f"{len(self.trained.joints)} at {self.trained.rate:.4g} Hz"
            what = f"{log.n} joints at {log.rate:.4g} Hz where the model has {own}"
            raise InputError(what, f"log {log.name}", "give a log of the same robot at the same rate")
        return self._runtime.run(_frames(log, self.trained.rate, self.trained.cutoff, self.predictor))

    def save(self, folder: Path) -> None:
        """Write the model, and the current predictor below it, into ``folder``."""
        self.trained.save(folder)
        if self.predictor is not None:
            self.predictor.save(folder / CURRENT)

    @staticmethod
    def load(folder: Path, robot: Robot | None = None) -> WrenchModel:
        """Read a model from ``folder``; InputError where there is none, it is broken, or it does not fit the robot."""
        below = folder / CURRENT
        return WrenchModel(TrainedModel.load(folder), LearnedModel.load(below, robot) if below.is_dir() else None)


def train_wrench(
    robot: Robot,
    train_logs: Sequence[LogSource],
    validation_logs: Sequence[LogSource],
    predictor: LearnedModel | None,
    options: TrainingOptions | None = None,
    progress: ProgressCallback | None = None,
) -> WrenchModel:
    """Train a network that turns signals into the wrench measured at the tool.

    Args:
        robot: the robot.
        train_logs, validation_logs: logs with ``wrench``.
        predictor: the current predictor of the compound scheme; None trains the single scheme.
        options: how to train; of the sizes ``width``, ``depth`` and ``memory`` count.
        progress: called after each epoch.

    Raises:
        InputError: a log holds no wrench, or does not fit the predictor.
    """
    from learned.stages import Stages

    options = options or TrainingOptions()
    first = train_logs[0].read()
    rate = options.rate or (predictor.trained.rate if predictor is not None else float(round(first.rate)))
    cutoff = options.cutoff or (predictor.trained.cutoff if predictor is not None else 0.2 * rate)
    shape = Architecture(
        "mlp", 6, options.memory, ((0, 0),), options.width or WIDTH, options.depth, channels=3 * robot.n
    )
    data, scaling = _dataset(train_logs, rate, cutoff, predictor, shape.memory, None)
    held_out, _ = _dataset(validation_logs, rate, cutoff, predictor, shape.memory, scaling)
    stages = Stages(data, held_out, shape, options, None, progress)
    stages.run()
    trained = TrainedModel(
        robot=robot.name,
        joints=tuple(robot.joints),
        unit="N, N m",
        rate=rate,
        cutoff=cutoff,
        architecture=shape,
        discriminator=DiscriminatorSpec(()),
        frame_scaling=scaling,
        held_scaling=Scaling(np.zeros(0), np.zeros(0)),
        output_gain=np.array(stages.gains),
        output_offset=stages.offset,
        weights=np.concatenate(stages.weights),
        training=stages.summary(),
    )
    return WrenchModel(trained, predictor)


def _frames(log: JointLog, rate: float, cutoff: float, predictor: LearnedModel | None) -> Frames:
    """Frames of signal, q and dq, in the places of q, dq and ddq."""
    frames = frames_of(log, rate, cutoff)
    signal = log.current if predictor is None else log.current - predictor.predict(log, causal=True)
    signal = signal[frames.rows]
    motion = Motion(frames.motion.t, signal, frames.motion.q, frames.motion.dq)
    known = [np.isfinite(values).all(axis=1) for values in (motion.q, motion.dq, motion.ddq)]
    return dataclasses.replace(frames, motion=motion, finite=np.logical_and.reduce(known))


def _dataset(
    logs: Sequence[LogSource],
    rate: float,
    cutoff: float,
    predictor: LearnedModel | None,
    memory: int,
    scaling: Scaling | None,
) -> tuple[Dataset, Scaling]:
    """Signals, motion and measured wrench of logs, ready for training; and how they are scaled."""
    parts: list[tuple[FloatArray, FloatArray]] = []
    rows, first = [], 0
    for source in logs:
        log = source.read()
        if log.wrench is None:
            raise InputError("no wrench", f"log {log.name}", "give logs with the columns fx fy fz mx my mz")
        frames = _frames(log, rate, cutoff, predictor)
        target = log.wrench[frames.rows]
        usable = complete(frames.finite, frames.segments, memory) & np.isfinite(target).all(axis=1)
        channels, place = pad(frames.channels, frames.segments, frames.finite, memory)
        wrench = np.zeros((len(channels), 6))
        wrench[place] = np.nan_to_num(target)
        parts.append((np.nan_to_num(channels), wrench))
        rows.append(place[usable] + first)
        first += len(channels)
    channels, wrench = (np.concatenate(part) for part in zip(*parts, strict=True))
    used = np.concatenate(rows)
    if scaling is None:
        moments = Moments(channels.shape[1])
        moments.add(channels[used])
        scaling = moments.scaling()
    weight = np.zeros(wrench.shape, dtype=np.float32)
    weight[used] = 1.0
    held = np.zeros((len(channels), 0), dtype=np.float32)
    return Dataset(scaling.apply(channels), held, wrench.astype(np.float32), weight, used), scaling
