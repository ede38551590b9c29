"""Levels above which a residual is taken for contact, from logs without contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.signals import Motion
from observers.residual import Residual

EPISODE = 1.0
"""Residuals that exceed a level within this time [s] of each other count as one false alarm."""

TAIL = 0.1
"""Share of the peaks, the greatest, from which the tail of their distribution is drawn."""

KNOWN = 5.0
"""False alarms in the logs at which their own rate is taken and no tail is drawn."""

FEWEST = 20
"""Peaks that a tail takes at least."""


@dataclass(frozen=True, eq=False)
class Threshold:
    """Level of each joint's residual, constant or growing with its motion, all (n,) in the residual's unit.

    Attributes:
        constant: at rest.
        by_speed: growth with |dq| [per rad/s].
        by_acceleration: growth with |ddq| [per rad/s^2].
    """

    constant: FloatArray
    by_speed: FloatArray
    by_acceleration: FloatArray

    @staticmethod
    def fixed(level: FloatArray) -> Threshold:
        """Return a threshold that does not depend on motion."""
        return Threshold(np.asarray(level, dtype=np.float64), np.zeros(len(level)), np.zeros(len(level)))

    @property
    def moves(self) -> bool:
        """Whether it depends on motion."""
        return bool(np.any(self.by_speed > 0.0) or np.any(self.by_acceleration > 0.0))

    def at(self, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """Return the level (..., n) for velocities and accelerations (..., n); NaN counts as rest."""
        speed, hurry = np.nan_to_num(np.abs(dq)), np.nan_to_num(np.abs(ddq))
        level: FloatArray = self.constant + self.by_speed * speed + self.by_acceleration * hurry
        return level

    def times(self, factor: float) -> Threshold:
        """Return a threshold of this many times the level."""
        return Threshold(factor * self.constant, factor * self.by_speed, factor * self.by_acceleration)


def fit_threshold(
    residuals: Sequence[Residual],
    false_alarms_per_hour: float = 1.0,
    motions: Sequence[Motion] | None = None,
) -> Threshold:
    """Fit a threshold that logs without contact exceed about so many times an hour, all joints together.

    The rate of peaks above a level is drawn from the greatest tenth of the peaks of all seconds, whose excess is taken
    as exponential (peaks over threshold, Coles 2001), so that levels rarer than the logs are long can be asked for;
    they are never below the greatest residual seen.

    Args:
        residuals: of logs without contact.
        false_alarms_per_hour: rate wanted.
        motions: of the same rows; the level then follows the joint's speed and acceleration.

    Raises:
        InputError: the rate is not positive, or the logs hold too few seconds.
    """
    if not false_alarms_per_hour > 0.0:
        raise InputError(f"{false_alarms_per_hour} false alarms an hour", "threshold", "give a rate above 0")
    n = residuals[0].current.shape[1]
    shape = Threshold.fixed(np.ones(n)) if motions is None else _fit_shape(residuals, motions)
    peaks = []
    for k, residual in enumerate(residuals):
        still = np.zeros(residual.current.shape)
        level = shape.at(still, still) if motions is None else shape.at(motions[k].dq, motions[k].ddq)
        peaks.append(_peaks(residual, np.abs(residual.current) / level))
    every = np.concatenate(peaks)
    if len(every) < FEWEST:
        what = f"{len(every)} s without contact are too few for a threshold"
        raise InputError(what, "threshold", f"give logs of at least {FEWEST} s")
    factor = np.array([tail_level(every[:, j], false_alarms_per_hour / n) for j in range(n)])
    return Threshold(factor * shape.constant, factor * shape.by_speed, factor * shape.by_acceleration)


def tail_level(peaks: FloatArray, per_hour: float) -> float:
    """Return the level that peaks (K,), one for every `EPISODE`, exceed ``per_hour`` times an hour.

    Args:
        peaks: greatest residual of each episode.
        per_hour: how often an hour the level may be exceeded.
    """
    ordered = np.sort(peaks)
    hours = len(peaks) * EPISODE / 3600.0
    expected = hours * per_hour
    if expected >= KNOWN:
        return float(ordered[-min(round(expected) + 1, len(peaks))])
    count = max(int(TAIL * len(peaks)), min(FEWEST, len(peaks) - 1))
    start = float(ordered[-count - 1])
    excess = float(np.mean(ordered[-count:] - start))
    level = start + excess * np.log(count / expected)
    # where the logs are too short to have shown one alarm, what they did show is the least to allow
    return float(max(level, ordered[-1] if expected < 1.0 else 0.0))


def _peaks(residual: Residual, ratio: FloatArray) -> FloatArray:
    """Greatest ratio (K, n) in each `EPISODE` of the rows that count."""
    good = residual.good & np.isfinite(ratio).all(axis=1)
    bins = np.floor((residual.t - residual.t[0]) / EPISODE).astype(np.int64)[good]
    edges = np.flatnonzero(np.diff(bins, prepend=-1))
    peaks: FloatArray = np.maximum.reduceat(ratio[good], edges, axis=0) if len(edges) else np.empty((0, ratio.shape[1]))
    return peaks


def _fit_shape(residuals: Sequence[Residual], motions: Sequence[Motion]) -> Threshold:
    """Fit |residual| = a + b |dq| + c |ddq| with a, b, c at least nought, joint by joint."""
    from scipy.optimize import nnls

    n = residuals[0].current.shape[1]
    found = np.zeros((3, n))
    for j in range(n):
        normal, right, mean = np.zeros((3, 3)), np.zeros(3), 0.0
        for residual, motion in zip(residuals, motions, strict=True):
            columns = np.stack([np.ones(len(motion)), np.abs(motion.dq[:, j]), np.abs(motion.ddq[:, j])], axis=1)
            good = residual.good & np.isfinite(columns).all(axis=1)
            size = np.abs(residual.current[good, j])
            normal += columns[good].T @ columns[good]
            right += columns[good].T @ size
            mean += float(size.mean()) / len(residuals)
        scale = 1.0 / np.sqrt(np.diag(normal) + 1e-300)
        root = np.linalg.cholesky(scale[:, None] * normal * scale + 1e-9 * np.eye(3))
        found[:, j] = nnls(root.T, np.linalg.solve(root, scale * right))[0] * scale
        found[0, j] = max(found[0, j], 0.05 * mean, 1e-12)
    return Threshold(found[0], found[1], found[2])
