"""Logs and models of the experiments of compliance, each made once and kept in files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from comparisons.comparison.methods import FAMILIES
from comparisons.comparison.workshop import Workshop
from comparisons.experiments.compliant import POSE
from comparisons.experiments.wrench_data import near_pose
from comparisons.progress import Progress
from comparisons.protocols import named
from comparisons.virtual_robot import VirtualRobot
from ident.log import LogSource
from ident.log_writer import write_log
from ident.readers import open_logs
from learned.motion_discriminator import PLAY_THRESHOLDS, Signal
from learned.options import TrainingOptions
from learned.predictor import LearnedModel
from observers.momentum import MomentumObserver
from observers.residual import ResidualEstimator

NETWORK, PLAIN, SLIP = "HRDL-MD", "GMO", "GMO, Maxwell slip"
OBSERVER = 10.0
"""Bandwidth of the momentum observers [Hz]: the common low pass of 5 Hz, not theirs, is what is seen."""

EXCITATION = 480.0
"""Seconds of stop-and-go motion that the observers' models are identified from, and a quarter as much excitation."""

NEAR = "near_pose"
"""Motion and pushes that teach the wrench, see `wrench_data`."""


@dataclass(frozen=True)
class Sizes:
    """How much is recorded and how long networks learn.

    Attributes:
        seconds: of stop-and-go motion that HRDL-MD learns from.
        epochs, width: of HRDL-MD.
        wrench_seconds, wrench_epochs, wrench_width: of the two networks that tell the wrench.
        seed: of motion, noise and weights.
        signal: that tells HRDL-MD of motion past.
        device: that networks learn on.
    """

    seconds: float
    epochs: int
    width: int
    wrench_seconds: float
    wrench_epochs: int
    wrench_width: int
    seed: int
    signal: Signal
    device: str | None


@dataclass(frozen=True)
class Work:
    """Where logs and models are, and what makes them."""

    virtual: VirtualRobot
    out: Path
    sizes: Sizes
    progress: Progress

    def log(self, protocol: str, seconds: float, seed: int) -> LogSource:
        """Record a log, unless it is there."""
        seed += 100 * self.sizes.seed
        path = self.out / "logs" / f"{protocol}_{seconds:g}_{seed}.parquet"
        if not path.is_file():
            self.progress(f"recording {protocol}", 0.0)
            path.parent.mkdir(exist_ok=True)
            robot = self.virtual.robot
            if protocol == NEAR:
                motion = near_pose(robot, np.array(POSE), seconds, seed)
            else:
                motion = named(protocol)(robot, seconds=seconds, seed=seed)
            part = path.with_name(f"part-{path.name}")
            write_log(self.virtual.record(motion, seed), part)
            part.replace(path)
            self.progress(f"recording {protocol}", 1.0)
        return open_logs([path], self.virtual.robot)[0]

    def workshop(self, logs: Sequence[LogSource]) -> Workshop:
        """Return what fits models to logs."""
        return Workshop(self.out / "models", self.virtual.robot, logs, self.progress)

    def network(self) -> LearnedModel:
        """Return HRDL-MD, trained unless that is done."""
        half = self.sizes.seconds / 2.0
        logs = [self.log("stop_and_go", half, 1), self.log("stop_and_go", half, 2), self.log("continuous", half / 6, 3)]
        own = {"thresholds": PLAY_THRESHOLDS} if self.sizes.signal == "displacement" else {}
        options = TrainingOptions(
            epochs=self.sizes.epochs, width=self.sizes.width, batch=512, learning_rate=2e-3, seed=self.sizes.seed,
            signal=self.sizes.signal, device=self.sizes.device, **own,  # type: ignore[arg-type]
        )  # fmt: skip
        return self.workshop(logs).network("hrdl-md", "hrdl-md", options, None)[0]

    def observers(self) -> dict[str, ResidualEstimator]:
        """Return momentum observers on a model without memory, as the paper's, and on one with Maxwell slip."""
        logs = [self.log("fourier", EXCITATION / 4, 4), self.log("stop_and_go", EXCITATION, 5)]
        workshop = self.workshop(logs)
        families = {PLAIN: "sigmoid", SLIP: "maxwell-slip"}
        return {
            name: MomentumObserver(workshop.physics(family, FAMILIES[family], None)[0], OBSERVER)
            for name, family in families.items()
        }
