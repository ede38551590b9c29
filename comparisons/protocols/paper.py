"""The paper's data: continuous task-space motion, hysteresis-rich motion, and the test set that mixes both.

Shan and Pham, "Sensorless Estimation of Contact Using Deep-Learning for Human-Robot Interaction", sections IV and V.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from comparisons.protocols.excitation import limits
from comparisons.protocols.smoothing import Rounding
from comparisons.protocols.task_space import via_point_motion
from comparisons.virtual_robot.motion import Protocol, ReferenceBlock
from ident.arrays import FloatArray, IntArray
from ident.robot import Robot

CONTINUOUS_FRAMES = 1_235_247
HYSTERESIS_FRAMES = 1_865_016
TEST_FRAMES = 94_490
CONTINUOUS_SHARE = 0.4  # of the test set
SEGMENT_FRAMES = 60_000  # frames between two starts from rest
RUN = 3.0  # [s] of execution before each pause
PAUSE = 3.0  # [s]
SLOWEST, FASTEST = 0.05, 0.35  # of the speed limit
RAMP = 0.2  # [s] in which a joint takes up or loses its speed


def continuous(
    robot: Robot, seconds: float = 600.0, seed: int = 0, rate: float = 100.0, frames: int | None = None
) -> Protocol:
    """Motion through random via points in task space that never stops: free of hysteresis.

    Args:
        robot: whose limits to keep.
        seconds: length.
        seed: draws the via points.
        rate: sampling rate [Hz].
        frames: exact length in rows, instead of ``seconds`` (the paper's: `CONTINUOUS_FRAMES` at 100 Hz).
    """
    total = round(seconds * rate) if frames is None else frames

    def blocks() -> Iterator[ReferenceBlock]:
        for segment, rows in enumerate(_segments(total)):
            motion = via_point_motion(robot, rate, np.random.default_rng([seed, segment, 1]))
            yield from _taken(motion, rows, segment)

    return Protocol("continuous", rate, total, blocks)


def stop_and_go(
    robot: Robot, seconds: float = 600.0, seed: int = 0, rate: float = 100.0, frames: int | None = None
) -> Protocol:
    """Hysteresis-rich motion: random joint targets at random constant speeds, a pause of 3 s after every 3 s.

    Joints that have met their goal stand still until all have. Arguments as for `continuous` (the paper's length:
    `HYSTERESIS_FRAMES` at 100 Hz).

    Args:
        robot: whose limits are kept.
        seconds: length, unless ``frames`` is given.
        seed: draws targets and speeds.
        rate: samples a second [Hz].
        frames: rows, instead of ``seconds``.
    """
    total = round(seconds * rate) if frames is None else frames

    def blocks() -> Iterator[ReferenceBlock]:
        for segment, rows in enumerate(_segments(total)):
            motion = _goal_motion(robot, rate, np.random.default_rng([seed, segment, 2]))
            yield from _taken(motion, rows, segment)

    return Protocol("stop_and_go", rate, total, blocks)


def mixed(
    robot: Robot, seconds: float = 944.9, seed: int = 0, rate: float = 100.0, frames: int | None = None
) -> Protocol:
    """The paper's test set: 40 % continuous, then 60 % hysteresis-rich motion; 94,490 rows unless told.

    Arguments as for `continuous`.

    Args:
        robot: whose limits are kept.
        seconds: length, unless ``frames`` is given.
        seed: draws the motion.
        rate: samples a second [Hz].
        frames: rows, instead of ``seconds``.
    """
    total = round(seconds * rate) if frames is None else frames
    first = round(CONTINUOUS_SHARE * total)
    parts = [
        continuous(robot, seed=seed, rate=rate, frames=first),
        stop_and_go(robot, seed=seed, rate=rate, frames=total - first),
    ]

    def blocks() -> Iterator[ReferenceBlock]:
        before = 0
        for part in parts:
            segment = -1
            for block in part.blocks():
                segment = block.segment
                yield ReferenceBlock(block.q, before + segment, block.pushes)
            before += segment + 1

    return Protocol("mixed", rate, total, blocks)


def _segments(frames: int) -> list[int]:
    """Return the lengths of the segments that make up ``frames``."""
    whole, rest = divmod(frames, SEGMENT_FRAMES)
    return [SEGMENT_FRAMES] * whole + [rest] * (rest > 0)


def _taken(motion: Iterator[FloatArray], rows: int, segment: int) -> Iterator[ReferenceBlock]:
    """Yield exactly ``rows`` rows of an endless motion."""
    for q in motion:
        yield ReferenceBlock(q[:rows], segment)
        rows -= len(q)
        if rows <= 0:
            return


def _goal_motion(robot: Robot, rate: float, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Yield hysteresis-rich motion without end, one set of goals at a time."""
    middle, half, velocity, _ = limits(robot)
    here = middle + half * rng.uniform(-1.0, 1.0, robot.n)
    rounding = Rounding(RAMP, rate, here)
    yield np.tile(here, (round(rate), 1))
    run, period = round(RUN * rate), round((RUN + PAUSE) * rate)
    executed = itertools.count()
    while True:
        goal = middle + half * rng.uniform(-1.0, 1.0, robot.n)
        speed = velocity * rng.uniform(SLOWEST, FASTEST, robot.n)
        steps = np.arange(1, int(np.ceil(np.max(np.abs(goal - here) / speed) * rate)) + 1)
        share = np.minimum(steps[:, None] / rate * speed / np.maximum(np.abs(goal - here), 1e-9), 1.0)
        path = here + share * (goal - here)
        ticks: IntArray = np.fromiter(itertools.islice(executed, len(steps)), dtype=np.int64)
        # a pause repeats the row after which it falls
        repeats = np.where(ticks % run == run - 1, period - run + 1, 1)
        yield rounding.smooth(np.repeat(path, repeats, axis=0))
        here = goal
