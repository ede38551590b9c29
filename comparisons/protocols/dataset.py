"""Whole data sets: every protocol of a preset, recorded on a virtual robot and written segment by segment."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from comparisons.progress import Progress
from comparisons.protocols import named
from comparisons.protocols.paper import CONTINUOUS_FRAMES, HYSTERESIS_FRAMES, TEST_FRAMES
from comparisons.virtual_robot.motion import Protocol
from comparisons.virtual_robot.robot import BLOCK, VirtualRobot
from ident.errors import InputError
from ident.log import JointLog
from ident.log_writer import write_log
from ident.readers.source import join

PRESETS: dict[str, dict[str, tuple[str, dict[str, float]]]] = {
    "paper": {
        "continuous": ("continuous", {"frames": CONTINUOUS_FRAMES}),
        "hysteresis": ("stop_and_go", {"frames": HYSTERESIS_FRAMES}),
        "test": ("mixed", {"frames": TEST_FRAMES}),
    },
    "quick": {
        "continuous": ("continuous", {"frames": 30_000}),
        "hysteresis": ("stop_and_go", {"frames": 60_000}),
        "test": ("mixed", {"frames": 20_000}),
    },
    "medium": {
        "continuous": ("continuous", {"frames": 360_000}),
        "hysteresis": ("stop_and_go", {"frames": 720_000}),
        "test": ("mixed", {"frames": 60_000}),
    },
    "identification": {
        "fourier": ("fourier", {"seconds": 120.0}),
        "plateaus": ("plateaus", {"seconds": 600.0}),
        "reversals": ("reversals", {"seconds": 240.0}),
        "static": ("static_poses", {"seconds": 240.0}),
        "ramps": ("torque_ramps", {"seconds": 240.0}),
        "test": ("mixed", {"frames": 20_000}),
    },
    "contact": {"contact": ("contact_episodes", {"seconds": 600.0})},
}
"""Sets of each preset: name of the file, protocol and its arguments."""


@dataclass
class Recording:
    """The recording of one protocol, simulated while it is read: a `LogSource` in bounded memory.

    Attributes:
        virtual: the robot recorded.
        protocol: the motion.
        seed: of sensor noise and of the friction it begins with.
    """

    virtual: VirtualRobot
    protocol: Protocol
    seed: int = 0

    @property
    def name(self) -> str:
        """Name of the protocol."""
        return self.protocol.name

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield consecutive pieces of at most ``rows`` rows, none of them across a segment's end."""
        simulated = self.virtual.simulate(self.protocol.blocks(), self.protocol.rate, self.seed, name=self.name)
        for block in simulated:
            yield from block.blocks(rows)

    def read(self) -> JointLog:
        """Return the whole log in memory."""
        return self.virtual.record(self.protocol, self.seed)


def generate(
    virtual: VirtualRobot, preset: str, out: str | Path, seed: int = 0, progress: Progress | None = None
) -> list[Path]:
    """Record all sets of a preset into ``out`` as ``SET_000.parquet``, ``SET_001.parquet`` ..., a file a segment.

    Args:
        virtual: the robot recorded.
        preset: ``paper`` (3.2 million rows, minutes), ``medium``, ``quick``, ``identification`` or ``contact``.
        out: folder, made if missing.
        seed: draws motions and noise; the same seed gives the same files.
        progress: called with the set's name and the share of it done (see `comparisons.progress`).

    Returns:
        The files, in order.

    Raises:
        InputError: no preset of that name.
    """
    if preset not in PRESETS:
        raise InputError(f"no preset {preset!r}", "generate", f"name one of {', '.join(PRESETS)}")
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for number, (name, (protocol, arguments)) in enumerate(PRESETS[preset].items()):
        motion = named(protocol)(virtual.robot, seed=seed + number, **arguments)
        files += _write(Recording(virtual, motion, seed + number), folder, name, progress or _silent)
    return files


def _write(recording: Recording, out: Path, name: str, progress: Progress) -> list[Path]:
    files, written = [], 0
    blocks = recording.blocks(BLOCK)
    for segment, pieces in itertools.groupby(blocks, key=lambda block: int(block.segment[0])):
        path = out / f"{name}_{segment:03d}.parquet"
        log = join(list(pieces))
        write_log(log, path)
        files.append(path)
        written += len(log)
        progress(name, written / recording.protocol.frames)
    return files


def _silent(stage: str, share: float) -> None:
    """Tell nobody how far the work is."""
