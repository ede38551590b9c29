"""Step 7, abstain: names that leave too much are no names, and what is there without a name is said to be."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.effects.base import Effect
from ident.effects.survey import Survey
from ident.gap.abstain import explainable
from ident.gap.bursts import bursts
from ident.gap.constancy import inconstancy
from ident.gap.counts import counted_force
from ident.gap.gate import FAST, MOVING
from ident.gap.joint_gap import JointGap, Named, classes_of, starts_of
from ident.gap.memory import remembered
from ident.gap.nameless import may_have_no_name
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.report import ITS_SIZE, OF_RESTS, Unexplained
from ident.gap.spectrum import spectral_line
from ident.gap.unsure import BEYOND
from ident.gap.wander import wandering

ENOUGH, CERTAIN, SPOTLESS = 5.0, 8.0, 50.0
"""Names of a joint must explain this many times what could still be explained after them; else none is given. Of what
follows the clock alone, which no motion repeats, they must explain the second."""

CONSTANT = (0.025, 0.03, 0.05)
"""Share of what names explain that varying their coefficients may add, where they explain that many times the rest and,
between, by the logarithm of that: the less is left, the less constant they need be."""

SLOW_ROWS = 0.1
"""Share of rows that are no fast motion without which no line is looked for in them alone."""

SEEN, TURNS_SEEN, RESTLESS = 0.03, 0.005, 4.0
"""Share of rows that rest, and motion, must have, and those in which the load changes sides; how many times larger the
mean square must be there than elsewhere for something to happen, whatever it follows."""

AROUND = 0.15
"""Seconds around a row in which the load changes sides that go with it: a link flies through the gap as long."""

TURNS = 0.1
"""Seconds around a row in which a joint is slow or turns that go with it: its friction jumps there."""

MOST, TWICE = 0.5, 2.0
"""Share of what a law means that must be there for its name, and may: of a delay over a span, seconds of that span."""

AT_TURNS, FEW = 0.7, 0.25
"""Share of the squared residual from which on it comes as a joint turns, and of the rows that turns fill at most."""

WORTH_SAYING = 0.06
"""Share of a joint's squared residual that must be explainable for it to be called unexplained."""

BURSTS = 0.15
"""The same of rare bursts: turns of friction that yields by another law than modelled make .09."""


def believed(panel: Panel, survey: Survey, gap: JointGap, named: Sequence[Named]) -> list[Named]:
    """The names of a joint that are constant and the best; none if they leave much of what could be explained."""
    names = [one for one in named if _mostly(panel, gap, one, named) and not may_have_no_name(panel, gap, one, named)]
    while names and (allowed := _allowed(panel, survey, gap, names)) is not None:
        varies = inconstancy(panel, survey, gap, names)
        worst = int(np.argmax(varies))
        if varies[worst] <= allowed:
            return names
        del names[worst]
    return []


def _mostly(panel: Panel, gap: JointGap, one: Named, named: Sequence[Named]) -> bool:
    """Whether most of what a law means is there, as of a current that comes late or passes a filter."""
    return mostly(one.effect, one.trial.shape, lambda: gap.coefficients_of(panel, one, named))


def mostly(effect: Effect, shape: FloatArray, coefficients: Callable[[], FloatArray]) -> bool:
    """Whether most of what a law means is there, and not far more; only if it means coefficients are they asked for."""
    meant = effect.plain(shape)
    if meant is None:
        return True
    found = coefficients()
    return bool(np.all((found > MOST * meant) & (found < TWICE * meant)))


def _allowed(panel: Panel, survey: Survey, gap: JointGap, named: list[Named]) -> float | None:
    """How much names may vary, as a share of what they explain; None where that is not enough to believe any."""
    before, after = gap.problem(panel), gap.problem(panel, [n.trial for n in named])
    left = explainable(panel, survey, gap.joint, after.residual, after.keep).share
    squares = float(after.residual @ after.residual)
    explained = float(before.residual @ before.residual) - squares
    rest = max(left, remembered_of(panel, after, after.residual)) * squares
    if explained < CERTAIN * _wandering(panel, after) * squares or explained < ENOUGH * rest:
        return None
    times = explained / max(rest, 1e-300)
    return float(np.interp(np.log(times), np.log((ENOUGH, CERTAIN, SPOTLESS)), CONSTANT))


