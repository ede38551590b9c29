"""How good an estimate of the current is, joint by joint: where it errs, how it drifts, what it needs, what it feels.

All functions take arrays and give one figure a joint, in the unit of the error. The error is what is left where nobody
touches the robot: predicted minus measured current. A NaN in it is a frame without a prediction, which is not scored.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray

MOVING = 5e-3
"""Speed above which a joint moves [rad/s or m/s]."""

TRANSITION = 0.5
"""Time after a start or a stop that counts as transition [s]."""

FLICKER = 0.1
"""A rest or a motion shorter than this [s] is neither stop nor start: a reversal, or noise about the threshold."""

TOUCH = 0.1
"""True external torque [N m, prismatic N] above which somebody touches the robot."""

RECOVERY = 1.0
"""Time after a touch [s] in which a row counts neither as touched nor as free: filters and friction still remember."""

SHORTEST_REST = 1.0
"""Least length [s] of a rest, its transition left out, from which a drift is taken."""


@dataclass(frozen=True, eq=False)
class Regimes:
    """What each joint does at each row of a log, or of several end to end.

    Attributes:
        t: time [s], (N,), increasing inside a segment.
        segment: number of each row's segment, (N,).
        moving: joints faster than `MOVING`, (N, n); the others are static.
        starts, stops: rows at which a joint begins to move or comes to rest, (N, n).
        transition: rows within `TRANSITION` after a start or a stop, (N, n); they are moving or static as well.
        known: joints that have moved in their segment, so that how they came to rest is known, (N, n).
        free: rows in which nobody touches the robot, (N,).
    """

    t: FloatArray
    segment: IntArray
    moving: BoolArray
    starts: BoolArray
    stops: BoolArray
    transition: BoolArray
    known: BoolArray
    free: BoolArray

    @staticmethod
    def of(
        t: FloatArray, dq: FloatArray, segment: IntArray, known: BoolArray, free: BoolArray | None = None
    ) -> Regimes:
        """Tell regimes from velocities ``dq`` (N, n); a row whose velocity is NaN counts as static."""
        moving = np.abs(np.nan_to_num(dq)) > MOVING
        starts, stops = changes(t, moving, segment)
        since = after(t, starts | stops, segment)
        touched = np.ones(len(t), dtype=np.bool_) if free is None else free
        return Regimes(t, segment, moving, starts, stops, since < TRANSITION, known, touched)

    def masks(self) -> dict[str, BoolArray]:
        """Frames (N, n) of each regime by the name of its figure, of rows in which nobody touches the robot."""
        free = self.free[:, None]
        return {
            "rmse": np.broadcast_to(free, self.moving.shape),
            "rmse_moving": self.moving & free,
            "rmse_static": ~self.moving & free,
            "rmse_transition": self.transition & free,
        }


def touches(t: FloatArray, tau_ext: FloatArray, segment: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return the rows (N,) in which the true torque (N, n) tells a touch, and those free of one and of what it left."""
    touched = np.abs(tau_ext).max(axis=1) > TOUCH
    free = ~touched & (after(t, touched[:, None], segment)[:, 0] > RECOVERY)
    return touched, free


