"""Motion that settles one question at a time: plateaus, small reversals, still poses, torque ramps, a known payload."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comparisons.protocols.excitation import limits
from comparisons.protocols.smoothing import travel
from comparisons.virtual_robot.motion import Protocol, in_blocks
from comparisons.virtual_robot.robot import VirtualRobot
from ident.arrays import FloatArray
from ident.log import JointLog
from ident.robot import Robot

PLATEAU_SPEEDS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.3, 0.8)  # [rad/s]
REVERSALS = (0.0003, 0.001, 0.003, 0.01)  # [rad]
MOVE = 0.3  # of the speed limits, on the way from one place to the next
HOLD = 1.5  # [s] at rest between two motions


class _Path:
    """Corners of a motion and when they are reached."""

    def __init__(self, start: FloatArray) -> None:
        self.corners, self.times = [start, start], [0.0, 1.0]

    def to(self, q: FloatArray, seconds: float) -> None:
        """Run straight to ``q`` (n,) in ``seconds``."""
        self.corners.append(q)
        self.times.append(self.times[-1] + max(seconds, 0.02))

    def move(self, q: FloatArray, velocity: FloatArray) -> None:
        """Go to ``q`` at no more than a share `MOVE` of the speed limits, and rest."""
        self.to(q, float(np.max(np.abs(q - self.corners[-1]) / (MOVE * velocity))))
        self.rest(HOLD)

    def rest(self, seconds: float) -> None:
        """Stand still."""
        self.to(self.corners[-1], seconds)

    def protocol(self, name: str, rate: float) -> Protocol:
        """Return the motion as a protocol of one segment."""
        q = travel(np.array(self.corners), np.array(self.times), rate)
        return Protocol(name, rate, len(q), lambda: in_blocks(q))


def _shifted(q: FloatArray, joint: int, by: float) -> FloatArray:
    """Return ``q`` (n,) with one joint moved."""
    moved = q.copy()
    moved[joint] += by
    return moved


def _pose(robot: Robot, rng: np.random.Generator) -> FloatArray:
    middle, half, _, _ = limits(robot, 0.6)
    pose: FloatArray = middle + half * rng.uniform(-1.0, 1.0, robot.n)
    return pose


def plateaus(
    robot: Robot,
    seconds: float = 600.0,
    seed: int = 0,
    rate: float = 100.0,
    speeds: Sequence[float] = PLATEAU_SPEEDS,
    joints: Sequence[int] | None = None,
) -> Protocol:
    """Constant speeds both ways, one joint after the other.

    Args:
        robot: whose limits to keep; speeds above 80 % of a joint's limit are left out.
        seconds: about how long; shared equally among the plateaus, two seconds each at least.
        seed: draws the pose of the other joints.
        rate: sampling rate [Hz].
        speeds: the plateaus [rad/s].
        joints: joints to move, from 1; all by default.
    """
    rng = np.random.default_rng(seed)
    _, half, velocity, _ = limits(robot)
    chosen = range(robot.n) if joints is None else [joint - 1 for joint in joints]
    path = _Path(_pose(robot, rng))
    runs = [(joint, speed) for joint in chosen for speed in speeds if speed <= velocity[joint]]
    budget = max(seconds / max(2 * len(runs), 1) - HOLD, 0.5)
    for joint, speed in runs:
        home = path.corners[-1]
        reach = min(speed * budget, 0.5 * half[joint])
        path.to(_shifted(home, joint, reach), reach / speed)
        path.rest(HOLD)
        path.to(home, reach / speed)
        path.rest(HOLD)
    return path.protocol("plateaus", rate)


def reversals(
    robot: Robot,
    seconds: float = 300.0,
    seed: int = 0,
    rate: float = 100.0,
    sizes: Sequence[float] = REVERSALS,
    speed: float = 0.005,
) -> Protocol:
    """Small motions to and fro around poses that are approached from either side: loops in position, not in speed.

    Args:
        robot: whose limits to keep.
        seconds: about how long; as many poses as fit, two at least.
        seed: draws the poses.
        rate: sampling rate [Hz].
        sizes: travel of each to and fro [rad].
        speed: speed of those motions [rad/s].
    """
    rng = np.random.default_rng(seed)
    _, _, velocity, _ = limits(robot)
    path = _Path(_pose(robot, rng))
    side = 1.0
    while side > 0.0 or path.times[-1] < seconds:
        pose = _pose(robot, rng)
        path.move(pose - side * 0.1, velocity)
        path.move(pose, velocity)
        for size in sizes:
            for _ in range(2):
                path.to(pose - side * size, size / speed)
                path.rest(0.5)
                path.to(pose, size / speed)
                path.rest(0.5)
        side = -side
    return path.protocol("reversals", rate)


def static_poses(robot: Robot, seconds: float = 300.0, seed: int = 0, rate: float = 100.0) -> Protocol:
    """Rest at random poses, each approached from below and from above: the mean of both is free of friction.

    Args:
        robot: whose limits to keep.
        seconds: about how long; as many poses as fit, one at least.
        seed: draws the poses.
        rate: sampling rate [Hz].
    """
    rng = np.random.default_rng(seed)
    _, _, velocity, _ = limits(robot)
    path = _Path(_pose(robot, rng))
    while len(path.times) <= 2 or path.times[-1] < seconds:
        pose = _pose(robot, rng)
        for side in (1.0, -1.0):
            path.move(pose - side * 0.08, velocity)
            path.move(pose, velocity)
    return path.protocol("static_poses", rate)


def torque_ramps(
    robot: Robot,
    seconds: float = 300.0,
    seed: int = 0,
    rate: float = 100.0,
    creep: float = 0.0015,
    reach: float = 0.012,
) -> Protocol:
    """One joint after the other creeps from rest, so slowly that its torque ramps up until it breaks away, both ways.

    Args:
        robot: whose limits to keep.
        seconds: about how long; as many rounds over the joints as fit, one at least.
        seed: draws the pose of each round.
        rate: sampling rate [Hz].
        creep: commanded speed [rad/s].
        reach: how far [rad], several times the slip before breakaway.
    """
    rng = np.random.default_rng(seed)
    _, _, velocity, _ = limits(robot)
    path = _Path(_pose(robot, rng))
    while len(path.times) <= 2 or path.times[-1] < seconds:
        path.move(_pose(robot, rng), velocity)
        home = path.corners[-1]
        for joint in range(robot.n):
            for goal in (_shifted(home, joint, reach), home):
                path.to(goal, reach / creep)
                path.rest(HOLD)
    return path.protocol("torque_ramps", rate)


def payload_pair(
    virtual: VirtualRobot,
    protocol: Protocol,
    mass: float,
    com: tuple[float, float, float],
    inertia: tuple[float, float, float] = (0.0, 0.0, 0.0),
    seed: int = 0,
) -> tuple[JointLog, JointLog]:
    """Return two logs of one motion: without and with a known load.

    Args:
        virtual: the robot as it is.
        protocol: the motion.
        mass: of the load [kg].
        com: its centre of mass in the last link's frame [m].
        inertia: its principal inertias about it, along that frame's axes [kg m^2].
        seed: draws the noise, afresh for the second log.
    """
    scenario = virtual.scenario.with_effect("payload", mass=mass, com=com, inertia=inertia)
    loaded = VirtualRobot(virtual.robot, scenario)
    return virtual.record(protocol, seed), loaded.record(protocol, seed + 1)
