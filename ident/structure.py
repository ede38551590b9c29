"""Which friction terms a robot needs: chosen by logs that were held out, never by the training error."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.design import Counts, Design, Seen
from ident.effects.base import Effect, initial_term
from ident.effects.direction import DirectedEffect, VelocityEffect
from ident.effects.friction import CoulombAsymmetry, LoadFriction
from ident.effects.friction_curve import Sigmoid, Stribeck, ViscousNonlinear
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import CableSpring
from ident.effects.ripple import GearRipple
from ident.effects.transmission import CrossJointFriction
from ident.fit import Drives, settle, solved_model
from ident.least_squares import Factors, factorise, solve, triangle
from ident.log import LogSource
from ident.robot import Robot
from ident.shapes import optimise_shapes
from ident.signals import zero_phase
from ident.walk import Block, collect, kept_rows, slowest_rate, thin

HELD_ROWS, SEARCH_ROWS = 24_000, 6_000
"""Rows that are walked, and those of them at most on which structures are compared."""

GAIN = 0.01
"""A term must lower the held-out RMS residual of its joint by this share, on average over the folds, and on each."""

QUIET = 4.0
"""Current is compared up to this many times the cut-off of the motion."""

REST_SPEED, RESTS = 5e-3, 0.1
"""A joint slower than this [rad/s or m/s] stands still; it is seen at rest if it does so in this share of the rows."""

ROUNDS = 5
FOLDS = 3


@dataclass(frozen=True)
class Choice:
    """The best term tried on a joint: the share by which it lowers the held-out RMS residual, and whether it stays."""

    joint: int
    effect: str
    gain: float
    worst_fold: float
    taken: bool


@dataclass(frozen=True)
class Structure:
    """The effects chosen and what was tried on the way, in order; ``folds`` says what was held out."""

    effects: tuple[Effect, ...]
    choices: tuple[Choice, ...]
    folds: str


@dataclass(frozen=True)
class Fold:
    """Rows to learn from and rows to judge by."""

    train: list[Block]
    held_out: list[Block]


def choose_structure(
    robot: Robot,
    baseline: Sequence[Effect],
    sources: Sequence[LogSource],
    cutoff: float,
    drives: Drives,
    progress: Callable[[float], None] | None = None,
    counts: Counts | None = None,
) -> Structure:
    """Add friction effects to a baseline, joint by joint, as long as held-out rows are predicted better.

    With three logs or more, logs are held out in turn, with fewer, parts of them. In each round every joint tries every
    candidate with all linear parameters refitted, and takes the best one if it lowers the held-out residual by more
    than ``GAIN`` on average and does not raise it on any fold. A joint that takes nothing is done.

    Args:
        robot: the robot.
        baseline: effects to begin with.
        sources: logs.
        cutoff: cut-off [Hz] of the filter that derives velocity and acceleration.
        drives: force unit per unit of current.
        progress: called with the share of the work done.
        counts: which joints' rows are learnt from and judged by; all where not given.
    """
    blocks = [_quiet(block, cutoff) for block in thin(collect(sources, cutoff, HELD_ROWS), SEARCH_ROWS)]
    if not any(block.keep.any() for block in blocks):
        return Structure(tuple(baseline), (), "nothing: the logs are too short")
    folds, described = make_folds(blocks)
    effects = list(baseline)
    choices: list[Choice] = []
    open_joints = list(range(robot.n))
    plain = Design(robot, (), drives.gain, counts=counts)
    resting = _rest_share(plain, blocks) > RESTS
    for number in range(ROUNDS):
        design = replace(plain, terms=tuple(initial_term(effect) for effect in effects))
        fits = [_Held.of(design, fold, cutoff, drives) for fold in folds]
        grown = Parallel(n_jobs=-1, prefer="threads")(
            delayed(_grow)(robot, effects, j, fits, bool(resting[j])) for j in open_joints
        )
        open_joints = []
        for joint, (own, choice) in [found for found in grown if found is not None]:
            choices.append(choice)
            if choice.taken:
                effects = [effect for effect in effects if effect.joint != joint] + own
                open_joints.append(joint)
        if progress:
            progress((number + 1) / ROUNDS)
        if not open_joints:
            break
    return Structure(tuple(effects), tuple(choices), described)


def _rest_share(design: Design, blocks: Sequence[Block]) -> FloatArray:
    """Share (n,) of each joint's rows in which it stands still."""
    share = np.zeros(design.robot.n)
    motors = [np.abs(design.robot.motors(block.motion).dq)[block.keep] for block in blocks]
    for j in range(design.robot.n):
        speeds = np.concatenate([dq[design.counted(b, j), j] for b, dq in zip(blocks, motors, strict=True)])
        share[j] = np.mean(speeds < REST_SPEED) if len(speeds) else 0.0
    return share


