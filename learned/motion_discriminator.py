"""The motion discriminator: what a stopped joint remembers of the motion before.

Algorithm 1 of the paper holds, for each threshold and joint, the last velocity whose magnitude reached the threshold.
Two more signals keep that memory where the measured velocity rings as a joint stops: a causal median of the velocity,
and the play operator of Maxwell slip on the position itself. A fourth also remembers how far each other joint has
travelled since, which shakes stored friction loose (the paper's Joint 4). One compiled scan serves a whole log and a
single sample, so both give the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.compiled import compiled
from ident.errors import InputError

Signal = Literal["velocity", "median-velocity", "displacement", "displacement-and-travel"]
Hold = Literal["velocity", "threshold"]

MEDIAN_SAMPLES = 7
"""Length of the causal median: on a real arm seven samples kept the sign that raw velocity lost in most stops."""

TABLE_I: tuple[tuple[float, ...], ...] = (
    (0.003, 0.006, 0.009, 0.012, 0.015),
    (0.012, 0.016, 0.020, 0.024, 0.028),
    (0.002, 0.006, 0.010, 0.014, 0.018),
)
"""The paper's velocity thresholds [rad/s] at 100 Hz, one group a hierarchy (Table I)."""

PLAY_THRESHOLDS: tuple[float, ...] = (0.0005, 0.001, 0.0015, 0.003, 0.006, 0.01)
"""Displacements [rad] for ``displacement``: on a real arm 0.5 to 10 mrad explained most of the current at rest."""

TRAVEL = 0.3
"""Travel [rad] of another joint after which what is remembered of it has fallen to 1/e."""

_SIGNALS: dict[str, int] = {"velocity": 0, "median-velocity": 1, "displacement": 2, "displacement-and-travel": 3}


@dataclass(frozen=True)
class DiscriminatorSpec:
    """What a motion discriminator holds, and on which signal.

    Attributes:
        thresholds: I thresholds [rad/s; ``displacement``: rad; prismatic joints: m/s, m], the same for every joint, or
            one tuple of n a threshold.
        signal: ``velocity`` is Algorithm 1 as published; ``median-velocity`` takes the causal median of the last seven
            velocities first; ``displacement`` holds, as a play operator of that half-width on the position does, the
            displacement since the last reversal, at most the threshold; ``displacement-and-travel`` holds beside these
            ``exp(-s / 0.3 rad)`` of the way s that each other joint has gone since this one last moved; moving by the
            last threshold makes up for all but 1/e of what is lost.
        hold: keep the last ``velocity`` itself or the signed ``threshold`` alone; nothing to a play operator.
    """

    thresholds: tuple[float, ...] | tuple[tuple[float, ...], ...]
    signal: Signal = "velocity"
    hold: Hold = "velocity"

    def __post_init__(self) -> None:
        if self.signal not in _SIGNALS:
            raise InputError(f"unknown signal {self.signal!r}", "motion discriminator", f"choose of {list(_SIGNALS)}")
        if self.hold not in ("velocity", "threshold"):
            raise InputError(f"unknown hold {self.hold!r}", "motion discriminator", "choose velocity or threshold")
        if len(self.thresholds) and not np.all(np.asarray(self.thresholds, dtype=float) > 0.0):
            raise InputError("a threshold is not positive", "motion discriminator", "give positive thresholds")
        if self.signal == "displacement-and-travel" and not len(self.thresholds):
            raise InputError("no threshold", "motion discriminator", "give one, which tells motion from rest")

    @property
    def count(self) -> int:
        """Number of thresholds I."""
        return len(self.thresholds)

    def rows(self, n: int) -> int:
        """Values that are held for each of n joints: one a threshold, and with travel one a joint."""
        return self.count + (n if self.signal == "displacement-and-travel" else 0)

    def matrix(self, n: int) -> FloatArray:
        """Thresholds (I, n) of an n-joint robot; InputError where they were given for another number of joints."""
        given = np.asarray(self.thresholds, dtype=float)
        if given.ndim == 2 and given.shape[1] != n:
            what = f"thresholds for {given.shape[1]} joints where the robot has {n}"
            raise InputError(what, "motion discriminator", "give one threshold a joint")
        columns = given.reshape(self.count, -1) if self.count else np.zeros((0, 1))
        return np.array(np.broadcast_to(columns, (self.count, n)))


