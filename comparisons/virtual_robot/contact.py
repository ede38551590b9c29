"""Hands and pushes: what the outside world does to the links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comparisons.virtual_robot.kinematics import Kinematics
from ident.arrays import FloatArray


@dataclass(frozen=True)
class Push:
    """A force that swells, holds and ebbs away.

    Attributes:
        link: the link pushed, counted from 1 as its joint is.
        point: where, in the frame of that link's joint [m], (3,).
        force: the force at its height, in the base frame [N], (3,).
        start, duration: when and for how long [s], from the start of the segment.
        rise: time to swell and to ebb [s], at most half of the duration.
    """

    link: int
    point: tuple[float, float, float]
    force: tuple[float, float, float]
    start: float
    duration: float
    rise: float = 0.15

    def force_at(self, t: FloatArray) -> FloatArray:
        """Return the force (N, 3) at the times ``t`` (N,) from the start of the segment; smooth in time."""
        rise = max(min(self.rise, 0.5 * self.duration), 1e-9)
        ramp = np.clip(np.minimum(t - self.start, self.start + self.duration - t) / rise, 0.0, 1.0)
        profile = ramp * ramp * (3.0 - 2.0 * ramp)
        force: FloatArray = profile[:, None] * np.array(self.force)
        return force


@dataclass(frozen=True)
class Hand:
    """A hand that holds the tool and leads it along a path, pulling like a spring with a damper.

    Attributes:
        times: times of the path's corners [s], (K,).
        offsets: the hand's place at those times, from the tool's place when it took hold [m], (K, 3).
        stiffness, damping: of the grip [N/m, N s/m].
        start, stop: the hand holds the tool between these times [s].
    """

    times: tuple[float, ...]
    offsets: tuple[tuple[float, float, float], ...]
    stiffness: float = 400.0
    damping: float = 20.0
    start: float = 0.0
    stop: float = np.inf

    def holds(self, t: float) -> bool:
        """Return whether the hand holds the tool at time ``t`` [s]."""
        return self.start <= t < self.stop

    def force_at(self, t: float, taken: FloatArray, tool: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the force (3,) [N] on the tool, taken hold of at ``taken`` (3,), now at ``tool`` with ``speed``."""
        place = np.array([np.interp(t, self.times, axis) for axis in zip(*self.offsets, strict=True)])
        force: FloatArray = self.stiffness * (taken + place - tool) - self.damping * speed
        return force


def push_effect(
    kinematics: Kinematics, pushes: Sequence[Push], t: FloatArray, q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the joint torques (N, n) and tool wrench (N, 6) of pushes at times ``t`` (N,), positions ``q`` (N, n).

    A torque acts along +q where positive. The wrench [force; moment about the tool's origin] is in base axes and
    counts what acts on the last link: what a force sensor behind the tool would feel of the world.

    Args:
        kinematics: of the mechanism.
        pushes: on any links.
        t: times from the start of the segment [s].
        q: joint positions there [rad or m].
    """
    torque, wrench = np.zeros_like(q), np.zeros((len(q), 6))
    for push in pushes:
        busy = np.flatnonzero((t >= push.start) & (t <= push.start + push.duration))
        if len(busy) == 0:
            continue
        rows = slice(busy[0], busy[-1] + 1)
        force = push.force_at(t[rows])
        part, where = kinematics.push_torques(q[rows], push.link - 1, np.array(push.point), force)
        torque[rows] += part
        if push.link - 1 == kinematics.last:
            _, tool = kinematics.push_torques(q[rows], kinematics.last, kinematics.tool, force)
            wrench[rows, :3] += force
            wrench[rows, 3:] += np.cross(where - tool, force)
    return torque, wrench