def _quiet(block: Block, cutoff: float) -> Block:
    """Take from the current the noise that no friction term could explain, well above the motion's own band."""
    rate = block.log.rate if len(block.log) > 1 else 0.0
    if QUIET * cutoff >= 0.4 * rate:
        return block
    current = zero_phase(block.log.current, rate, QUIET * cutoff)
    keep = block.keep & np.isfinite(current).all(axis=1)
    return replace(block, log=block.log.replace(current=current), keep=keep)


def candidates(robot: Robot, own: Sequence[Effect], joint: int, rests: bool = True) -> list[Effect]:
    """Friction effects that a joint may still take, given those it has, and whether the logs show it at rest."""
    frictions = [effect for effect in own if isinstance(effect, VelocityEffect)]
    if not frictions:
        return []
    friction = next((effect for effect in frictions if isinstance(effect, DirectedEffect)), frictions[0])
    present = {effect.name for effect in own}
    kinds: list[type[VelocityEffect]] = [Stribeck, Sigmoid, ViscousNonlinear, LoadFriction]
    if rests:
        # A joint that only moves cannot tell an asymmetry from its offset, and would be wrong at rest.
        kinds.append(CoulombAsymmetry)
    possible: list[Effect] = [kind(joint).turned_as(friction) for kind in kinds]
    possible += [MaxwellSlip(joint), CableSpring(joint)]
    if not robot.multibody.prismatic[joint]:
        possible.append(GearRipple(joint))
    possible += [CrossJointFriction(joint, source) for source in coupled(robot, joint)]
    return [effect for effect in possible if effect.name not in present]


def coupled(robot: Robot, joint: int) -> list[int]:
    """Joints whose motion may drive another's motor, for all the card says: a wrist's last two, of each the other."""
    if robot.coupling is None and robot.n >= 6 and joint >= robot.n - 2:
        return [2 * robot.n - 3 - joint]
    return []


