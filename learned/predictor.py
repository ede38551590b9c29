"""A trained network as a predictor of current, alone or on top of a physical model."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import JointLog, Sample
from ident.predictor import CurrentPredictor
from learned.gaps import OnlineMotion, stretches
from learned.model_file import PHYSICS, TrainedModel
from learned.runtime import DenseRuntime
from learned.runtime_lstm import LstmRuntime
from learned.window import decimation, frames_of

if TYPE_CHECKING:
    from ident.robot import Robot


class LearnedModel:
    """Predicts the motor currents of a robot that touches nothing; a ``CurrentPredictor``.

    The networks were trained on motion from the causal filters that run online, so ``predict`` uses those whether it is
    asked to be causal or not. ``step`` and ``predict`` give the same bits where the physical model does. After a gap in
    time that those filters do not bridge the memory begins anew, and until they have settled the prediction is NaN (see
    `learned.gaps`).

    Args:
        trained: the networks.
        physics: predictor of what the networks were not trained on, hierarchy 0 of a hybrid.
        factor: samples that ``step`` is given for each one at the model's rate; between them the network's part of the
            prediction is held.
    """

    def __init__(self, trained: TrainedModel, physics: CurrentPredictor | None = None, factor: int = 1) -> None:
        self.trained = trained
        self.physics = physics
        self.factor = factor
        lstm = trained.architecture.method == "lstm"
        self._runtime: DenseRuntime | LstmRuntime = LstmRuntime(trained) if lstm else DenseRuntime(trained)
        self._motion = OnlineMotion(trained.rate * factor, trained.cutoff, self.n)
        self.reset()

    @property
    def unit(self) -> str:
        """Unit of the predicted current."""
        return self.trained.unit

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.trained.architecture.n

    @property
    def rate(self) -> float:
        """Sampling rate [Hz] that windows and thresholds belong to."""
        return self.trained.rate

    @property
    def cutoff(self) -> float:
        """Cut-off [Hz] of the causal low pass on the motion."""
        return self.trained.cutoff

    @property
    def method(self) -> str:
        """Name of the method it was trained by."""
        return self.trained.architecture.method

    @property
    def hierarchies(self) -> int:
        """Number of networks whose outputs are added."""
        return len(self.trained.architecture.groups)

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""
        self._runtime.reset()
        self._motion.reset()
        self._count = 0
        self._held = np.full(self.n, np.nan)
        if self.physics is not None:
            self.physics.reset()

    def step(self, sample: Sample) -> FloatArray:
        """Predict the current (n,) at one sample; NaN while the window holds a sample that was NaN, or after a gap."""
        q, dq, ddq = self._motion.step(sample)
        if self._motion.restarted:
            self._runtime.reset()
            self._count = 0
        if self._count % self.factor == 0:
            self._held = self._runtime.step(q, dq, ddq)
        self._count += 1
        return self._held.copy() if self.physics is None else self._held + self.physics.step(sample)

    def predict(self, log: JointLog, causal: bool = False) -> FloatArray:
        """Predict the current (N, n) of a whole log, with the filters that run online whatever ``causal`` says.

        Raises:
            InputError: the log has other joints, or a rate that is no whole multiple of the model's.
        """
        if log.n != self.n:
            what = f"{log.n} joints where the model has {self.n}"
            raise InputError(what, f"log {log.name}", "give logs of the robot that the model was trained for")
        predicted = self._runtime.run(frames_of(log, self.trained.rate, self.trained.cutoff))
        factor = decimation(log, self.trained.rate)
        if factor > 1:
            predicted = _hold(predicted, stretches(log, self.cutoff), factor)
        return predicted if self.physics is None else predicted + self.physics.predict(log, causal=True)

    def at_rate(self, rate: float) -> LearnedModel:
        """Return the model for ``step`` at another ``rate`` [Hz]; InputError unless a whole multiple of its own."""
        factor = max(1, round(rate / self.trained.rate))
        if abs(rate / self.trained.rate / factor - 1.0) > 0.02:
            what = f"samples at {rate:.4g} Hz where the model is for {self.trained.rate:.4g} Hz"
            raise InputError(what, "learned model", "run it at its own rate or a whole multiple")
        return LearnedModel(self.trained, self.physics, factor)

    def truncated(self, hierarchies: int) -> LearnedModel:
        """Return the model with its first hierarchies only, as for the paper's ablation (Table II c)."""
        if not 1 <= hierarchies <= self.hierarchies:
            what = f"{hierarchies} hierarchies asked of a model that has {self.hierarchies}"
            raise InputError(what, "learned model", "ask for fewer")
        whole, shape = self.trained, self.trained.architecture.truncated(hierarchies)
        held = shape.thresholds * shape.n
        scaling = dataclasses.replace(
            whole.held_scaling, mean=whole.held_scaling.mean[:held], gain=whole.held_scaling.gain[:held]
        )
        thresholds = whole.discriminator.thresholds[: shape.thresholds]
        part = dataclasses.replace(
            whole,
            architecture=shape,
            discriminator=dataclasses.replace(whole.discriminator, thresholds=thresholds),
            held_scaling=scaling,
            output_gain=whole.output_gain[:hierarchies],
            weights=whole.weights[: shape.stacked().weights],
        )
        return LearnedModel(part, self.physics, self.factor)

    def require(self, robot: Robot) -> None:
        """Refuse a robot that the model was not trained for.

        Raises:
            InputError: joints or unit of the current differ.
        """
        where = f"model of {self.trained.robot}"
        if tuple(robot.joints) != self.trained.joints:
            what = f"trained for joints {', '.join(self.trained.joints)} where the card has {', '.join(robot.joints)}"
            raise InputError(what, where, "give the card it was trained with, or train again")
        if robot.unit != self.unit:
            raise InputError(f"predicts {self.unit} where the card has {robot.unit}", where, "mend current_unit")

    def save(self, folder: Path) -> None:
        """Write the model, and the physical model below it, into ``folder``."""
        from ident.model import CurrentModel
        from ident.model_file import save_model

        self.trained.save(folder)
        if isinstance(self.physics, CurrentModel):
            (folder / PHYSICS).mkdir(exist_ok=True)
            save_model(self.physics, folder / PHYSICS)
        elif self.physics is not None:
            what = f"a {type(self.physics).__name__} below the network cannot be written"
            raise InputError(what, str(folder), "use an identified CurrentModel as hierarchy 0")

    @staticmethod
    def load(folder: Path, robot: Robot | None = None) -> LearnedModel:
        """Read a model from ``folder`` for a robot, which a hybrid needs for its physics and any other is checked by.

        Raises:
            InputError: there is no model, it is broken, or the robot is not the one it was trained for.
        """
        trained = TrainedModel.load(folder)
        physics = None
        if trained.architecture.method == "hybrid":
            from ident.model_file import load_model

            if robot is None:
                what = "a hybrid stands on a physical model, which needs the robot"
                raise InputError(what, str(folder), "give the robot's card with it")
            physics = load_model(folder / PHYSICS, robot)
        model = LearnedModel(trained, physics)
        if robot is not None:
            model.require(robot)
        return model


def _hold(predicted: FloatArray, parts: list[slice], factor: int) -> FloatArray:
    """Repeat predictions at the model's rate until the next one, row for row with a log of these ``parts``."""
    out = np.empty((parts[-1].stop if parts else 0, predicted.shape[1]))
    first = 0
    for rows in parts:
        length = rows.stop - rows.start
        kept = -(-length // factor)
        out[rows] = np.repeat(predicted[first : first + kept], factor, axis=0)[:length]
        first += kept
    return out
