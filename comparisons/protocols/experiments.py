"""Motions among which the gap workflow seeks the one that would tell two names apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from comparisons.protocols import named
from ident.log import JointLog
from ident.robot import Robot

MOTIONS = ("fourier", "plateaus", "reversals", "static_poses", "torque_ramps", "stop_and_go")


@dataclass(frozen=True)
class Experiments(Mapping[str, JointLog]):
    """Commanded motions by name of their protocol, each made when it is asked for.

    Attributes:
        robot: whose limits they keep.
        seconds: about how long each is.
        seed: draws poses and phases.
        rate: sampling rate [Hz].
    """

    robot: Robot
    seconds: float = 100.0
    seed: int = 0
    rate: float = 100.0

    def __getitem__(self, name: str) -> JointLog:
        if name not in MOTIONS:
            raise KeyError(name)
        protocol = named(name)(self.robot, seconds=self.seconds, seed=self.seed, rate=self.rate)
        blocks = list(protocol.blocks())
        q = np.concatenate([block.q for block in blocks])
        segment = np.concatenate([np.full(len(block.q), block.segment) for block in blocks])
        return JointLog(np.arange(len(q)) / self.rate, q, np.zeros_like(q), segment=segment, name=name)

    def __iter__(self) -> Iterator[str]:
        return iter(MOTIONS)

    def __len__(self) -> int:
        return len(MOTIONS)
