"""Contact episodes: pushes at random links while the robot stands and moves, with the true torque and wrench."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from comparisons.protocols.paper import PAUSE, RUN, stop_and_go
from comparisons.virtual_robot.contact import Push
from comparisons.virtual_robot.kinematics import Kinematics
from comparisons.virtual_robot.motion import Protocol, ReferenceBlock
from ident.robot import Robot

EPISODES_A_MINUTE = 5.0
SHORTEST, LONGEST = 0.5, 10.0  # [s]
WEAKEST, STRONGEST = 5.0, 40.0  # [N]


def contact_episodes(
    robot: Robot, seconds: float = 300.0, seed: int = 0, rate: float = 100.0, tool_share: float = 0.4
) -> Protocol:
    """Stop-and-go motion with pushes of 0.5 to 10 s and 5 to 40 N at random links, none overlapping another.

    Args:
        robot: whose limits to keep.
        seconds: length.
        seed: draws motion and pushes.
        rate: sampling rate [Hz].
        tool_share: share of the pushes that act at the tool, where the log's wrench shows them.
    """
    motion = stop_and_go(robot, seconds, seed, rate)
    pushes = tuple(_pushes(robot, seconds, np.random.default_rng([seed, 3]), tool_share))

    def blocks() -> Iterator[ReferenceBlock]:
        start: dict[int, int] = {}
        row = 0
        for block in motion.blocks():
            since = start.setdefault(block.segment, row) / rate
            yield ReferenceBlock(block.q, block.segment, tuple(_later(push, -since) for push in pushes))
            row += len(block.q)

    return Protocol("contact_episodes", rate, motion.frames, blocks)


def _later(push: Push, seconds: float) -> Push:
    return Push(push.link, push.point, push.force, push.start + seconds, push.duration, push.rise)


def _pushes(robot: Robot, seconds: float, rng: np.random.Generator, tool_share: float) -> Iterator[Push]:
    """Yield pushes in order of time; their spacing varies so that they meet rest and motion alike."""
    kinematics = Kinematics(robot.multibody)
    arm = np.linalg.norm(robot.multibody.tree.translation, axis=1).mean()
    clock = 2.0
    while True:
        duration = float(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
        clock += rng.exponential(60.0 / EPISODES_A_MINUTE - 0.5 * (RUN + PAUSE)) * 0.5 + 1.0
        if clock + duration > seconds:
            return
        at_tool = rng.uniform() < tool_share
        link = kinematics.last if at_tool else int(rng.integers(robot.n))
        point = kinematics.tool if at_tool else rng.uniform(-0.5, 0.5, 3) * arm
        direction = rng.standard_normal(3)
        force = direction / np.linalg.norm(direction) * rng.uniform(WEAKEST, STRONGEST)
        # of the time [s] a hand needs to press
        rise = float(rng.uniform(0.1, 0.4))
        x, y, z = (float(v) for v in point)
        fx, fy, fz = (float(v) for v in force)
        yield Push(link + 1, (x, y, z), (fx, fy, fz), clock, duration, rise)
        clock += duration
