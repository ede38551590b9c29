"""What a log holds, at a glance: time, resolution and coverage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.log import JointLog
from ident.robot import JointLimits
from ident.signals import Motion, derive

REST_SPEED = 5e-3
"""A joint slower than this [rad/s or m/s] counts as at rest."""
STILL_RANGE = 1e-3
"""A joint whose position stays within this [rad or m] never moves."""
GAP = 1.5
"""A step longer than this many median steps is a gap."""
FEWEST_STEPS = 8
"""A quantum is claimed from no fewer small differences."""
VIEW_CUTOFF = 5.0
"""Low pass [Hz] of the velocities that are summarised, at most a fifth of the rate."""


@dataclass(frozen=True, eq=False)
class LogSummary:
    """Time, resolution and coverage of a log.

    Attributes:
        name: of the log.
        rows, segments: how many.
        duration: time inside segments [s].
        rate: one over the median time step [Hz].
        jitter: standard deviation of the time steps inside segments, gaps left out [s].
        longest_step: [s].
        gaps: time steps longer than GAP median steps.
        repeated: rows that repeat all positions and currents of the row before, as a polled controller gives them.
        position_step, current_step: smallest step of each joint's position and current, (n,); 0 where none shows.
        lower, upper: least and largest position [rad or m], (n,).
        range_share: position range used, as a share of the limits, (n,); NaN where the limits are unknown.
        speed: largest speed, low-passed [rad/s or m/s], (n,).
        rest: share of the time slower than REST_SPEED, (n,).
        never_moves: joints, counted from 1, that stay within STILL_RANGE or two position steps.
        velocity_lag: lag of the logged velocity behind that of the positions [s], (n,); None where none is logged.
    """

    name: str
    rows: int
    segments: int
    duration: float
    rate: float
    jitter: float
    longest_step: float
    gaps: int
    repeated: int
    position_step: FloatArray
    current_step: FloatArray
    lower: FloatArray
    upper: FloatArray
    range_share: FloatArray
    speed: FloatArray
    rest: FloatArray
    never_moves: tuple[int, ...]
    velocity_lag: FloatArray | None

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Return header and one row a joint, as text."""
        header = ["joint", "from", "to", "of range", "max speed", "at rest", "position step", "current step"]
        rows = [
            [
                f"{j + 1}",
                f"{self.lower[j]:.3f}",
                f"{self.upper[j]:.3f}",
                "-" if np.isnan(self.range_share[j]) else f"{100 * self.range_share[j]:.0f} %",
                f"{self.speed[j]:.3g}",
                f"{100 * self.rest[j]:.0f} %",
                f"{self.position_step[j]:.2g}" if self.position_step[j] else "-",
                f"{self.current_step[j]:.2g}" if self.current_step[j] else "-",
            ]
            for j in range(len(self.lower))
        ]
        if self.velocity_lag is not None:
            header.append("velocity lag")
            for row, lag in zip(rows, self.velocity_lag, strict=True):
                row.append("-" if np.isnan(lag) else f"{1e3 * lag:.1f} ms")
        return header, rows

    def headline(self) -> str:
        """Return its length, rate and regularity in one line."""
        return (
            f"{self.name}: {self.rows} rows, {self.duration:.2f} s in {self.segments} segment"
            f"{'s' if self.segments != 1 else ''}, {self.rate:.2f} Hz, jitter {1e3 * self.jitter:.3g} ms, "
            f"longest step {1e3 * self.longest_step:.3g} ms, {self.gaps} gaps, {self.repeated} repeated rows"
        )

    def __str__(self) -> str:
        header, rows = self.table()
        widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
        lines = [
            "  ".join(text.rjust(width) for text, width in zip(row, widths, strict=True)) for row in [header, *rows]
        ]
        still = f"\nnever moving: joint {', '.join(map(str, self.never_moves))}" if self.never_moves else ""
        return "\n".join([self.headline(), *lines]) + still


