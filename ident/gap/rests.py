"""Rests of joints that stick: while a joint stands, its dry friction holds whatever current the drive happens to give.

Within plus and minus its Coulomb friction that current says nothing of links, drives or effects: least squares that are
given such rows bend to them. They are left out, unless something that the model could learn explains them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import label

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.coupling import Coupling
from ident.effects.hysteresis import LEAST_SLIP, MaxwellSlip
from ident.effects.survey import Survey
from ident.effects.timing import Timing
from ident.gap.candidates import Trial, admissible, best_start, coefficients, forms, refine
from ident.gap.joint_gap import JointGap
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.rows import gap_of, panel_of, survey_of
from ident.gap.spectrum import spectral_line
from ident.gap.standing import of_motors, stands
from ident.gap.threads import in_threads
from ident.gap.unsure import shaken, turning
from ident.log import LogSource
from ident.model import CurrentModel
from ident.walk import Block

STANDS, OF_MEAN = 5e-3, 0.05
"""A joint slower than this [rad/s or m/s], and than this share of its mean speed, stands."""

AROUND = 1.0
"""Periods of the cut-off around a rest that go with it: derived velocities are smoothed, and turn too early or late."""

RESTS, MOVES = 0.02, 0.03
"""Share of the rows that must be rests for them to be looked at, and motion for it to tell what is usual."""

STILL, MOSTLY = 0.25, 0.4
"""A joint that sticks is slower than this share of the speed below which it stands in that share of its slow rows; one
that turns round passes through them, and is as often at each speed."""

STICKS = 9.0
"""A joint sticks if its mean square is this many times larger in rests than in motion, that motion being fitted."""

BESIDE = 2.0
"""So many times will do for one whose friction builds up over a displacement: that should have told its rests."""

SHAKEN = 2.0
"""And larger by this many times what noise of the velocity makes of its dry friction there."""

TOGETHER = (0.3, 2.0)
"""Where this share of the joints sticks, so many times will do for the others: what they lack in motion hides their
rests."""

ALL = 0.75
"""Where this share of the joints that may stick do, all do: what one lacks in motion may look like what it holds."""

HELD = 2.0
"""Dry friction holds this many times its force in motion at most, as joints break away."""

RATTLES, QUIETER, SEEN = 2.0, 0.25, 20
"""What dry friction holds is quiet: its noise is at most this many times that in motion, told by a quarter of rows; by
those in which the joint is slow, if they are so many: the others of a short rest are of how it stops and starts."""

SWINGS, HUNTS, PERIODS = 0.7, 0.15, 2.0
"""Where a drive hunts, share of what rests hold that is not the mean of each, share of that in one line, and periods of
that line in a rest: with fewer the line tells how long rests last."""

EXPLAINED = 0.9
"""Share of the rests' squares that an effect must explain for them to tell of it."""

LATE = 0.6
"""Share of them that will do for a current that comes late (.69 to .85 of those of a delay of 15 ms, whose sign of
velocity was chosen wide to blur it): what friction holds is there at once, and looks early if anything.
"""

SEVERAL = 4.0
"""Rests without which none of them is told of: one level is explained by anything."""

TELLING = ("hysteresis", "rigid-body", "friction", "timing")
"""Families of effects that may act on a joint that stands; ripples fit whatever a few poses hold."""


@dataclass(frozen=True, eq=False)
class Rests:
    """Which joints stick, and when.

    Attributes:
        sticks: joints (n,) whose dry friction holds them while they stand.
        may: joints (n,) that stand and move enough for it to be asked whether they stick.
        slow: speed (n,) below which a joint stands.
        most: force (n,) that its dry friction holds at most.
        around: seconds around a rest that go with it.
        coupling: of the motors, which stand when friction holds.
    """

    sticks: BoolArray
    may: BoolArray
    slow: FloatArray
    most: FloatArray
    around: float
    coupling: Coupling | None = None

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints, from 0, that stick."""
        return tuple(np.flatnonzero(self.sticks).tolist())

    def also(self, joints: Sequence[int]) -> Rests:
        """The same with those of further joints, from 0, that may stick."""
        sticks = self.sticks.copy()
        sticks[list(joints)] = True
        return replace(self, sticks=sticks & self.may)

    def without(self, joints: Sequence[int]) -> Rests:
        """The same without those of some joints, from 0."""
        sticks = self.sticks.copy()
        sticks[list(joints)] = False
        return replace(self, sticks=sticks)

    def counts(self, block: Block) -> BoolArray:
        """Whether each joint's row of a block (N, n) counts."""
        return ~stands(of_motors(block, self.coupling), np.where(self.sticks, self.slow, 0.0), self.around)

    def beyond(self, joint: int, left: FloatArray) -> FloatArray:
        """The part of a resting joint's residuals (M,) that its dry friction cannot hold."""
        return np.asarray(np.sign(left) * np.maximum(np.abs(left) - self.most[joint], 0.0))


def no_rests(n: int) -> Rests:
    """No joint sticks."""
    nobody = np.zeros(n, dtype=bool)
    return Rests(nobody, nobody, np.zeros(n), np.zeros(n), 0.0)


