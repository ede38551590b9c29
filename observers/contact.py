"""Contact and collision from residuals: when, how hard, and which links can have been pushed."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.compiled import compiled
from ident.signals import Motion
from observers.residual import Residual
from observers.thresholds import Threshold

RELEASE = 0.7
"""Share of its threshold that a residual must fall below before the contact counts as ended."""

ISOLATING = 0.4
"""Share of its threshold by which a joint's residual must have changed in a contact for the joint to have felt it."""

RECENT = 50.0
"""Samples over which the residual before a contact is averaged."""

COLLISION = 3.0
"""A collision is a residual of so many times the contact threshold, unless told otherwise."""


class Level(IntEnum):
    """How hard the world pushes."""

    NONE = 0
    CONTACT = 1
    COLLISION = 2


@dataclass(frozen=True)
class Episode:
    """One contact of a serial arm; links count from 1.

    Attributes:
        start, end: [s].
        level: the highest in it.
        link: the nearest to the base that can have been pushed: that of the last joint that felt the push.
        links: every link that the residual is consistent with: that one and all behind it. A force on any of them
            does the same where its line passes through, or runs along, the axes of the joints behind ``link``.
    """

    start: float
    end: float
    level: Level
    link: int
    links: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts along a log.

    Attributes:
        t: time [s], (N,).
        level: `Level` at each row, (N,).
        link: nearest link that can have been pushed at each row, counted from 1, 0 for none, (N,); see ``Episode``.
        ratio: each joint's residual over its contact threshold, (N, n).
    """

    t: FloatArray
    level: IntArray
    link: IntArray
    ratio: FloatArray

    def episodes(self, apart: float = 0.1) -> list[Episode]:
        """Return contacts in order; those less than ``apart`` [s] from each other are one."""
        rows = np.flatnonzero(self.level > 0)
        if len(rows) == 0:
            return []
        found = []
        for group in np.split(rows, np.flatnonzero(np.diff(self.t[rows]) > apart) + 1):
            start, end, level = float(self.t[group[0]]), float(self.t[group[-1]]), Level(int(self.level[group].max()))
            link = int(np.argmax(np.bincount(self.link[group])))
            found.append(Episode(start, end, level, link, tuple(range(link, self.ratio.shape[1] + 1))))
        return found


@dataclass(eq=False)
class ContactDetector:
    """Tells contact and collision by thresholds, and by who feels it the links that can have been pushed.

    A push on a link of a serial arm is felt by its own joint and those before it, never by those behind it (Haddadin
    et al. 2017). So the link pushed is that of the last joint that felt the push, or one behind it: a push without a
    lever about the joints in between, as one on the axis of the last joint has none, does the same to every joint as
    one nearer to the base. Joint residuals alone say no more than this, however good the estimator. A joint felt the
    push whose residual has changed since the contact by `ISOLATING` of its threshold, which what the model lacks, and
    changes slowly, does not do. A joint once in contact stays so until it falls below `RELEASE` of its threshold.

    Attributes:
        contact: threshold of contact.
        collision: threshold of collision; by default `COLLISION` times that of contact.
    """

    contact: Threshold
    collision: Threshold | None = None
    _touched: IntArray = field(init=False, repr=False)
    _before: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._touched = np.zeros(len(self.contact.constant), dtype=np.int64)
        self._before = np.zeros(len(self._touched))

    def reset(self) -> None:
        """Forget contacts under way."""
        self._touched[:] = 0
        self._before[:] = 0.0

    def step(
        self, residual: FloatArray, dq: FloatArray | None = None, ddq: FloatArray | None = None
    ) -> tuple[Level, int]:
        """Take a residual (n,), with the motion where the thresholds need it, and return level and nearest link."""
        rest = np.zeros(len(residual))
        speed, hurry = (rest if x is None else x for x in (dq, ddq))
        level, link, _ = self._scan(residual[None], speed[None], hurry[None])
        return Level(int(level[0])), int(link[0])

    def run(self, residual: Residual, motion: Motion | None = None) -> Contacts:
        """Find the contacts of a log; ``motion`` of the same rows where the thresholds need it."""
        rest = np.zeros(residual.current.shape)
        dq, ddq = (rest, rest) if motion is None else (motion.dq, motion.ddq)
        level, link = np.zeros(len(residual), dtype=np.int64), np.zeros(len(residual), dtype=np.int64)
        ratio = np.empty(residual.current.shape)
        edges = np.flatnonzero(np.diff(residual.segment)) + 1
        for rows in np.split(np.arange(len(residual)), edges):
            self.reset()
            level[rows], link[rows], ratio[rows] = self._scan(residual.current[rows], dq[rows], ddq[rows])
        return Contacts(residual.t, level, link, ratio)

    def _scan(self, residual: FloatArray, dq: FloatArray, ddq: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        contact = self.contact.at(dq, ddq)
        collision = COLLISION * contact if self.collision is None else self.collision.at(dq, ddq)
        level, link = np.zeros(len(residual), dtype=np.int64), np.zeros(len(residual), dtype=np.int64)
        _scan(residual, contact, collision, self._touched, self._before, level, link)
        return level, link, np.abs(residual) / contact


@compiled
def _scan(
    residual: FloatArray,
    contact: FloatArray,
    collision: FloatArray,
    touched: IntArray,
    before: FloatArray,
    level: IntArray,
    link: IntArray,
) -> None:
    """Go on over rows; ``touched`` (n,) are the joints in contact, ``before`` (n,) their residuals before it."""
    for k in range(len(residual)):
        for j in range(residual.shape[1]):
            size = abs(residual[k, j])
            touched[j] = size > contact[k, j] or (touched[j] == 1 and size > RELEASE * contact[k, j])
            if touched[j] == 1:
                level[k] = max(level[k], 2 if size > collision[k, j] else 1)
                link[k] = j + 1
        for j in range(residual.shape[1]):
            if level[k] == 0:
                before[j] += (residual[k, j] - before[j]) / RECENT
            elif abs(residual[k, j] - before[j]) > ISOLATING * contact[k, j]:
                link[k] = max(link[k], j + 1)