def summarise(log: JointLog, limits: JointLimits | None = None) -> LogSummary:
    """Summarise a log.

    Args:
        log: of at least two rows in one segment.
        limits: of the robot, for the share of the range that is used.

    Raises:
        InputError: every segment has fewer than two rows.
    """
    rate = log.rate
    inside = np.diff(log.segment) == 0
    steps = np.diff(log.t)[inside]
    regular = steps <= GAP / rate
    same = (np.diff(log.q, axis=0) == 0).all(axis=1) & (np.diff(log.current, axis=0) == 0).all(axis=1) & inside
    lower, upper = log.q.min(axis=0), log.q.max(axis=0)
    span = np.full(log.n, np.nan) if limits is None else limits.upper - limits.lower
    share = np.where(np.isfinite(span), (upper - lower) / np.where(np.isfinite(span), span, 1.0), np.nan)
    position_step = np.array([_smallest_step(log.q[:, j]) for j in range(log.n)])
    still = upper - lower <= np.maximum(STILL_RANGE, 2.0 * position_step)
    motion = derive(log.replace(dq=None, ddq=None), min(VIEW_CUTOFF, 0.2 * rate))
    speed = np.abs(motion.dq[np.isfinite(motion.dq).all(axis=1)])
    if len(speed) == 0:  # segments too short to filter
        speed = np.abs(np.diff(log.q, axis=0)[inside] / steps[:, None])
    return LogSummary(
        name=log.name,
        rows=len(log),
        segments=len(log.segments()),
        duration=float(steps.sum()),
        rate=rate,
        jitter=float(np.std(steps[regular])),
        longest_step=float(steps.max()),
        gaps=int(np.count_nonzero(~regular)),
        repeated=int(np.count_nonzero(same)),
        position_step=position_step,
        current_step=np.array([_smallest_step(log.current[:, j]) for j in range(log.n)]),
        lower=lower,
        upper=upper,
        range_share=share,
        speed=speed.max(axis=0),
        rest=np.mean(speed < REST_SPEED, axis=0),
        never_moves=tuple(int(j) + 1 for j in np.flatnonzero(still)),
        velocity_lag=None if log.dq is None else _velocity_lag(log, motion),
    )


def _smallest_step(x: FloatArray) -> float:
    """Return the quantum of a signal, 0 where its small differences are not multiples of one.

    The smallest difference is the first guess; decimal rounding in the log spreads it, so all small ones refine it.
    """
    steps = np.abs(np.diff(x))
    steps = steps[steps > 1e-9 * float(np.ptp(x))]
    if len(steps) == 0:
        return 0.0
    quantum = float(np.median(steps[steps < 1.5 * steps.min()]))
    small = steps[steps < 20.5 * quantum]
    for _ in range(3):
        counts = np.maximum(np.round(small / quantum), 1.0)
        quantum = float(np.sum(small * counts) / np.sum(counts**2))
    ratio = small / quantum
    multiples = np.abs(ratio - np.round(ratio)) < 0.1
    return quantum if len(small) >= FEWEST_STEPS and np.mean(multiples) > 0.9 else 0.0


def _velocity_lag(log: JointLog, motion: Motion) -> FloatArray:
    """Lag tau of the logged velocity [s], where that is dq - tau ddq; NaN for joints that hardly move.

    The sum of absolute deviations is least for the median of (dq - logged) / ddq weighted with abs(ddq); a few rows
    with wrong velocities, as at the ends of a filtered log, do not move it.
    """
    logged = derive(log, min(VIEW_CUTOFF, 0.2 * log.rate)).dq
    known = np.isfinite(motion.ddq).all(axis=1)
    lag: FloatArray = np.full(log.n, np.nan)
    for j in range(log.n):
        difference, ddq = (motion.dq - logged)[known, j], motion.ddq[known, j]
        if not known.any() or np.abs(motion.dq[known, j]).max() < 10.0 * REST_SPEED:
            continue
        turns = np.abs(ddq) > 1e-9 * np.abs(ddq).max()
        difference, ddq = difference[turns], ddq[turns]
        ratio, weight = difference / ddq, np.abs(ddq)
        order = np.argsort(ratio)
        half = np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())
        lag[j] = ratio[order[half]]
    return lag
