"""Fitting one network to a data set: mean square loss, Adam, early stopping, and going on after a kill.

The order of batches is a function of seed, stage and epoch, and every state that the next step depends on is in the
checkpoint, so a training that was killed and begun again takes the very steps it would have taken.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch

from learned.batches import LSTM_TARGETS, Batches
from learned.options import TrainingOptions
from learned.torch_graph import DenseGraph, Lstm

Keep = Callable[[dict[str, Any]], None]
Report = Callable[[int, float, float], None]


@dataclass
class _Course:
    """Where a fit stands, and the best weights so far."""

    optimiser: torch.optim.Optimizer
    best: dict[str, torch.Tensor]
    history: list[list[float]]
    best_loss: float
    best_epoch: int = 0
    epoch: int = 0
    batch: int = 0
    loss: float | torch.Tensor = 0.0
    weight: float | torch.Tensor = 0.0

    def snapshot(self, module: DenseGraph | Lstm) -> dict[str, Any]:
        """Everything that the next step depends on."""
        names = ("best_loss", "best_epoch", "epoch", "batch", "loss", "weight")
        self.loss, self.weight = float(self.loss), float(self.weight)
        counts = {name: getattr(self, name) for name in names}
        states = {"module": module.state_dict(), "optimiser": self.optimiser.state_dict(), "best": self.best}
        return {**states, "history": self.history, "counts": counts}

    def end_epoch(self, module: DenseGraph | Lstm, validation: float) -> None:
        """Note the losses of an epoch, and the weights if they are the best."""
        self.history.append([float(self.loss) / max(float(self.weight), 1e-30), validation])
        self.epoch, self.batch, self.loss, self.weight = self.epoch + 1, 0, 0.0, 0.0
        if validation < self.best_loss:
            self.best, self.best_loss, self.best_epoch = _copy(module), validation, self.epoch


@dataclass(frozen=True)
class Fitted:
    """Losses of a fit after each epoch, [training, validation]; the first line is that of the untrained network."""

    history: list[list[float]]
    best_epoch: int


def fit(
    module: DenseGraph | Lstm,
    training: Batches,
    validation: Batches,
    hierarchy: int,
    options: TrainingOptions,
    order_seed: int,
    keep: Keep,
    report: Report,
    resumed: dict[str, Any] | None = None,
) -> Fitted:
    """Fit ``module`` and leave it with the weights of its best epoch on the validation frames.

    Args:
        module: network to train, on the device of the batches.
        training, validation: frames with the residual to learn.
        hierarchy: which group of thresholds the network sees.
        options: see there.
        order_seed: of the order of batches.
        keep: called from time to time with what has to be remembered to go on.
        report: called after each epoch with the epochs done, training and validation loss.
        resumed: what ``keep`` was last given.
    """
    course = _begin(module, training, validation, hierarchy, options, resumed)
    kept_at = time.monotonic()
    size = max(1, options.batch // training.kept)
    while course.epoch < options.epochs and course.epoch - course.best_epoch < options.patience:
        order = training.order(order_seed, course.epoch)
        batches = -(-len(order) // size)
        while course.batch < batches:
            rate = rate_at(options, course.epoch + course.batch / batches)
            rows = order[course.batch * size : (course.batch + 1) * size]
            loss, weight = descend(module, training, hierarchy, course.optimiser, rate, rows)
            course.loss, course.weight, course.batch = course.loss + loss, course.weight + weight, course.batch + 1
            if time.monotonic() - kept_at >= options.checkpoint_seconds:
                keep(course.snapshot(module))
                kept_at = time.monotonic()
        course.end_epoch(module, evaluate(module, validation, hierarchy, options))
        report(course.epoch, *course.history[-1])
    module.load_state_dict(course.best)
    return Fitted(course.history, course.best_epoch)


def _begin(
    module: DenseGraph | Lstm,
    training: Batches,
    validation: Batches,
    hierarchy: int,
    options: TrainingOptions,
    resumed: dict[str, Any] | None,
) -> _Course:
    """Start a fit with the losses of the network as drawn, or go on with one."""
    optimiser = torch.optim.AdamW(
        module.parameters(), lr=options.learning_rate, weight_decay=options.weight_decay, fused=True
    )
    if resumed is not None:
        module.load_state_dict(resumed["module"])
        optimiser.load_state_dict(resumed["optimiser"])
        return _Course(optimiser, resumed["best"], history=resumed["history"], **resumed["counts"])
    before = [evaluate(module, batches, hierarchy, options) for batches in (training, validation)]
    return _Course(optimiser, _copy(module), [before], best_loss=before[1])


@torch.no_grad()  # type: ignore[untyped-decorator]
def evaluate(module: DenseGraph | Lstm, batches: Batches, hierarchy: int, options: TrainingOptions) -> float:
    """Weighted mean square error of a network over all rows of the batches."""
    size = max(1, 16 * options.batch // batches.kept)
    rows = batches.rows[LSTM_TARGETS - 1 :: LSTM_TARGETS] if batches.kept > 1 else batches.rows
    total = torch.zeros(2, dtype=torch.float64, device=batches.device)
    for start in range(0, len(rows), size):
        total += torch.stack(batches.loss(module, rows[start : start + size], hierarchy)).double()
    loss, weight = total.tolist()
    return float(loss / max(weight, 1e-30))


def descend(
    module: DenseGraph | Lstm,
    training: Batches,
    hierarchy: int,
    optimiser: torch.optim.Optimizer,
    rate: float,
    rows: Any,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Take one step of Adam; return the batch's weighted sum of squares and sum of weights."""
    for group in optimiser.param_groups:
        group["lr"] = rate
    loss, weight = training.loss(module, rows, hierarchy)
    optimiser.zero_grad(set_to_none=True)
    (loss / weight.clamp_min(1e-9)).backward()
    optimiser.step()
    # Left where they are: reading them would make a GPU wait at every step.
    return loss.detach().double(), weight.double()


def rate_at(options: TrainingOptions, epochs: float) -> float:
    """Learning rate after so many epochs, along half a cosine."""
    share = 0.5 * (1.0 + math.cos(math.pi * epochs / options.epochs))
    return options.learning_rate * (options.final_rate + (1.0 - options.final_rate) * share)


def _copy(module: DenseGraph | Lstm) -> dict[str, torch.Tensor]:
    """Copy of a network's weights."""
    return {name: value.clone() for name, value in module.state_dict().items()}
