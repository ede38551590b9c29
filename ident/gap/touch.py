"""Contact, taken out before anything is named: bursts of the residual that no motion predicts."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, label

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.effects.survey import Survey
from ident.gap.abstain import explainable
from ident.gap.belief import WORTH_SAYING
from ident.gap.candidates import Trial
from ident.gap.gate import MOVING, speed_classes
from ident.gap.joint_gap import JointGap
from ident.gap.moving_average import moving_average
from ident.gap.panel import Panel
from ident.log import LogSource, WithoutStretches

SMOOTH, SHORTEST, MARGIN = 0.2, 0.25, 0.3
"""Seconds over which the residual is averaged, that a touch lasts at least, and that are left out around it."""

HEIGHT = 8.0
"""A touch stands out from the averaged residual by this many of its usual deviations, also from those in motion."""

FAINT, TOGETHER = 4.0, 2
"""Beside a touch that so many joints feel at once, what stands out by so many deviations on its joints, or on as many,
is a faint one: it would else be what the others do not stand out from."""

BEYOND_NAMES = 2.0
"""And by this many times the RMS of what is named on the joint, whose law may be as wrong in places."""

CLEAR = 2.0
"""The largest touch, on one of its joints, is so many times larger than anything else there is: else a law unknown may
make both."""

STILL = 3.0
"""A joint slower than this many times the speed over which its sign of velocity turns may stand: its dry friction then
takes up whatever is smaller than itself, and that is no touch unless another joint shows it that does not stand, or it
comes and goes while both stand: what friction holds stays until the joint moves on."""

SETTLED, STIRS = 1e-2, 1e-3
"""Displacements from where a log begins over which a joint's friction remembers what came before it, which no log
tells, and which a joint that is held and pushed does not give way by."""

RAREST = 0.25
"""Touches fill at most this share of the time, and half of the motion; what is there more often is no touch."""

PASSES, AGAIN, MOSTLY = 3, 0.25, 0.5
"""Other passes through where a joint was touched that must be known; what is there again on either side, in this share
of its size, in so many of them is the joint's own (a worn tooth): no touch comes back with an angle."""

RINGS = 4
"""Times that what looks like a touch changes sides, one soon after the other, from which on it rings untouched."""

BENT, STRETCHES = 0.25, 4.0
"""Share of the usual averaged residual that is left without touches where they had bent the model; stretches as long
as the averaging that must be left for every column. Without touches it is .93 and more; .39 in 19 s of log."""

STEPS = 5
"""Times that rows are chosen anew to which touches add nothing; more change nothing."""


@dataclass(frozen=True, eq=False)
class Touches:
    """Episodes of contact.

    Attributes:
        rows: which rows (N,) belong to one or its margin.
        joints: joints, from 0, whose residual shows it.
        seconds: how long they last in all.
        episodes: how many there are.
    """

    rows: BoolArray
    joints: tuple[int, ...]
    seconds: float
    episodes: int

    def cut(self, panel: Panel, sources: Sequence[LogSource]) -> list[LogSource]:
        """The logs without the episodes and their margins; logs of one name lose the same."""
        stretches: dict[str, list[tuple[int, float, float]]] = {}
        t = panel.gather(lambda block: block.log.t)
        number = np.repeat(np.arange(len(panel.rows)), [len(rows) for rows in panel.rows])
        for _, first, end in _pieces(self.rows[:, None], np.append(panel.start, len(panel))):
            log = panel.blocks[number[first]].log
            stretches.setdefault(log.name, []).append((int(log.segment[0]), float(t[first]), float(t[end - 1])))
        return [WithoutStretches(s, tuple(stretches[s.name])) if s.name in stretches else s for s in sources]


def undisturbed(gap: JointGap, panel: Panel, named: Sequence[Trial] = ()) -> FloatArray:
    """What a joint's columns leave in all rows (N,), fitted to those in which it is least, if touches had bent them.

    Least trimmed squares by concentration steps (Rousseeuw and Van Driessen 2006), the averaged residual being trimmed.
    Touches had bent them if most rows are left with less than a quarter of what fitting all of them leaves. A log so
    short that any rows could be fitted is not asked. Rows that do not count and of which those that do tell nothing, as
    where other joints move while this one rests, are left with nought.
    """
    left = plain = gap.everywhere(panel, named)
    told = gap.keep | (gap.leverage(panel, named, gap.keep) <= 1.0)
    stretches = (1.0 - RAREST) * gap.keep.sum() * panel.step / SMOOTH
    if stretches < STRETCHES * max(1, gap.matrix.shape[1] + len(named)):
        return np.where(told, plain, 0.0)
    for _ in range(STEPS):
        size = np.abs(_averaged(panel, left))
        kept = gap.keep & (size <= np.quantile(size[gap.keep], 1.0 - RAREST))
        kept |= gap.keep & (gap.leverage(panel, named, kept) > 1.0)
        left = gap.everywhere(panel, named, kept)
    usual, bent = (np.median(np.abs(_averaged(panel, x))[gap.keep]) for x in (left, plain))
    return np.where(told, left if usual < BENT * bent else plain, 0.0)


