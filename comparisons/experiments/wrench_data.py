"""Logs that teach the wrench at the tool: slow stop-and-go motion near one pose, pushed at the tool again and again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from comparisons.protocols.excitation import limits
from comparisons.protocols.paper import SEGMENT_FRAMES, stop_and_go
from comparisons.virtual_robot.contact import Push
from comparisons.virtual_robot.kinematics import Kinematics
from comparisons.virtual_robot.motion import Protocol, ReferenceBlock
from ident.arrays import FloatArray
from ident.robot import Robot

SHARE = 0.4
"""Of the joint ranges, about the pose, that the motion uses."""

SHORTEST, LONGEST = 1.0, 4.0  # [s] of a push
BREAK = 1.5  # [s] between two, at most
STRONGEST = 45.0  # [N]


def near_pose(robot: Robot, pose: FloatArray, seconds: float, seed: int, rate: float = 100.0) -> Protocol:
    """Return stop-and-go motion about a pose (n,) with pushes at the tool in all directions.

    Args:
        robot: whose limits to keep.
        pose: the middle of the motion.
        seconds: length.
        seed: draws motion and pushes.
        rate: sampling rate [Hz].
    """
    motion = stop_and_go(robot, seconds, seed, rate)
    middle = limits(robot)[0]

    def blocks() -> Iterator[ReferenceBlock]:
        pushes: dict[int, tuple[Push, ...]] = {}
        for block in motion.blocks():
            rng = np.random.default_rng([seed, block.segment, 4])
            own = pushes.setdefault(block.segment, tuple(_pushes(robot, SEGMENT_FRAMES / rate, rng)))
            yield ReferenceBlock(pose + SHARE * (block.q - middle), block.segment, own)

    return Protocol("near_pose", rate, motion.frames, blocks)


def _pushes(robot: Robot, seconds: float, rng: np.random.Generator) -> Iterator[Push]:
    kinematics = Kinematics(robot.multibody)
    x, y, z = (float(v) for v in kinematics.tool)
    clock = 1.0
    while True:
        duration = float(rng.uniform(SHORTEST, LONGEST))
        if clock + duration > seconds:
            return
        direction = rng.standard_normal(3)
        force = direction / np.linalg.norm(direction) * rng.uniform(0.0, STRONGEST)
        fx, fy, fz = (float(v) for v in force)
        yield Push(kinematics.last + 1, (x, y, z), (fx, fy, fz), clock, duration, rise=float(rng.uniform(0.1, 0.8)))
        clock += duration + float(rng.uniform(0.2, BREAK))
