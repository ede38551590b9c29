"""How a network is trained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ident.errors import InputError
from learned.motion_discriminator import PLAY_THRESHOLDS, TABLE_I, DiscriminatorSpec, Hold, Signal


@dataclass(frozen=True)
class TrainingOptions:
    """Choices of a training; the defaults are the paper's where it tells.

    Attributes:
        epochs: passes over the training frames at most; the learning rate falls along a cosine over all of them.
        patience: epochs without a better validation loss after which a stage ends.
        batch: frames a step (the LSTM: windows of 100 a step, a fiftieth of these).
        learning_rate: of Adam at the start.
        final_rate: share of it left at the end.
        weight_decay: decoupled from the gradient (AdamW); none in the paper.
        seed: of weights, order of batches and zero starts.
        hierarchies: networks of hrdl, hrdl-md and hybrid, each trained on what those before leave.
        width, depth, memory: neurons of a hidden layer (256, the LSTM 64), hidden layers of a block, frames M.
        thresholds: of the discriminator [rad/s; ``displacement``: rad], Table I's by default.
        signal, hold: of the discriminator, see ``DiscriminatorSpec``.
        rate: sampling rate [Hz] to train at; logs at a whole multiple are thinned. Default: the lowest of the logs.
        cutoff: of the causal low pass on the motion [Hz]; default: chosen from the first log.
        unknown_history_weight: weight in the loss of a joint's frames before its first motion; 0 leaves them out.
        zero_start_every: mean time [s] between moments at which the discriminator is set to zero in training, as if
            the robot had just been switched on; None never does.
        cross_fit: folds; with two or more, each hierarchy learns what networks that had not seen a frame leave of it.
        hold_out: share of each log kept for validation where no validation logs are given and there are few logs.
        on_disk: keep the training frames in files, mapped into memory, for logs larger than memory.
        device: ``cpu`` or ``cuda``; default: CUDA where there is a device.
        checkpoint_seconds: time between checkpoints [s].
    """

    epochs: int = 40
    patience: int = 10
    batch: int = 1024
    learning_rate: float = 1e-3
    final_rate: float = 0.01
    weight_decay: float = 0.0
    seed: int = 0
    hierarchies: int = 3
    width: int | None = None
    depth: int = 3
    memory: int = 5
    thresholds: tuple[float, ...] | tuple[tuple[float, ...], ...] = sum(TABLE_I, ())
    signal: Signal = "velocity"
    hold: Hold = "velocity"
    rate: float | None = None
    cutoff: float | None = None
    unknown_history_weight: float = 0.25
    zero_start_every: float | None = 120.0
    cross_fit: int = 0
    hold_out: float = 0.15
    on_disk: bool = False
    device: str | None = None
    checkpoint_seconds: float = 30.0

    def __post_init__(self) -> None:
        positive = {"epochs", "patience", "batch", "learning_rate", "hierarchies", "depth", "memory"}
        for name in sorted(positive):
            if getattr(self, name) <= 0:
                raise InputError(f"{name} is {getattr(self, name)}", "training options", "give a positive number")
        if not 0.0 < self.hold_out < 1.0:
            raise InputError(f"hold_out is {self.hold_out}", "training options", "give a share between 0 and 1")
        if self.unknown_history_weight < 0.0:
            what = f"unknown_history_weight is {self.unknown_history_weight}"
            raise InputError(what, "training options", "give a weight from 0 up")

    @property
    def discriminator(self) -> DiscriminatorSpec:
        """Motion discriminator these options describe."""
        return DiscriminatorSpec(self.thresholds, self.signal, self.hold)


def suggested(method: str) -> TrainingOptions:
    """Return options to begin with: the paper's, but for a ``hybrid``, which corrects a model that is nearly right.

    What physics leaves hangs together along a motion, so a network that sees all joints learns the motions by heart: a
    hybrid has a small network for each joint, which sees that joint alone and how far the others have gone since it
    stopped. Since it is no method of the paper, it remembers displacements, which do not ring.

    Args:
        method: one of `learned.networks.METHODS`.
    """
    if method != "hybrid":
        return TrainingOptions()
    return TrainingOptions(
        hierarchies=1,
        width=96,
        depth=2,
        weight_decay=0.01,
        signal="displacement-and-travel",
        thresholds=PLAY_THRESHOLDS,
    )


@dataclass(frozen=True)
class Progress:
    """Where a training stands: stage of stages, epoch of epochs, the losses of the last whole epoch.

    Losses are mean squares in units of each joint's deviation, so 1 is no better than the mean.

    Attributes:
        stage, stages: the network being trained, and how many there are.
        epoch, epochs: passes done, and at most.
        loss: of the training frames.
        validation: loss of the frames held out.
    """

    stage: int
    stages: int
    epoch: int
    epochs: int
    loss: float
    validation: float


ProgressCallback = Callable[[Progress], None]
