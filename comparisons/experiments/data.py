"""The paper's data sets, recorded once on the virtual VS060 and kept in files."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from comparisons.progress import Progress
from comparisons.protocols import generate, named
from comparisons.virtual_robot import VirtualRobot
from ident.log import LogSource
from ident.log_writer import write_log
from ident.readers import open_logs
from ident.robot import Robot

EXCITATION = 120.0
"""Seconds of sinusoidal excitation that the paper's model-based method is identified from."""

WHOLE = "data.json"


@dataclass(frozen=True)
class PaperData:
    """Logs of the paper's experiments.

    Attributes:
        robot: the robot they are of.
        train: continuous and hysteresis-rich motion, from which networks learn.
        test: the test set, of both.
        excitation: sinusoids, from which the paper identifies its model.
    """

    robot: Robot
    train: list[LogSource]
    test: list[LogSource]
    excitation: list[LogSource]


def paper_data(virtual: VirtualRobot, preset: str, folder: Path, seed: int, progress: Progress) -> PaperData:
    """Return the logs of a preset, recorded into ``folder`` unless they are there whole.

    Args:
        virtual: the robot recorded.
        preset: ``quick`` or ``paper``, see `comparisons.protocols.dataset.PRESETS`.
        folder: of the files.
        seed: draws motions and noise.
        progress: told which set is being recorded.

    Raises:
        InputError: no such preset.
    """
    made = {"preset": preset, "seed": seed}
    mark = folder / WHOLE
    if not mark.is_file() or json.loads(mark.read_text(encoding="utf-8")) != made:
        shutil.rmtree(folder, ignore_errors=True)
        generate(virtual, preset, folder, seed, progress)
        motion = named("sinusoid")(virtual.robot, seconds=EXCITATION, seed=seed)
        write_log(virtual.record(motion, seed), folder / "excitation.parquet")
        mark.write_text(json.dumps(made) + "\n", encoding="utf-8")
    robot = virtual.robot

    def logs(*names: str) -> list[LogSource]:
        return open_logs([folder / f"{name}*.parquet" for name in names], robot)

    return PaperData(robot, logs("continuous", "hysteresis"), logs("test"), logs("excitation"))
