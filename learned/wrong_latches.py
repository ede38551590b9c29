"""Diagnostic: how often a motion discriminator remembers the wrong direction of a stopped joint.

Velocity rings when a joint stops, and the ringing may cross a small threshold the other way. The true direction is the
one the position last travelled in, which no ringing of less than ``travel`` can turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.log import JointLog
from ident.signals import Motion
from learned.motion_discriminator import DiscriminatorSpec, MotionDiscriminator
from learned.window import frames_of


@dataclass(frozen=True)
class LatchReport:
    """Stops of a log, per joint, and those remembered wrongly.

    Attributes:
        stops: stops seen (n,).
        wrong: stops whose latched sign contradicts the motion before them, (I, n).
        silent: stops that latched nothing, because no velocity had reached the threshold, (I, n).
    """

    stops: IntArray
    wrong: IntArray
    silent: IntArray

    @property
    def share(self) -> FloatArray:
        """Share of the stops latched wrongly, (I, n); NaN for a joint that never stopped."""
        counts = np.where(self.stops > 0, self.stops, 1)
        return np.where(self.stops > 0, self.wrong / counts, np.nan)


def wrong_latches(
    log: JointLog, spec: DiscriminatorSpec, cutoff: float, travel: float = 0.005, still: float = 0.001
) -> LatchReport:
    """Count the stops of a log after which a discriminator holds the wrong sign.

    The discriminator is fed as it is online, with motion filtered causally at ``cutoff`` [Hz]; ``travel`` and ``still``
    [rad or m] as in ``count_latches``.

    Args:
        log: of motion with stops.
        spec: the discriminator.
        cutoff: of the causal filter [Hz].
        travel, still: as in ``count_latches`` [rad or m].
    """
    frames = frames_of(log, log.rate, cutoff)
    return count_latches(frames.motion, frames.segments, spec, log.rate, travel, still)


def count_latches(
    motion: Motion,
    segments: list[slice],
    spec: DiscriminatorSpec,
    rate: float,
    travel: float = 0.005,
    still: float = 0.001,
    seconds: float = 0.5,
) -> LatchReport:
    """Count the stops after which a discriminator holds the wrong sign.

    A joint has stopped when its position stayed within ``still`` [rad or m] for ``seconds``, after it had moved by
    ``travel`` [rad or m] or more since the last stop. ``motion`` is that of a log with those ``segments``, sampled at
    ``rate`` [Hz].

    Args:
        motion: positions and velocities, (N, n).
        segments: rows of each segment.
        spec: the discriminator.
        rate: samples a second [Hz].
        travel: way after which a stop counts as a new one [rad or m].
        still: how far a stopped joint may move [rad or m].
        seconds: for which it must stay so.
    """
    n = motion.q.shape[1]
    held = MotionDiscriminator(spec, n).run(motion.q, motion.dq, segments)[:, : spec.count]
    play = MotionDiscriminator(DiscriminatorSpec((0.5 * travel,), "displacement"), n)
    direction = np.sign(play.run(motion.q, motion.dq, segments)[:, 0])
    window = max(2, round(seconds * rate))
    stops = np.zeros(n, dtype=np.int64)
    wrong = np.zeros((spec.count, n), dtype=np.int64)
    silent = np.zeros((spec.count, n), dtype=np.int64)
    for rows in segments:
        for joint in range(n):
            q = motion.q[rows, joint]
            at = rows.start + _stops(q, _at_rest(q, window, still), travel)
            truth = direction[at, joint]
            at, truth = at[truth != 0.0], truth[truth != 0.0]
            latched = np.sign(held[at, :, joint])
            stops[joint] += len(at)
            wrong[:, joint] += np.sum(latched == -truth[:, None], axis=0)
            silent[:, joint] += np.sum(latched == 0.0, axis=0)
    return LatchReport(stops, wrong, silent)


def _at_rest(q: FloatArray, window: int, still: float) -> BoolArray:
    """True where the last ``window`` positions lie within ``still`` of each other."""
    shift = (window - 1) // 2
    spread = maximum_filter1d(q, window, origin=shift) - minimum_filter1d(q, window, origin=shift)
    rest: BoolArray = spread < still
    rest[: window - 1] = False
    return rest


def _stops(q: FloatArray, rest: BoolArray, travel: float) -> IntArray:
    """Rows at which a joint begins to be at rest, at least ``travel`` of motion after it last was."""
    onsets = np.flatnonzero(rest & ~np.r_[False, rest[:-1]])
    kept: list[int] = []
    done, low, high = 0, np.inf, -np.inf
    for row in onsets.tolist():
        low = min(low, q[done : row + 1].min())
        high = max(high, q[done : row + 1].max())
        done = row
        if high - low >= travel:
            kept.append(row)
            low = high = q[row]
    return np.asarray(kept, dtype=np.int64)
