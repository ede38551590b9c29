"""What a gap in time does to a network's memory.

Over a gap that the causal filters do not bridge nobody knows what a joint did: window and discriminator begin again,
as at the start of a segment. But the robot may be in the midst of a motion, which filters that begin at rest show as a
jerk, so velocity and acceleration count as unknown until the filters have forgotten how they began. After a shorter
gap, over which the filters take the motion to have run straight, they count as unknown for as long as it lasted; one
dropped sample does no harm.
"""

from __future__ import annotations

import itertools

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.causal import FORGOTTEN, CausalDerivatives
from ident.log import JointLog, Sample

HARMLESS = 2.5
"""Time step, in nominal periods, that a network may take for an ordinary one."""


def longest_gap(cutoff: float) -> float:
    """Time [s] without a sample after which filters of a cut-off [Hz] begin anew, and which they take to settle."""
    return FORGOTTEN / cutoff


def stretches(log: JointLog, cutoff: float) -> list[slice]:
    """Rows of a log between segments' ends and gaps that the filters do not bridge, in order."""
    found = []
    for segment in log.segments():
        rows = _known(log, segment)
        starts = rows[1:][np.diff(log.t[rows]) > longest_gap(cutoff)]
        edges = [segment.start, *starts.tolist(), segment.stop]
        found += [slice(a, b) for a, b in itertools.pairwise(edges)]
    return found


def unsettled(log: JointLog, rate: float, cutoff: float) -> BoolArray:
    """Tell in which rows, (N,), velocity and acceleration are unknown because of a gap before them.

    Args:
        log: the log.
        rate: its nominal samples a second [Hz].
        cutoff: of the low pass [Hz].
    """
    until = np.full(len(log), -np.inf)
    for segment in log.segments():
        rows = _known(log, segment)
        gap = np.diff(log.t[rows])
        ends = log.t[rows[1:]] + np.minimum(gap, longest_gap(cutoff))
        until[rows[1:]] = np.where(gap > HARMLESS / rate, ends, -np.inf)
        until[segment] = np.maximum.accumulate(until[segment])
    return np.asarray(log.t < until)


def _known(log: JointLog, segment: slice) -> IntArray:
    """Rows of a segment whose motion is known."""
    known = np.isfinite(log.t[segment]) & np.isfinite(log.q[segment]).all(axis=1)
    for values in (log.dq, log.ddq):
        if values is not None:
            known &= np.isfinite(values[segment]).all(axis=1)
    return np.asarray(segment.start + np.flatnonzero(known))


class OnlineMotion:
    """Causal motion sample by sample; the same as ``frames_of`` gives for a whole log.

    Args:
        rate: nominal samples a second [Hz].
        cutoff: of the low pass [Hz].
        n: joints.

    Attributes:
        restarted: whether the last sample came after a gap after which whoever remembers motion has to begin anew.
    """

    def __init__(self, rate: float, cutoff: float, n: int) -> None:
        self._filters = CausalDerivatives(rate, cutoff, n)
        self._harmless, self._longest = HARMLESS / rate, longest_gap(cutoff)
        self._unknown = np.full(n, np.nan)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as at the start of a segment."""
        self._filters.reset()
        self._last, self._until = np.inf, -np.inf
        self.restarted = False

    def step(self, sample: Sample) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Take one sample; return q, dq, ddq, each (n,): NaN where the sample is, the last two also after a gap."""
        t = sample.t
        q, dq, ddq = self._filters.step(t, sample.q, sample.dq, sample.ddq)
        self.restarted = False
        if not np.isnan(q[0]):  # the filter gives NaN for all joints or for none
            gap = t - self._last
            if gap > self._harmless:
                self.restarted = gap > self._longest
                self._until = max(self._until, t + min(gap, self._longest))
            self._last = t
        if t < self._until:
            return q, self._unknown, self._unknown
        return q, dq, ddq