def unpredicted_touches(panel: Panel, survey: Survey, residuals: FloatArray, named: FloatArray) -> Touches:
    """Find contact as `find_touches` does, but for bursts that the motion predicts: those are effects not named.

    Unless it is touches that other joints show which are predicted: they may come where the robot is alike.
    """
    found = find_touches(panel, survey, residuals, named)
    predicted = _predicted(panel, survey, residuals, found.joints, np.ones(len(panel), dtype=bool))
    if not predicted:
        return found
    found = find_touches(panel, survey, _without(residuals, predicted), named)
    if not found.episodes:
        return found
    elsewhere = _predicted(panel, survey, residuals, predicted, ~found.rows)
    if elsewhere == predicted:
        return found
    return find_touches(panel, survey, _without(residuals, elsewhere), named)


def _predicted(
    panel: Panel, survey: Survey, residuals: FloatArray, joints: Sequence[int], rows: BoolArray
) -> list[int]:
    """Those of some joints whose residuals (N, n) the motion predicts in some rows (N,)."""
    kept = np.flatnonzero(rows)
    shares = {j: explainable(panel, survey, j, residuals[kept, j], kept).share for j in joints}
    return [j for j, share in shares.items() if share >= WORTH_SAYING]


def _without(residuals: FloatArray, joints: Sequence[int]) -> FloatArray:
    """Residuals (N, n) of which those of some joints are not known."""
    left = residuals.copy()
    left[:, joints] = 0.0
    return left


def find_touches(panel: Panel, survey: Survey, residuals: FloatArray, named: FloatArray) -> Touches:
    """Find contact in the residuals (N, n) that are left when all that could be named, (N, n), is taken away."""
    step = panel.step
    touched = np.zeros(residuals.shape, dtype=bool)
    edges = np.append(panel.start, len(panel))
    averaged = _averaged(panel, residuals)
    usual = 1.4826 * np.stack(
        [_usual(panel, averaged[:, j], residuals[:, j] != 0.0, j) for j in range(averaged.shape[1])], axis=1
    )
    least = np.maximum(HEIGHT * usual, BEYOND_NAMES * np.sqrt(np.mean(named**2, axis=0)))
    still = np.abs(panel.velocity) < STILL * survey.smoothing
    high = np.abs(averaged) > np.maximum(least, 1e-300)
    sure = np.abs(averaged) > least + still * survey.holds
    shortest, margin = max(2, round(SHORTEST / step)), max(1, round(MARGIN / step))
    bursts = _lasting(high, edges, shortest)
    surely = np.zeros_like(bursts)
    for j, a, b in _pieces(bursts, edges):
        surely[a:b, j] = sure[a:b, j].mean() > 0.5
    for j, a, b in _pieces(bursts, edges):
        others = (bursts if _stands_on(still[:, j], edges, a, b, margin) else surely)[a:b]
        touched[a:b, j] = (surely[a:b, j] | np.delete(others, j, axis=1).any(axis=1)).mean() > 0.5
    position = panel.motion.q
    for j, a, b in list(_pieces(touched, edges)):
        free = (residuals[:, j] != 0.0) & ~still[:, j]
        if _begins(position[:, j], edges, a, b, margin) or _comes_back(
            position[:, j], residuals[:, j], free, edges, a, b
        ):
            touched[a:b, j] = False
    for j, a, b in _ringing(np.abs(averaged) > 0.5 * least, averaged, edges, margin):
        touched[a:b, j] = False
    touched |= _faint(averaged, usual, touched, edges, shortest)
    share = touched.mean(axis=0)
    touched[:, share > RAREST] = False
    rows = panel.around(np.asarray(touched.any(axis=1)), MARGIN)
    size = np.abs(averaged)
    if not np.any(size.max(axis=0, where=touched, initial=0.0) > CLEAR * size[~rows].max(axis=0, initial=0.0)):
        touched[:], rows = False, np.zeros_like(rows)
    any_joint = touched.any(axis=1)
    episodes = sum(1 for _ in _pieces(rows[:, None], edges))
    joints = tuple(int(j) for j in np.flatnonzero(touched.any(axis=0)))
    return Touches(rows, joints, float(any_joint.sum() * step), episodes)


