"""Fitting a list of effects to logs: separable, weighted, robust, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ident.arrays import FloatArray
from ident.design import Counts, Design, Known, Rows
from ident.effects.base import Effect, Term, initial_term
from ident.least_squares import Factors, Solution, factorise, solve
from ident.log import LogSource
from ident.model import CurrentModel
from ident.robot import Robot
from ident.shapes import optimise_shapes
from ident.uncertainty import covariance, independent_errors
from ident.walk import Block, collect, kept_rows, slowest_rate, thin, walk

HUBER = 1.345
"""Residuals beyond this many standard deviations lose weight (95 % efficiency on Gaussian noise)."""

SHAPE_ROWS = 12_000
"""Rows at most on which shape parameters are searched."""

ROUNDS = 4
"""Alternations at most between shape parameters, linear parameters and what effects need of the fitted model."""

SETTLED = 1e-4
"""Relative fall of the residual below which alternating ends."""


@dataclass(frozen=True, eq=False)
class Drives:
    """Force unit per unit of current (n,), and what the force unit is: N m where gains are known."""

    gain: FloatArray
    force_unit: str


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model and how well the logs determine it.

    Attributes:
        model: effects with parameters and standard deviations.
        design: the regression that the parameters solve, with their final shapes.
        solution: the least-squares estimate.
        factors: its triangular factors.
        covariance: of the linear, then the shape parameters.
    """

    model: CurrentModel
    design: Design
    solution: Solution
    factors: Factors
    covariance: FloatArray


def fit(
    robot: Robot,
    effects: Sequence[Effect],
    sources: Sequence[LogSource],
    cutoff: float,
    drives: Drives,
    robust: bool = False,
    progress: Callable[[float], None] | None = None,
    shapes: Sequence[FloatArray] | None = None,
    counts: Counts | None = None,
    spread: bool = True,
) -> Fit:
    """Fit effects to logs.

    Shape parameters, and the load that friction depends on, are settled on rows held in memory (all of them where the
    logs are short); the linear parameters then come from one pass over all rows, whose regression is never held.

    Args:
        robot: the robot.
        effects: what the model is made of.
        sources: logs.
        cutoff: cut-off [Hz] of the zero-phase filter that derives velocity and acceleration.
        drives: force unit per unit of current.
        robust: weight rows by Huber's function, against contacts and outliers (two more passes).
        progress: called with the share of the work done.
        shapes: shape parameters of each effect, which are then kept instead of searched. Those of effects that depend
            on the fitted model are searched from there: they were found with another model.
        counts: which joints' rows are learnt from; all where not given.
        spread: whether standard deviations are asked for; without, they and the covariance are NaN.
    """
    tell = progress or (lambda share: None)
    held = collect(sources, cutoff)
    rate = slowest_rate(held) if held else 0.0
    terms = [initial_term(e) for e in effects]
    if shapes is not None:
        terms = [replace(term, shape=shape) for term, shape in zip(terms, shapes, strict=True)]
    start = Design(robot, tuple(terms), drives.gain, counts=counts)
    design = settle(start, thin(held, SHAPE_ROWS), drives, cutoff, rate, search=shapes is None)
    tell(0.3)
    passes = 3 if robust else 1

    def rows(number: int) -> Iterator[Rows]:
        for k, source in enumerate(sources):
            yield from design.rows(walk(source, cutoff))
            tell(0.3 + 0.6 * (number + (k + 1) / len(sources)) / passes)

    factors = factorise(design, rows(0))
    solution = solve(design, factors)
    for number in range(1, passes):
        factors = factorise(design, rows(number), huber(design, solution))
        solution = solve(design, factors)
    fitted = with_coefficients(design, solution.parameters)
    if spread:
        scatter = covariance(fitted, design, solution, held) * kept_rows(held) / max(factors.rows, 1)
    else:
        scatter = np.full((design.count + sum(len(term.shape) for term in fitted),) * 2, np.nan)
    model = CurrentModel(robot, with_std(design, fitted, scatter), cutoff, rate, drives.gain, drives.force_unit)
    tell(1.0)
    return Fit(model, design, solution, factors, scatter)


def settle(
    design: Design, held: Sequence[Block], drives: Drives, cutoff: float, rate: float, search: bool = True
) -> Design:
    """Return the design with shape parameters, and what effects need of a fitted model, that fit the held rows."""
    needs_model = any(term.effect.needs for term in design.terms)
    has_shapes = any(term.effect.shapes and (search or term.effect.needs) for term in design.terms)
    if not (needs_model or has_shapes):
        return design
    before = np.inf
    for _ in range(ROUNDS):
        if needs_model:
            # What is known first comes from a fit that leaves out what depends on it.
            first = design if design.known is not None else without_dependent(design)
            solution = solve(first, factorise(first, first.rows(held)))
            design = replace(design, known=_sees(solved_model(first, solution, drives, cutoff, rate), design))
        if has_shapes:
            design = optimise_shapes(design, held, dependent=not search)
        if not needs_model:
            break
        now = float(np.sum(np.log(solve(design, factorise(design, design.rows(held))).variance)))
        if before - now < SETTLED:
            break
        before = now
    return design


def _sees(model: CurrentModel, design: Design) -> Known:
    """What the design's effects see of a motion when the model is known."""
    return partial(model.context, total=any("total" in term.effect.needs for term in design.terms))


def without_dependent(design: Design) -> Design:
    """Return the design without the effects that need a fitted model."""
    return replace(design, terms=tuple(term for term in design.terms if not term.effect.needs))


def huber(design: Design, solution: Solution) -> Callable[[Rows], FloatArray]:
    """Return Huber's weights of rows under a solution, scaled by each joint's residual spread."""
    scale = np.sqrt(solution.variance)

    def weigh(rows: Rows) -> FloatArray:
        residual = rows.target - np.stack(
            [m @ solution.parameters[design.columns_of_joint(j)] for j, m in enumerate(rows.matrices)], axis=1
        )
        return np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))

    return weigh


def solved_model(design: Design, solution: Solution, drives: Drives, cutoff: float, rate: float) -> CurrentModel:
    """Return the model that a solution of the design stands for, without standard deviations."""
    terms = with_coefficients(design, solution.parameters)
    return CurrentModel(design.robot, terms, cutoff, rate, drives.gain, drives.force_unit)


def with_coefficients(design: Design, parameters: FloatArray) -> tuple[Term, ...]:
    """Return the design's terms with their coefficients, standard deviations still unknown."""
    terms = []
    for k, term in enumerate(design.terms):
        own = parameters[design.columns_of_term(k)]
        terms.append(replace(term, coefficients=own, std=np.full(len(own), np.nan)))
    return tuple(terms)


def with_std(design: Design, terms: Iterable[Term], spread: FloatArray) -> tuple[Term, ...]:
    """Return terms with standard deviations of their coefficients and shapes, NaN where not determined, and errors."""
    std = np.sqrt(np.maximum(np.diag(spread), 0.0))
    std[std == 0.0] = np.nan
    errors = independent_errors(spread[: design.count, : design.count])
    described, shape = [], design.count
    for k, term in enumerate(terms):
        count, own = len(term.shape), design.columns_of_term(k)
        described.append(replace(term, std=std[own], shape_std=std[shape : shape + count], errors=errors[own]))
        shape += count
    return tuple(described)