def make_folds(blocks: Sequence[Block]) -> tuple[list[Fold], str]:
    """Split rows into folds: by log where there are three or more, else by parts of each log."""
    logs = sorted({block.log.name for block in blocks})
    parts = -(-FOLDS // len(logs))
    if parts == 1:
        # Log names dealt out like cards.
        group = {name: k % FOLDS for k, name in enumerate(logs)}
        labels = [np.full(len(b.keep), group[b.log.name]) for b in blocks]
        return _folds(blocks, labels, FOLDS), f"each of {FOLDS} groups of {len(logs)} logs in turn"
    labels = [np.zeros(len(b.keep), dtype=np.int64) for b in blocks]
    for number, name in enumerate(logs):
        own = [k for k, b in enumerate(blocks) if b.log.name == name]
        total = kept_rows(blocks[k] for k in own)
        seen = 0
        for k in own:
            order = seen + np.cumsum(blocks[k].keep) - 1
            labels[k] = number * parts + np.clip(order * parts // max(total, 1), 0, parts - 1)
            seen += int(blocks[k].keep.sum())
    described = f"each of {parts} parts of {'the log' if len(logs) == 1 else 'each log'} in turn"
    return _folds(blocks, labels, parts * len(logs)), described


def _folds(blocks: Sequence[Block], labels: Sequence[IntArray], count: int) -> list[Fold]:
    def only(chosen: Callable[[IntArray], BoolArray]) -> list[Block]:
        marked = [replace(b, keep=b.keep & chosen(label)) for b, label in zip(blocks, labels, strict=True)]
        return [b for b in marked if b.keep.any()]

    return [Fold(only(lambda x, k=k: x != k), only(lambda x, k=k: x == k)) for k in range(count)]  # type: ignore[misc]


@dataclass(frozen=True, eq=False)
class _Held:
    """A fit to a fold's training rows in which one joint's effects can be exchanged without refitting the others."""

    fold: Fold
    design: Design
    factors: Factors
    weights: FloatArray
    train: list[Seen]
    held_out: list[Seen]

    @staticmethod
    def of(design: Design, fold: Fold, cutoff: float, drives: Drives) -> _Held:
        rate = slowest_rate(fold.train)
        design = settle(design, fold.train, drives, cutoff, rate)
        factors = factorise(design, design.rows(fold.train))
        solution = solve(design, factors)
        design = replace(design, known=solved_model(design, solution, drives, cutoff, rate).context)
        seen = [[design.seen(block) for block in blocks] for blocks in (fold.train, fold.held_out)]
        return _Held(fold, design, factors, solution.weights, *seen)

    def error(self, joint: int, own: Sequence[Effect]) -> float:
        """RMS residual of a joint on the held-out rows when it has other effects of its own; all is fitted again."""
        before = {term.effect: term for term in self.design.terms}
        others = tuple(term for term in self.design.terms if term.effect.joint != joint)
        design = replace(self.design, terms=others + tuple(before.get(e) or initial_term(e) for e in own))
        if any(effect not in before and effect.shapes for effect in own):
            design = optimise_shapes(design, self.fold.train, [joint], self.train)
        upper = triangle(
            np.vstack([np.column_stack(rows) for rows in self._rows(design, joint, self.fold.train, self.train)])
        )
        triangles = [upper if j == joint else known for j, known in enumerate(self.factors.triangles)]
        parameters = solve(design, Factors(triangles, self.factors.rows, self.factors.counted), self.weights).parameters
        columns = design.columns_of_joint(joint)
        rows = self._rows(design, joint, self.fold.held_out, self.held_out)
        residual = np.concatenate([target - matrix @ parameters[columns] for matrix, target in rows])
        return float(np.sqrt(np.mean(residual**2))) if len(residual) else 0.0

    def _rows(
        self, design: Design, joint: int, blocks: Sequence[Block], seen: Sequence[Seen]
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        for block, one in zip(blocks, seen, strict=True):
            matrix = design.matrix(one, design.start(), joint)
            counted = design.counted(block, joint)
            yield matrix[counted], block.log.current[block.keep, joint][counted] * design.scale[joint]


def _grow(
    robot: Robot, effects: Sequence[Effect], joint: int, fits: Sequence[_Held], rests: bool
) -> tuple[int, tuple[list[Effect], Choice]] | None:
    """The candidate that lowers a joint's held-out residual most, with the joint's effects when it is in."""
    own = [effect for effect in effects if effect.joint == joint]
    before = np.array([held.error(joint, own) for held in fits])
    best: tuple[list[Effect], Choice] | None = None
    for candidate in candidates(robot, own, joint, rests):
        grown = [effect for effect in own if effect.name not in candidate.replaces] + [candidate]
        after = np.array([held.error(joint, grown) for held in fits])
        share = 1.0 - after / np.maximum(before, 1e-300)
        gain, worst = float(share.mean()), float(share.min())
        choice = Choice(joint, candidate.name, gain, worst, gain > GAIN and worst > 0.0)
        if best is None or (choice.taken, gain) > (best[1].taken, best[1].gain):
            best = grown, choice
    return None if best is None else (joint, best)