def changes(t: FloatArray, moving: BoolArray, segment: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return the rows (N, n) at which joints start and stop; what is over within `FLICKER` changes nothing.

    The first row of a segment is neither: nobody saw what was before.
    """
    starts, stops = np.zeros((2, *moving.shape), dtype=np.bool_)
    for rows in _runs(segment):
        for joint in range(moving.shape[1]):
            state = bool(moving[rows.start, joint])
            for run in _runs(moving[rows, joint]):
                first, ends = rows.start + run.start, min(rows.start + run.stop, rows.stop - 1)
                held = t[ends] - t[first] >= FLICKER
                if held and bool(moving[first, joint]) != state:
                    state = not state
                    (starts if state else stops)[first, joint] = True
    return starts, stops


def after(t: FloatArray, marks: BoolArray, segment: IntArray) -> FloatArray:
    """Return the time (N, n) since the last mark (N, n) of each joint in its segment; infinity before the first."""
    since = np.full(marks.shape, np.inf)
    for rows in _runs(segment):
        place = np.where(marks[rows], np.arange(rows.start, rows.stop)[:, None], -1)
        last = np.maximum.accumulate(place, axis=0)
        since[rows] = np.where(last >= 0, t[rows, None] - t[last], np.inf)
    return since


def rmse(error: FloatArray, mask: BoolArray) -> FloatArray:
    """Root mean square (n,) of an error (N, n) over the frames of a mask (N, n); NaN where there are none."""
    return np.sqrt(_mean(error**2, mask))


def static_bias(error: FloatArray, regimes: Regimes) -> FloatArray:
    """Mean error (n,) over static frames, with its sign: errors after motion this way and that cancel."""
    return _mean(error, ~regimes.moving & regimes.free[:, None])


def static_drift_per_minute(error: FloatArray, regimes: Regimes) -> FloatArray:
    """How far an error runs away in a minute of rest, whichever way, (n,) [unit/min].

    The slope of each rest is fitted by least squares, its transition left out; the figure is the mean of the slopes'
    sizes, each with the weight that least squares gives it (the spread of its times), so that long rests decide. White
    noise of deviation s alone makes a slope of about 170 s/(T sqrt(N)) a minute in a rest of T seconds and N rows. NaN
    where no rest lasts `SHORTEST_REST`.
    """
    still = ~(regimes.moving | regimes.transition) & regimes.free[:, None] & np.isfinite(error)
    sums = np.zeros((2, error.shape[1]))
    for joint in range(error.shape[1]):
        for rows in rests(regimes, still[:, joint]):
            t, values = regimes.t[rows], error[rows, joint]
            if t[-1] - t[0] < SHORTEST_REST:
                continue
            apart = t - t.mean()
            sums[:, joint] += abs(float(apart @ values)), float(apart @ apart)
    with np.errstate(invalid="ignore"):
        return np.asarray(60.0 * sums[0] / np.where(sums[1] > 0.0, sums[1], np.nan))


def rests(regimes: Regimes, still: BoolArray) -> Iterator[slice]:
    """Yield the runs of rows of one joint in which ``still`` (N,) holds, none of them across a segment's end."""
    for segment in _runs(regimes.segment):
        for run in _runs(still[segment]):
            if still[segment.start + run.start]:
                yield slice(segment.start + run.start, segment.start + run.stop)


def peak(error: FloatArray, free: BoolArray) -> FloatArray:
    """Greatest size of the error (n,) while nobody touches the robot: the deadzone it needs; NaN without such rows."""
    known = np.isfinite(error) & free[:, None]
    greatest: FloatArray = np.where(known, np.abs(error), -np.inf).max(axis=0, initial=-np.inf)
    return np.where(known.any(axis=0), greatest, np.nan)


def error_figures(error: FloatArray, regimes: Regimes) -> dict[str, FloatArray]:
    """Return the figures (n,) of an error (N, n) by the names that result.json gives them.

    Besides those of all frames, ``rmse_known_history`` and ``rmse_unknown_history`` tell frames after a joint's first
    motion in its segment from those before it, at which a method with memory cannot know how the joint came to rest.
    """
    masks = regimes.masks()
    figures = {name: rmse(error, mask) for name, mask in masks.items()}
    figures |= {
        "static_bias": static_bias(error, regimes),
        "static_drift_per_minute": static_drift_per_minute(error, regimes),
        "peak": peak(error, regimes.free),
        "rmse_known_history": rmse(error, masks["rmse"] & regimes.known),
        "rmse_static_known_history": rmse(error, masks["rmse_static"] & regimes.known),
        "rmse_unknown_history": rmse(error, masks["rmse"] & ~regimes.known),
    }
    return figures


def contact_figures(
    regimes: Regimes, touched: BoolArray, told: BoolArray, score: FloatArray, apart: float = 0.5
) -> dict[str, float | int | None]:
    """Judge what a detector told of contacts by the truth.

    Args:
        regimes: of the rows; those that are neither ``free`` nor ``touched`` are not judged.
        touched: rows in which somebody touches the robot, (N,).
        told: rows in which the detector says so, (N,).
        score: how sure it is, in any unit, (N,), from which the AUROC is taken; NaN is not judged.
        apart: alarms less than this [s] from each other are one.

    Returns:
        contacts: number of them.
        missed: contacts during which nothing was told.
        delay_median, delay_p95: time [s] from the beginning of a contact until it is told, of those that are.
        false_alarms_per_hour: alarms that begin while nobody touches the robot, for each hour of that.
        auroc: probability that a row of contact scores higher than one without (Fawcett 2006).
    """
    delays, missed, alarms, seconds = [], 0, 0, 0.0
    for rows in _runs(regimes.segment):
        t = regimes.t[rows]
        for run in _runs(touched[rows]):
            if touched[rows.start + run.start]:
                found = np.flatnonzero(told[rows][run])
                missed += not len(found)
                delays += [float(t[run.start + found[0]] - t[run.start])] if len(found) else []
        alarms += int(np.sum(regimes.free[rows] & _first_after(t, told[rows], apart)))
        steps = np.diff(t, append=t[-1])
        seconds += float(steps[regimes.free[rows]].sum())
    judged = (touched | regimes.free) & np.isfinite(score)
    return {
        "contacts": missed + len(delays),
        "missed": missed,
        "delay_median": float(np.median(delays)) if delays else None,
        "delay_p95": float(np.quantile(delays, 0.95)) if delays else None,
        "false_alarms_per_hour": 3600.0 * alarms / seconds if seconds > 0.0 else None,
        "auroc": auroc(score[judged], touched[judged]),
    }


def auroc(score: FloatArray, positive: BoolArray) -> float | None:
    """Probability that a positive scores higher than a negative, ties counted half; None where one kind is missing.

    It is the Mann-Whitney statistic over the number of pairs (Fawcett 2006, section 7).
    """
    from scipy.stats import rankdata

    count = int(positive.sum())
    others = len(positive) - count
    if count == 0 or others == 0:
        return None
    ranks = float(rankdata(score)[positive].sum())
    return (ranks - 0.5 * count * (count + 1)) / (count * others)


def _first_after(t: FloatArray, told: BoolArray, apart: float) -> BoolArray:
    """Rows (N,) told of, before which nothing was told for ``apart`` [s]."""
    first = np.zeros(len(t), dtype=np.bool_)
    rows = np.flatnonzero(told)
    first[rows] = np.diff(t[rows], prepend=-np.inf) > apart
    return first


def _mean(values: FloatArray, mask: BoolArray) -> FloatArray:
    known = mask & np.isfinite(values)
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _runs(values: BoolArray | IntArray) -> list[slice]:
    """Rows of each run of equal values, in order."""
    edges = np.flatnonzero(values[1:] != values[:-1]) + 1
    bounds = [0, *edges.tolist(), len(values)]
    return [slice(a, b) for a, b in itertools.pairwise(bounds) if b > a]
