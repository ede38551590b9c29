"""The short-term memory of a network: the last M frames of q, dq, ddq, and how they are scaled.

Frames lie row after row in one array with each segment's first frame repeated before it, so that every window of M
frames is a run of neighbouring numbers: a strided view shows all windows of a log and copies none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import as_strided

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.causal import CausalDerivatives
from ident.errors import InputError
from ident.log import JointLog
from ident.signals import Motion
from learned.gaps import stretches, unsettled

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Scaling:
    """Affine scaling of k channels to zero mean and unit deviation: ``(x - mean) * gain``, as float32."""

    mean: FloatArray
    gain: FloatArray

    def apply(self, x: FloatArray | Float32Array) -> Float32Array:
        """Scale rows (N, k)."""
        return ((x - self.mean) * self.gain).astype(np.float32)


class Moments:
    """Running mean and deviation of k channels over blocks of rows (Chan, Golub and LeVeque 1979)."""

    def __init__(self, channels: int) -> None:
        self.count = 0
        self.mean = np.zeros(channels)
        self.squares = np.zeros(channels)

    def add(self, x: FloatArray) -> None:
        """Take in rows (N, k)."""
        if len(x) == 0:
            return
        mean = x.mean(axis=0)
        total = self.count + len(x)
        self.squares += np.sum((x - mean) ** 2, axis=0) + (mean - self.mean) ** 2 * self.count * len(x) / total
        self.mean = self.mean + (mean - self.mean) * len(x) / total
        self.count = total

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation (k,)."""
        return np.asarray(np.sqrt(self.squares / max(self.count, 1)))

    def scaling(self) -> Scaling:
        """Scaling to zero mean and unit deviation; a channel that never varied is left at its size."""
        deviation = self.deviation
        moves = deviation > 1e-9 * np.maximum(np.abs(self.mean), 1e-6)
        return Scaling(self.mean.copy(), np.where(moves, 1.0 / np.where(moves, deviation, 1.0), 1.0))


@dataclass(frozen=True, eq=False)
class Frames:
    """What a network sees of one log: its causal motion at the model's rate.

    Attributes:
        motion: t, q, dq, ddq of the kept rows.
        segments: rows of each segment among the kept rows; a gap in time begins a new one.
        rows: row of the log that each kept row is.
        finite: rows whose motion is known; after a gap dq and ddq are NaN for a while (see `learned.gaps`).
    """

    motion: Motion
    segments: list[slice]
    rows: IntArray
    finite: BoolArray

    @property
    def channels(self) -> FloatArray:
        """q, dq, ddq side by side, (N, 3n)."""
        return np.hstack([self.motion.q, self.motion.dq, self.motion.ddq])


def decimation(log: JointLog, rate: float) -> int:
    """Return how many rows of the log make one step at the model's ``rate`` [Hz]; see ``multiple``."""
    return multiple(log.rate, rate, log.name)


def multiple(rate: float, model: float, name: str) -> int:
    """Return how many times a log's ``rate`` is that of the ``model`` [Hz].

    Raises:
        InputError: it is no whole multiple, to within 2 %. Thresholds and windows belong to a rate, so a model cannot
            be fed at another one.
    """
    ratio = rate / model
    factor = max(1, round(ratio))
    if abs(ratio / factor - 1.0) > 0.02:
        what = f"sampled at {rate:.4g} Hz where the model is for {model:.4g} Hz"
        raise InputError(what, f"log {name}", "resample it to the model's rate or a whole multiple of it")
    return factor


def frames_of(log: JointLog, rate: float, cutoff: float) -> Frames:
    """Derive a log's causal motion with the filters that run online, and keep the rows at the model's rate.

    The filter is that of the nominal rate, which is what a control loop knows, not of the rate found in this log.
    """
    factor = decimation(log, rate)
    filters = CausalDerivatives(rate * factor, cutoff, log.n)
    motion = Motion(log.t, *np.empty((3, *log.q.shape)))
    rows, segments = [], []
    first = 0
    early = unsettled(log, rate * factor, cutoff)
    for segment in stretches(log, cutoff):
        part = log[segment]
        filters.reset()
        motion.q[segment], motion.dq[segment], motion.ddq[segment] = filters.run(part.t, part.q, part.dq, part.ddq)
        kept = np.arange(segment.start, segment.stop, factor)
        rows.append(kept)
        segments.append(slice(first, first + len(kept)))
        first += len(kept)
    motion.dq[early] = motion.ddq[early] = np.nan
    at = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
    kept_motion = motion
    if factor > 1:
        kept_motion = Motion(motion.t[at], motion.q[at], motion.dq[at], motion.ddq[at])
    known = [np.isfinite(values).all(axis=1) for values in (kept_motion.q, kept_motion.dq, kept_motion.ddq)]
    return Frames(kept_motion, segments, at, np.logical_and.reduce(known))


def pad(values: FloatArray, segments: list[slice], finite: BoolArray, memory: int) -> tuple[FloatArray, IntArray]:
    """Repeat each segment's first known row ``memory - 1`` times before it.

    A robot that has just been switched on is taken to have stood where it stands. Unknown rows before the first known
    one hold that row as well.

    Returns:
        padded: rows (P, k) with the repeated ones.
        place: row of ``padded`` at which each row of ``values`` now lies, (N,).
    """
    parts, place, first = [], [], 0
    for rows in segments:
        part = values[rows]
        known = np.flatnonzero(finite[rows])
        start = int(known[0]) if len(known) else 0
        head = np.repeat(part[start : start + 1], memory - 1 + start, axis=0)
        parts.append(np.concatenate([head, part[start:]]))
        place.append(first + memory - 1 + np.arange(len(part)))
        first += memory - 1 + len(part)
    if not parts:
        return values[:0], np.zeros(0, dtype=np.int64)
    return np.concatenate(parts), np.concatenate(place)


def windows(padded: Float32Array, memory: int) -> Float32Array:
    """Show every run of ``memory`` rows of (P, k) as one row of (P - memory + 1, memory k), oldest first; no copies."""
    rows, channels = padded.shape
    if not padded.flags.c_contiguous:
        padded = np.ascontiguousarray(padded)
    step = padded.strides[0]
    shape = (max(rows - memory + 1, 0), memory * channels)
    return as_strided(padded, shape, (step, padded.itemsize), writeable=False)


def complete(finite: BoolArray, segments: list[slice], memory: int) -> BoolArray:
    """Tell which rows have a known motion over their whole window, the repeated first row counted as known."""
    whole = finite.copy()
    for rows in segments:
        unknown = ~finite[rows]
        known = np.flatnonzero(finite[rows])
        start = int(known[0]) if len(known) else len(unknown)
        unknown[:start] = False
        reach = np.convolve(unknown, np.ones(memory, dtype=np.int64))[: len(unknown)] > 0
        whole[rows] = ~reach
        whole[rows][:start] = False
    return whole