def unexplained(
    panel: Panel,
    survey: Survey,
    gap: JointGap,
    named: Sequence[Named],
    doubted: Sequence[Named],
    mistimed: FloatArray,
    held: FloatArray,
) -> list[Unexplained]:
    """What is left on a joint and could be explained by motion, or follows the clock, its own past or its rests alone.

    What names that are not believed explained is there, whatever it is.

    Args:
        panel: the rows.
        survey: facts about the logs.
        gap: the joint's rows.
        named: its names.
        doubted: those that are not believed.
        mistimed: error (N,) by which its dry friction may turn too early or late, by standard deviation.
        held: what its rests that are left out have (N,) beyond what its dry friction may hold.
    """
    problem = gap.problem(panel, [n.trial for n in named])
    left = explainable(panel, survey, gap.joint, problem.residual, problem.keep)
    share = max(left.share, _explained(panel, gap, problem, named, doubted))
    if share > WORTH_SAYING:
        return [Unexplained((gap.joint,), _at_turns(panel, problem, gap.joint, left.depends_on), share)]
    slow = _wandering(panel, problem)
    if slow > WORTH_SAYING:
        return [Unexplained((gap.joint,), ("t (wanders)",), slow)]
    line = _line(panel, problem, gap.joint)
    if line is not None and line[1] > max(WORTH_SAYING, _feigned(panel, survey, problem, gap.joint)):
        return [Unexplained((gap.joint,), (f"t ({line[0]:.2g} Hz)",), line[1])]
    squares = np.maximum(problem.residual**2 - (BEYOND * mistimed[problem.keep]) ** 2, 0.0)
    uneven = _uneven(panel, problem, gap.joint, squares)
    if uneven is not None:
        return [Unexplained((gap.joint,), (uneven[0] + ITS_SIZE,), uneven[1])]
    rare = bursts(squares, starts_of(panel, problem), panel.step)
    if rare > BURSTS:
        return [Unexplained((gap.joint,), ("t (in bursts)",), rare)]
    past = remembered_of(panel, problem, problem.residual)
    if past > WORTH_SAYING:
        return [Unexplained((gap.joint,), ("t (its own past)",), past)]
    squares_held = float(held @ held)
    at_rest = squares_held / max(squares_held + float(problem.residual @ problem.residual), 1e-300)
    signals = (f"dq{gap.joint + 1}{OF_RESTS}",)
    return [Unexplained((gap.joint,), signals, at_rest)] if at_rest > WORTH_SAYING else []


def _at_turns(panel: Panel, problem: JointProblem, joint: int, depends_on: tuple[str, ...]) -> tuple[str, ...]:
    """Signals that a residual depends on, its joint's direction first if next to all of it comes as that changes."""
    side = f"sign(dq{joint + 1})"
    jumps, squares = _jumps(panel, problem, joint), problem.residual**2
    if jumps.mean() > FEW or squares[jumps].sum() < AT_TURNS * squares.sum():
        return depends_on
    return (f"{side} (as it turns)", *(signal for signal in depends_on if signal != side))


def _jumps(panel: Panel, problem: JointProblem, joint: int) -> BoolArray:
    """A problem's rows in which its joint's friction may jump: it turns, comes to rest or sets out."""
    sides = np.sign(panel.velocity[:, joint])
    sides[problem.keep[classes_of(panel, problem, joint) < MOVING]] = 0.0  # a side of its own
    return panel.turns(sides, TURNS)[problem.keep]


def _explained(
    panel: Panel, gap: JointGap, problem: JointProblem, named: Sequence[Named], doubted: Sequence[Named]
) -> float:
    """Share of a problem's squared residual that further effects explain."""
    if not doubted:
        return 0.0
    left = gap.problem(panel, [n.trial for n in (*named, *doubted)]).residual
    return 1.0 - float(left @ left) / max(float(problem.residual @ problem.residual), 1e-300)


def _line(panel: Panel, problem: JointProblem, joint: int) -> tuple[float, float] | None:
    """Frequency [Hz] and share of a line in what is left, or in what is left while the joint is not fast."""
    still = classes_of(panel, problem, joint) < FAST
    for rows in (np.ones(len(problem), dtype=bool), still):
        if rows.mean() > SLOW_ROWS:
            # Rows that are left out keep their place in time.
            left = np.zeros(len(panel))
            left[problem.keep] = problem.residual * rows
            line = spectral_line(left, panel.start, panel.step)
            if line is not None:
                return line
    return None


def _feigned(panel: Panel, survey: Survey, problem: JointProblem, joint: int) -> float:
    """Share of a problem's squared residual that a line may have which the encoder's counts feign."""
    return 0.5 * counted_force(panel, survey, joint) ** 2 / max(float(np.mean(problem.residual**2)), 1e-300)


def _uneven(panel: Panel, problem: JointProblem, joint: int, squares: FloatArray) -> tuple[str, float] | None:
    """What the size of the residual follows, and the share of its squares (N,) by which they are larger there.

    That is slow motion, a load about to change sides, as where gears have play, or fast motion, as of rough bearings;
    None unless it is far more there.
    """
    pace = classes_of(panel, problem, joint)
    slow = pace < MOVING
    turns = panel.turns(np.sign(panel.seen("load")[:, joint]), AROUND)[problem.keep]
    jumps = _jumps(panel, problem, joint)
    everything = np.ones(len(squares), dtype=bool)
    # Where a joint's load is nought unless it moves, the load turns as the joint rests.
    asked = (
        (slow, everything, SEEN, f"|dq{joint + 1}|"),
        (turns, ~(slow | jumps), TURNS_SEEN, f"load{joint + 1}"),
        (pace >= FAST, everything, SEEN, f"dq{joint + 1}^2"),
    )
    for rows, among, seen, signal in asked:
        there, elsewhere = squares[rows & among], squares[~rows & among]
        shown = min(len(there), len(elsewhere)) >= max(seen * len(squares), 1.0)
        if shown and there.mean() >= RESTLESS * elsewhere.mean():
            excess = len(there) * (there.mean() - elsewhere.mean())
            return signal, float(excess / max(squares.sum(), 1e-300))
    return None


def remembered_of(panel: Panel, problem: JointProblem, left: FloatArray) -> float:
    """Share of the square of what is left (N,) in a problem's rows that its neighbours in time predict."""
    return remembered(left, starts_of(panel, problem), panel.step, panel.model.cutoff)


def _wandering(panel: Panel, problem: JointProblem) -> float:
    return wandering(problem.residual, starts_of(panel, problem), panel.step)