def find_rests(model: CurrentModel, sources: Sequence[LogSource]) -> Rests:
    """Find the joints that stick in logs, given a plain model of them.

    Args:
        model: links, rotors, offsets, Coulomb and viscous friction, fitted to the logs.
        sources: the logs.
    """
    panel = panel_of(model, sources)
    return rests_of(model, panel, survey_of(model, panel))


def rests_of(model: CurrentModel, panel: Panel, survey: Survey) -> Rests:
    """Find the joints that stick, the model's columns being fitted again: what has changed would hide what is held."""
    gaps = [gap_of(model, panel, j) for j in range(model.n)]
    speed = np.minimum(STANDS, OF_MEAN * survey.pace)
    around = AROUND / model.cutoff
    coupling = model.robot.coupling
    rests = panel.gather(lambda block: stands(of_motors(block, coupling), speed, around))
    noise = noise_at_turns(model, panel, survey)
    pace = panel.gather(lambda block: np.abs(of_motors(block, coupling).motion.dq))
    slow = pace < speed
    stops = (pace < STILL * speed).sum(axis=0) > MOSTLY * slow.sum(axis=0)
    share = rests.mean(axis=0)
    may = stops & (share >= RESTS) & (share <= 1.0 - MOVES)

    def sticking(gap: JointGap, times: float) -> bool:
        j = gap.joint
        return bool(may[j]) and _sticks(panel, survey, gap, rests[:, j], slow[:, j], noise[:, j], times)

    yields = survey.presliding > 0.0
    sticks = in_company(sticking, gaps, np.where(yields, BESIDE, STICKS), yields)
    everyone = np.sum(sticks) >= ALL * may.sum()
    return Rests(may if everyone else sticks, may, speed, HELD * survey.holds, around, coupling)


def noise_at_turns(model: CurrentModel, panel: Panel, survey: Survey) -> FloatArray:
    """Error (N, n) that noise makes of dry friction, by standard deviation, where its direction turns."""
    # Where a joint starts and stops the filter's smear looks like noise, but there its sign no longer turns.
    return np.where(turning(panel, survey), np.minimum(shaken(model, panel, survey), survey.holds), 0.0)


def in_company(
    asks: Callable[[JointGap, float], bool],
    gaps: Sequence[JointGap],
    times: FloatArray,
    known: BoolArray,
) -> BoolArray:
    """Joints (n,) of which it is true with so many times (n,), or with fewer where it is of several or known (n,)."""
    found = in_threads(lambda gap: asks(gap, float(times[gap.joint])), gaps)
    if np.mean(np.logical_or(found, known)) >= TOGETHER[0]:
        found = in_threads(lambda gap: found[gap.joint] or asks(gap, TOGETHER[1]), gaps)
    return np.array(found, dtype=bool)


def _sticks(
    panel: Panel, survey: Survey, gap: JointGap, rest: BoolArray, slow: BoolArray, noise: FloatArray, times: float
) -> bool:
    left = gap.without(rest).everywhere(panel)
    usual, held, by_noise = contrast(left, rest, noise)
    if not holds(usual, held, by_noise, times, float(survey.holds[gap.joint])):
        return False
    if _rattles(panel.force[:, gap.joint], left, rest, slow) or _hunts(panel, left, rest):
        return False
    return not _told(panel, survey, gap, rest, usual, by_noise)


def contrast(left: FloatArray, rest: BoolArray, noise: FloatArray) -> tuple[float, float, float]:
    """Mean squares of what is left (N,) in motion, in rests, and of what noise (N,) makes there."""
    return float(np.mean(left[~rest] ** 2)), float(np.mean(left[rest] ** 2)), float(np.mean(noise[rest] ** 2))


def holds(usual: float, held: float, by_noise: float, times: float, dry: float) -> bool:
    """Whether rows hold so many times what is usual, beyond noise, and no more than dry friction could."""
    return times * usual + SHAKEN * by_noise <= held <= (HELD * dry) ** 2 + usual


def _rattles(force: FloatArray, left: FloatArray, rest: BoolArray, slow: BoolArray) -> bool:
    """Whether rests are noisier than motion, by the quieter rows: where a joint turns round its force jumps."""

    def noise(values: FloatArray, rows: BoolArray) -> float:
        return float(np.quantile(np.abs(np.diff(values, 2))[rows], QUIETER)) if rows.any() else 0.0

    still = _inside(rest & slow)
    # The model's own sign of velocity flickers at rest; in motion the force's own slope would count as noise.
    held = noise(force, still if still.sum() >= SEEN else _inside(rest))
    return held > RATTLES * noise(left, _inside(~rest))


def _inside(rows: BoolArray) -> BoolArray:
    """Rows (N - 2,) whose neighbours are among those rows (N,), too."""
    return rows[2:] & rows[1:-1] & rows[:-2]