def _faint(averaged: FloatArray, usual: FloatArray, touched: BoolArray, edges: IntArray, shortest: int) -> BoolArray:
    """Rows (N, n) in which joints stand out less than a touch must, beside touches of several joints."""
    if not np.any(touched.sum(axis=1) >= TOGETHER):
        return np.zeros_like(touched)
    bursts = _lasting(np.abs(averaged) > FAINT * usual, edges, shortest)
    several = bursts.sum(axis=1, keepdims=True) >= TOGETHER
    return np.asarray(bursts & (several | touched.any(axis=0)), dtype=bool)


def _lasting(marked: BoolArray, edges: IntArray, shortest: int) -> BoolArray:
    """Marked rows (N, n) of stretches of so many rows at least."""
    bursts = np.zeros_like(marked)
    for j, a, b in _pieces(marked, edges):
        bursts[a:b, j] = b - a >= shortest
    return bursts


def _averaged(panel: Panel, residuals: FloatArray) -> FloatArray:
    """Residuals (N, ...) averaged over a little time, within each block."""
    return moving_average(residuals, panel.start, max(1, round(SMOOTH / panel.step)))


def _pieces(marked: BoolArray, edges: IntArray) -> Iterator[tuple[int, int, int]]:
    """Yield the joint, the first row and the end of every stretch of marked rows (N, n) between edges."""
    for j in range(marked.shape[1]):
        for first, end in itertools.pairwise(edges.tolist()):
            for (rows,) in find_objects(label(marked[first:end, j])[0]):
                yield j, first + rows.start, first + rows.stop


def _stands_on(still: BoolArray, edges: IntArray, first: int, end: int, margin: int) -> bool:
    """Whether a joint that stands in some rows (N,) does so between two rows, and that many before and after them."""
    block = int(np.searchsorted(edges, first, side="right")) - 1
    start, stop = int(edges[block]), int(edges[block + 1])
    return bool(still[max(first - margin, start) : min(end + margin, stop)].all())


def _begins(position: FloatArray, edges: IntArray, first: int, end: int, margin: int) -> bool:
    """Whether a joint, at positions (N,), sets out between two rows from where a log begins, or stood there from then.

    Args:
        position: the joint's.
        edges: rows with which blocks begin and end.
        first: the first of the rows.
        end: the end of them.
        margin: rows around them in which it may set out.
    """
    block = int(np.searchsorted(edges, first, side="right")) - 1
    start, stop = int(edges[block]), int(edges[block + 1])
    gone = np.abs(position[start : min(end + margin, stop)] - position[start])
    return bool(gone[: end - start].max() < SETTLED and (first - start <= margin or gone.max() > STIRS))


def _comes_back(
    position: FloatArray, residual: FloatArray, moving: BoolArray, edges: IntArray, first: int, end: int
) -> bool:
    """Whether a joint's residual (N,) between two rows is there again whenever it moves through those positions (N,).

    A joint that stands passes through none, and is not asked.

    Args:
        position: the joint's.
        residual: the joint's.
        moving: rows (N,) that are known and in which it moves.
        edges: rows with which blocks begin and end.
        first: the first of the rows.
        end: the end of them.
    """
    signed = residual[first:end] * np.sign(residual[first:end].mean())
    # The averaging drags its ends out.
    own = first + np.flatnonzero(signed >= signed.mean())
    if moving[own].mean() <= 0.5:
        return False
    inside = moving & (position >= position[own].min()) & (position <= position[own].max())
    inside[first:end] = False
    passes = np.array([abs(residual[a:b].mean()) for _, a, b in _pieces(inside[:, None], edges)])
    return len(passes) >= PASSES and float(np.mean(passes > AGAIN * abs(residual[own].mean()))) >= MOSTLY


def _ringing(large: BoolArray, averaged: FloatArray, edges: IntArray, margin: int) -> Iterator[tuple[int, int, int]]:
    """Yield joint, first row and end of stretches in which large residuals (N, n) change sides time after time."""
    runs: list[list[tuple[int, int, int]]] = []
    side, last = 0.0, (-1, 0, 0)
    for one in _pieces(large, edges):
        joint, first, end = one
        before, side = side, float(np.sign(averaged[first:end, joint].sum()))
        if joint == last[0] and 0 <= first - last[2] <= margin and side == -before:
            runs[-1].append(one)
        else:
            runs.append([one])
        last = one
    for run in runs:
        if len(run) > RINGS:
            yield run[0][0], run[0][1], run[-1][2]


def _usual(panel: Panel, averaged: FloatArray, known: BoolArray, joint: int) -> FloatArray:
    """Median size (N,) of an averaged residual (N,) where it is known, in motion that of motion where it is the larger.

    Rows that are left out have a residual of nought, and may be most of them.
    """
    size = np.abs(averaged)
    usual = np.full(len(size), np.median(size[known]) if known.any() else 0.0)
    moving = speed_classes(np.abs(panel.velocity[:, joint])) >= MOVING
    if moving.any():
        usual[moving] = max(usual[0], float(np.median(size[moving])))
    return usual
