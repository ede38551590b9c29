"""Which friction terms a robot needs: chosen by logs that were held out, never by the training error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import FloatArray
from ident.design import Design
from ident.effects.base import Effect, Term, initial_term
from ident.effects.friction import CoulombAsymmetry, LoadFriction, Sigmoid, Stribeck, ViscousNonlinear
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import CableSpring
from ident.effects.transmission import CrossJointFriction, GearRipple
from ident.fit import Drives, predicted, settle, solved_model
from ident.log import LogSource
from ident.robot import Robot
from ident.shapes import optimise_shapes
from ident.least_squares import factorise, solve
from ident.walk import Block, collect

SEARCH_ROWS = 24_000
"""Rows at most on which structures are compared."""

GAIN = 0.01
"""A term must lower the held-out RMS residual of its joint by this share, on average over the folds, and on each."""

ROUNDS = 5
FOLDS = 3


@dataclass(frozen=True)
class Choice:
    """A term that was tried on a joint: the share by which it lowered the held-out RMS residual, and whether it stayed."""

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
) -> Structure:
    """Add friction effects to a baseline, joint by joint, as long as held-out rows are predicted better.

    With two logs or more each is held out in turn, with one log its thirds. In each round every joint tries every
    candidate with its own parameters refitted (parameters that joints share stay at the fold's last fit) and takes the
    best one if it lowers the held-out residual by more than ``GAIN`` on average and does not raise it on any fold.
    """
    blocks = collect(sources, cutoff, SEARCH_ROWS)
    if not any(block.keep.any() for block in blocks):
        return Structure(tuple(baseline), (), "nothing: the logs are too short")
    folds, described = make_folds(blocks)
    effects = list(baseline)
    choices: list[Choice] = []
    tried: set[tuple[int, str]] = set()
    for number in range(ROUNDS):
        residuals = [_without_shared(robot, effects, fold, cutoff, drives) for fold in folds]
        grown = False
        for joint in range(robot.n):
            own = [effect for effect in effects if effect.joint == joint]
            found = _best(robot, own, candidates(robot, own, joint), residuals, drives)
            if found is None:
                continue
            kept, choice = found
            if choice.taken:
                effects = [effect for effect in effects if effect.joint != joint] + kept
                grown = True
            if choice.taken or (joint, choice.effect) not in tried:
                choices.append(choice)
            tried.add((joint, choice.effect))
        if progress:
            progress((number + 1) / ROUNDS)
        if not grown:
            break
    return Structure(tuple(effects), tuple(choices), described)


def candidates(robot: Robot, own: Sequence[Effect], joint: int) -> list[Effect]:
    """Friction effects that a joint may still take, given those it has."""
    smoothing = next((effect.smoothing for effect in own if hasattr(effect, "smoothing")), None)
    if smoothing is None:
        return []
    present = {effect.name for effect in own}
    possible: list[Effect] = [
        kind(joint, smoothing) for kind in (CoulombAsymmetry, Stribeck, Sigmoid, ViscousNonlinear, LoadFriction)
    ]
    possible += [MaxwellSlip(joint), CableSpring(joint)]
    if not robot.multibody.prismatic[joint]:
        possible.append(GearRipple(joint))
    possible += [CrossJointFriction(joint, smoothing, source) for source in coupled(robot, joint)]
    return [effect for effect in possible if effect.name not in present]


def coupled(robot: Robot, joint: int) -> list[int]:
    """Other joints whose motor motion may enter a joint's friction: those the card couples, else the other wrist axis."""
    if robot.coupling is not None:
        links = (robot.coupling != 0) & ~np.eye(robot.n, dtype=bool)
        return [int(k) for k in np.flatnonzero(links[:, joint] | links[joint])]
    if robot.n >= 6 and joint >= robot.n - 2:
        return [2 * robot.n - 3 - joint]
    return []


def make_folds(blocks: Sequence[Block]) -> tuple[list[Fold], str]:
    """Split rows into folds: by log where there are several, else by thirds of time."""
    logs = sorted({block.log.name for block in blocks})
    if len(logs) > 1:
        groups = [set(logs[k::FOLDS]) for k in range(min(FOLDS, len(logs)))]
        folds = [
            Fold([b for b in blocks if b.log.name not in g], [b for b in blocks if b.log.name in g]) for g in groups
        ]
        return folds, f"each of {len(groups)} groups of {len(logs)} logs in turn"
    rows = np.concatenate([np.flatnonzero(b.keep) + 1j * k for k, b in enumerate(blocks)])
    folds = []
    for part in np.array_split(rows, FOLDS):
        train, held_out = [], []
        for k, block in enumerate(blocks):
            inside = np.zeros(len(block.keep), dtype=bool)
            inside[part[part.imag == k].real.astype(int)] = True
            train.append(replace(block, keep=block.keep & ~inside))
            held_out.append(replace(block, keep=block.keep & inside))
        folds.append(Fold(train, held_out))
    return folds, f"each of {FOLDS} parts of the log in turn"


def _without_shared(
    robot: Robot, effects: Sequence[Effect], fold: Fold, cutoff: float, drives: Drives
) -> tuple[Fold, Design]:
    """The fold with the current of shared effects taken away, and the fitted design (which knows the load)."""
    rate = fold.train[0].log.rate
    design = Design(robot, tuple(initial_term(e) for e in effects), drives.gain)
    design = settle(design, fold.train, drives, cutoff, rate)
    model = solved_model(design, solve(design, factorise(design, design.rows(fold.train))), drives, cutoff, rate)
    design = replace(design, load=model.load)
    shared = replace(model, terms=tuple(term for term in model.terms if term.effect.joint is None))

    def rest(block: Block) -> Block:
        current = block.log.current - predicted(shared, block)
        return replace(block, log=block.log.replace(current=current))

    return Fold([rest(b) for b in fold.train], [rest(b) for b in fold.held_out]), design


def _best(
    robot: Robot,
    own: Sequence[Effect],
    possible: Sequence[Effect],
    residuals: Sequence[tuple[Fold, Design]],
    drives: Drives,
) -> tuple[list[Effect], Choice] | None:
    """The candidate that lowers a joint's held-out residual most."""
    if not possible:
        return None
    before = np.array([_held_out_rms(robot, own, fold, known, drives) for fold, known in residuals])
    best: tuple[list[Effect], Choice] | None = None
    for candidate in possible:
        grown = [effect for effect in own if effect.name not in candidate.replaces] + [candidate]
        after = np.array([_held_out_rms(robot, grown, fold, known, drives) for fold, known in residuals])
        share = 1.0 - after / np.maximum(before, 1e-300)
        gain, worst = float(share.mean()), float(share.min())
        if best is None or gain > best[1].gain:
            best = grown, Choice(candidate.at, candidate.name, gain, worst, gain > GAIN and worst > 0.0)
    return best


def _held_out_rms(robot: Robot, own: Sequence[Effect], fold: Fold, known: Design, drives: Drives) -> float:
    joint = own[0].at
    before = {term.effect: term for term in known.terms}
    terms: tuple[Term, ...] = tuple(before.get(effect, initial_term(effect)) for effect in own)
    design = Design(robot, terms, drives.gain, known.load)
    if any(effect not in before and effect.shapes for effect in own):
        design = optimise_shapes(design, fold.train, [joint])
    solution = solve(design, factorise(design, design.rows(fold.train)), reweight=0)
    columns = design.columns_of_joint(joint)
    errors = [
        rows.target[:, joint] - rows.matrices[joint] @ solution.parameters[columns]
        for rows in design.rows(fold.held_out)
    ]
    joined: FloatArray = np.concatenate(errors)
    return float(np.sqrt(np.mean(joined**2))) if len(joined) else 0.0