def _hunts(panel: Panel, left: FloatArray, rest: BoolArray) -> bool:
    """Whether most of what rests hold swings about their means, at one frequency: a drive that hunts does."""
    number = _numbered(panel, rest)
    swings = np.where(rest, left - _levels(left, number), 0.0)
    if np.mean(swings[rest] ** 2) < SWINGS * np.mean(left[rest] ** 2):
        return False
    step = panel.step
    line = spectral_line(swings, panel.start, step)
    if line is None or line[1] <= HUNTS:
        return False
    lasts_for = step * np.average(np.bincount(number)[number], weights=swings**2)
    return bool(line[0] * lasts_for >= PERIODS)


def _levels(left: FloatArray, number: IntArray) -> FloatArray:
    """The mean of what is left (N,) in the rest of that number (N,) that each row is of; of all motion for nought."""
    level: FloatArray = np.bincount(number, left) / np.maximum(np.bincount(number), 1)
    return level[number]


def _numbered(panel: Panel, rest: BoolArray) -> IntArray:
    """Number of the rest (N,) that each row is of, from one; nought in motion."""
    pieces, _ = label(rest)
    # The rests at the end of one block and at the beginning of the next are two.
    begun = np.zeros(len(rest), dtype=np.int64)
    begun[panel.start] = 1
    return np.asarray(np.where(rest, pieces + np.cumsum(begun), 0), dtype=np.int64)


def _told(panel: Panel, survey: Survey, gap: JointGap, rest: BoolArray, usual: float, by_noise: float) -> bool:
    """Whether an effect explains most of what the mean square of a joint's rests is above what is usual in motion.

    What noise of the velocity makes there nothing explains; it is no more than half of it, if anything is held.
    """
    problem = gap.problem(panel)
    held = float(np.mean(problem.residual[rest] ** 2))
    if held <= usual or occasions(panel, problem.residual, rest) < SEVERAL:
        return False  # links bend to few rests until nothing is left of them, and any effect explains one
    noise = min(usual + by_noise, 0.5 * (usual + held))
    ranked = told_by(panel, survey, gap, problem, rest)
    for place, (left, start) in enumerate(ranked):
        share = LATE if isinstance(start.effect, Timing) else EXPLAINED
        least = share * noise + (1.0 - share) * held
        # The best start may be a little off, and the shortest displacement that is begun with is no shortest yet.
        if place > 0 and left >= least:
            continue
        searched = place == 0 or start.effect.family == "hysteresis"
        found = refine(panel, problem, [start], gap.joint) if searched else start
        enough = left < least or _tells(panel, problem, found, gap.joint, rest, least)
        if enough and not slipless(panel, gap, found) and not _early(panel, problem, found, gap.joint):
            return True
    return False


def _tells(panel: Panel, problem: JointProblem, trial: Trial, joint: int, rest: BoolArray, least: float) -> bool:
    """Whether a trial leaves less than that mean square in rests, or explains the mean of each.

    Noise that shakes the sign of velocity leaves little in the means.
    """
    left = problem.left(admissible(panel, problem, trial.effect, trial.shape, joint))
    if np.mean(left[rest] ** 2) < least:
        return True
    number = _numbered(panel, rest)
    before, after = (float(np.mean(_levels(r, number)[rest] ** 2)) for r in (problem.residual, left))
    return after <= (1.0 - EXPLAINED) * before


def _early(panel: Panel, problem: JointProblem, trial: Trial, joint: int) -> bool:
    """Whether this is a current that would come before its time."""
    if not isinstance(trial.effect, Timing):
        return False
    return trial.effect.lateness(trial.shape, coefficients(panel, problem, trial, joint)) < 0.0


def told_by(
    panel: Panel, survey: Survey, gap: JointGap, problem: JointProblem, rest: BoolArray
) -> list[tuple[float, Trial]]:
    """Laws that may act on a joint that stands, at their best starts, by what they leave in its rests."""
    effects = [effect for effect in forms(survey, gap.joint, gap.present) if effect.family in TELLING]
    starts = [best_start(panel, problem, effect, gap.joint) for effect in effects]
    return sorted(((left_in(panel, problem, one, gap.joint, rest), one) for one in starts), key=lambda pair: pair[0])


def left_in(panel: Panel, problem: JointProblem, trial: Trial, joint: int, rest: BoolArray) -> float:
    """Mean square that a trial leaves in rests."""
    columns = admissible(panel, problem, trial.effect, trial.shape, joint)
    return float(np.mean(problem.left(columns)[rest] ** 2))


def occasions(panel: Panel, left: FloatArray, rest: BoolArray) -> float:
    """How many rests there are, by what they leave: one that lasts for most of the logs counts for all."""
    squares = np.bincount(_numbered(panel, rest)[rest], left[rest] ** 2)
    return float(squares.sum() ** 2 / max(float(squares @ squares), 1e-300))


def slipless(panel: Panel, gap: JointGap, trial: Trial, besides: Sequence[Trial] = ()) -> bool:
    """Whether this, besides others, is hysteresis over no displacement of its own, or none that the encoder shows.

    Then dry friction sticks.
    """
    if not isinstance(trial.effect, MaxwellSlip) or trial.effect.joint != gap.joint:
        return False
    found = coefficients(panel, gap.problem(panel, besides), trial, gap.joint)
    return trial.effect.mean_slip(trial.shape, found) < max(LEAST_SLIP, float(panel.least_seen[gap.joint]))