@compiled
def _median(ring: Any, joint: int) -> float:
    """Median of one joint's ring of velocities."""
    count = ring.shape[0]
    ordered = np.empty(count)
    for k in range(count):
        value = ring[k, joint]
        place = k
        while place > 0 and ordered[place - 1] > value:
            ordered[place] = ordered[place - 1]
            place -= 1
        ordered[place] = value
    return float(ordered[count // 2])


@compiled
def scan(q: Any, dq: Any, thresholds: Any, mode: Any, state: Any, ring: Any, out: Any) -> None:
    """Carry the discriminator over rows of motion.

    ``state`` (2 + I, n) holds the rows seen of the ring, the last position and the I held values, with travel also the
    way gone in this row and, a row a joint, what that joint's travel has left of each other one's memory; ``ring``
    (7, n) the last velocities. ``mode`` is (signal, hold). ``out`` (N, I, n), with travel (N, I + n, n), takes the
    discriminator of each row. A row whose signal is NaN changes nothing.

    Args:
        q, dq: positions and velocities, (N, n).
        thresholds: of each joint, (I, n).
        mode: signal and hold by number, (2,).
        state, ring: memory, changed in place.
        out: takes the discriminator of each row.
    """
    signal, hold = mode[0], mode[1]
    rows, joints = q.shape
    steps = thresholds.shape[0]
    way, travel = 2 + steps, 3 + steps
    for k in range(rows):
        for joint in range(joints):
            value = dq[k, joint]
            if signal == 1 and not np.isnan(value):
                seen = int(state[0, joint])
                ring[seen % ring.shape[0], joint] = value
                state[0, joint] = (seen + 1) % ring.shape[0]
                value = _median(ring, joint)
            moved = 0.0
            if signal >= 2 and not np.isnan(q[k, joint]):
                moved = q[k, joint] - state[1, joint] if state[0, joint] > 0.0 else 0.0
                state[0, joint] = 1.0
                state[1, joint] = q[k, joint]
            if signal == 3:
                slips = abs(state[2, joint] + moved) > thresholds[0, joint]
                state[way, joint] = abs(moved) if slips else 0.0
            for i in range(steps):
                limit = thresholds[i, joint]
                if signal >= 2:
                    state[2 + i, joint] = max(-limit, min(limit, state[2 + i, joint] + moved))
                elif abs(value) >= limit:
                    state[2 + i, joint] = value if hold == 0 else np.copysign(limit, value)
                out[k, i, joint] = state[2 + i, joint]
        if signal == 3:
            for joint in range(joints):
                renewed = 1.0 - np.exp(-state[way, joint] / thresholds[steps - 1, joint])
                for other in range(joints):
                    kept = state[travel + other, joint]
                    if other != joint:
                        kept *= np.exp(-state[way, other] / TRAVEL)
                    kept += renewed * (1.0 - kept)
                    state[travel + other, joint] = kept
                    out[k, steps + other, joint] = kept


class MotionDiscriminator:
    """Motion discriminator of an n-joint robot; ``step`` is O(1) a sample, ``run`` takes whole segments.

    All values are zero before a joint's first motion and after ``reset``.

    Args:
        spec: thresholds, and the signal they are held against.
        n: joints.
    """

    def __init__(self, spec: DiscriminatorSpec, n: int) -> None:
        self.spec = spec
        self.n = n
        self.thresholds = spec.matrix(n)
        self.mode = np.array([_SIGNALS[spec.signal], int(spec.hold == "threshold")], dtype=np.int64)
        travels = spec.rows(n) > spec.count
        self.state = np.zeros((2 + spec.count + (1 + n if travels else 0), n))
        self.ring = np.zeros((MEDIAN_SAMPLES, n))
        self._motion = np.zeros((2, 1, n))
        self._row = np.zeros((1, spec.rows(n), n))

    def reset(self) -> None:
        """Forget all motion, as at the start of a segment."""
        self.state[:] = 0.0
        self.ring[:] = 0.0

    def step(self, q: FloatArray, dq: FloatArray) -> FloatArray:
        """Take one sample, ``q`` and ``dq`` (n,) [rad, rad/s]; return the discriminator (I, n), or (I + n, n)."""
        self._motion[0, 0] = q
        self._motion[1, 0] = dq
        scan(self._motion[0], self._motion[1], self.thresholds, self.mode, self.state, self.ring, self._row)
        held: FloatArray = self._row[0].copy()
        return held

    def run(self, q: FloatArray, dq: FloatArray, segments: list[slice]) -> FloatArray:
        """Discriminator (N, I, n) of a log's motion ``q``, ``dq`` (N, n), starting anew in each segment.

        With travel it is (N, I + n, n).
        """
        held = np.zeros((len(q), self.spec.rows(self.n), self.n))
        q, dq = np.array(q, dtype=np.float64), np.array(dq, dtype=np.float64)
        for rows in segments:
            self.reset()
            scan(q[rows], dq[rows], self.thresholds, self.mode, self.state, self.ring, held[rows])
        self.reset()
        return held


def known_history(q: FloatArray, segments: list[slice], travel: float = 0.005) -> BoolArray:
    """Tell where a joint's history is known: (N, n), true once it has moved ``travel`` [rad or m] in its segment.

    Before that no discriminator can know which way the joint came to rest.

    Args:
        q: joint positions, (N, n).
        segments: rows of each segment.
        travel: way that counts as motion [rad or m].
    """
    known = np.zeros(q.shape, dtype=np.bool_)
    for rows in segments:
        moved = np.abs(q[rows] - q[rows.start]) >= travel
        known[rows] = np.logical_or.accumulate(moved, axis=0)
    return known
