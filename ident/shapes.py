"""Shape parameters by variable projection: the linear parameters are eliminated, the shapes searched within bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from ident.arrays import BoolArray, FloatArray
from ident.design import Design, Seen
from ident.effects.base import Context, Effect, Term
from ident.least_squares import triangle
from ident.walk import Block


def optimise_shapes(
    design: Design,
    blocks: Sequence[Block],
    joints: Sequence[int] | None = None,
    seen: Sequence[Seen] | None = None,
    dependent: bool = False,
) -> Design:
    """Return the design with the shape parameters that fit the blocks best, joint by joint (default: every joint).

    While a joint's shapes are searched, its row has link parameters of its own: the search then needs no other row.
    The gradient is Kaufman's (1975, BIT 15:49) on the effects' own derivatives.

    Args:
        design: the regression.
        blocks: its rows.
        joints: whose shapes are searched.
        seen: what effects see of each block.
        dependent: whether only effects are searched that depend on the fitted model, from the shapes that they have.
    """
    terms = list(design.terms)
    open_terms = [k for k, t in enumerate(terms) if t.effect.shapes and (t.effect.needs or not dependent)]
    of_joints = range(design.robot.n) if joints is None else joints
    searches = [(j, [k for k in open_terms if terms[k].effect.joint == j]) for j in of_joints]
    searches = [(joint, searched) for joint, searched in searches if searched]
    if not searches:  # what effects see of the blocks is dear
        return design
    seen = seen or [design.seen(block) for block in blocks]
    for joint, searched in searches:
        for k, shape in zip(searched, _search(design, blocks, seen, joint, searched, not dependent), strict=True):
            terms[k] = replace(terms[k], shape=shape)
    return replace(design, terms=tuple(terms))


def _search(
    design: Design, blocks: Sequence[Block], seen: Sequence[Seen], joint: int, searched: list[int], anew: bool
) -> list[FloatArray]:
    problem = _Projection.of(design, blocks, seen, joint, searched)
    scale = _Scale.of([design.terms[k] for k in searched])
    known = np.concatenate([design.terms[k].shape for k in searched])
    start = scale.to_search(_start(problem, known) if anew else known)
    found = least_squares(
        lambda x: problem.residual(scale.to_shape(x)),
        start,
        jac=lambda x: problem.jacobian(scale.to_shape(x)) * scale.slope(x),
        bounds=(scale.lower, scale.upper),
        xtol=1e-6,
        ftol=1e-8,
        max_nfev=40,
    )
    return problem.split(scale.to_shape(found.x))


def _start(problem: _Projection, shape: FloatArray) -> FloatArray:
    """Best of the effects' starting values, one parameter after the other."""
    best, least = shape, float(np.sum(problem.residual(shape) ** 2))
    for number, parameter in enumerate(s for term in problem.terms for s in term.effect.shapes):
        for value in parameter.starts:
            moved = best.copy()
            moved[number] = value
            squares = float(np.sum(problem.residual(moved) ** 2))
            if squares < least:
                best, least = moved, squares
    return best


@dataclass(frozen=True)
class _Scale:
    """Search coordinates: the logarithm where a shape asks for it."""

    log: FloatArray
    lower: FloatArray
    upper: FloatArray

    @staticmethod
    def of(terms: Sequence[Term]) -> _Scale:
        shapes = [s for term in terms for s in term.effect.shapes]
        log = np.array([s.log for s in shapes])
        bounds = np.array([[np.log(s.lower), np.log(s.upper)] if s.log else [s.lower, s.upper] for s in shapes])
        return _Scale(log, bounds[:, 0], bounds[:, 1])

    def to_search(self, shape: FloatArray) -> FloatArray:
        inside = np.where(self.log, np.log(np.where(self.log, shape, 1.0)), shape)
        margin = 1e-6 * (self.upper - self.lower)
        return np.clip(inside, self.lower + margin, self.upper - margin)

    def to_shape(self, x: FloatArray) -> FloatArray:
        return np.where(self.log, np.exp(np.where(self.log, x, 0.0)), x)

    def slope(self, x: FloatArray) -> FloatArray:
        return np.where(self.log, np.exp(np.where(self.log, x, 0.0)), 1.0)


@dataclass(frozen=True)
class _Projection:
    """One joint's regression with the columns that do not depend on shapes already projected away."""

    terms: tuple[Term, ...]
    seen: Sequence[Seen]
    counted: Sequence[BoolArray]
    basis: FloatArray
    target: FloatArray
    lower: FloatArray
    joint: int

    @staticmethod
    def of(
        design: Design, blocks: Sequence[Block], seen: Sequence[Seen], joint: int, searched: list[int]
    ) -> _Projection:
        fixed = tuple(t for k, t in enumerate(design.terms) if k not in searched and t.effect.acts_on in (None, joint))
        rest = replace(design, terms=fixed)
        counted = [design.counted(block, joint) for block in blocks]
        matrix = np.vstack([rest.matrix(one, rest.start(), joint)[k] for one, k in zip(seen, counted, strict=True)])
        current = [block.log.current[block.keep, joint] for block in blocks]
        target = np.concatenate([own[k] for own, k in zip(current, counted, strict=True)])
        target = target * design.scale[joint]
        basis = orthonormal(matrix)
        terms = tuple(design.terms[k] for k in searched)
        lower = np.array([c.lower for t in terms for c in t.effect.coefficients(design.robot)])
        target = target - basis @ (basis.T @ target)
        return _Projection(terms, seen, counted, basis, target, lower, joint)

    def split(self, shape: FloatArray) -> list[FloatArray]:
        return np.split(shape, np.cumsum([len(t.effect.shapes) for t in self.terms])[:-1])

    def columns(self, shape: FloatArray) -> FloatArray:
        found = [self._stacked(term, own, _row) for term, own in zip(self.terms, self.split(shape), strict=True)]
        return self._away(np.hstack([columns[0] for columns in found]))

    def residual(self, shape: FloatArray) -> FloatArray:
        columns = self.columns(shape)
        return self.target - columns @ self._coefficients(columns)

    def jacobian(self, shape: FloatArray) -> FloatArray:
        columns = self.columns(shape)
        coefficients = self._coefficients(columns)
        basis = orthonormal(columns)
        jacobian = []
        first = 0
        for term, own in zip(self.terms, self.split(shape), strict=True):
            gradient = self._stacked(term, own, _gradient)
            used = coefficients[first : first + gradient.shape[2]]
            first += gradient.shape[2]
            for derivative in gradient:
                moved = self._away(derivative @ used)
                jacobian.append(-(moved - basis @ (basis.T @ moved)))
        return np.stack(jacobian, axis=1)

    def _stacked(self, term: Term, shape: FloatArray, of: Callable[..., FloatArray]) -> FloatArray:
        """What is asked (m, N, k) of a term in the joint's row, in the rows that count of all blocks."""
        parts = []
        for one, counted in zip(self.seen, self.counted, strict=True):
            context, rows = one.by(term.effect)
            parts.append(of(term.effect, context, shape, self.joint)[:, rows][:, counted])
        return np.concatenate(parts, axis=1)

    def _away(self, columns: FloatArray) -> FloatArray:
        return columns - self.basis @ (self.basis.T @ columns)

    def _coefficients(self, columns: FloatArray) -> FloatArray:
        solved = np.asarray(np.linalg.lstsq(columns, self.target)[0])
        if np.any(solved < self.lower):
            upper = triangle(np.column_stack([columns, self.target]))
            solved = lsq_linear(upper[:, :-1], upper[:, -1], bounds=(self.lower, np.inf), method="bvls").x
        return solved


def _row(effect: Effect, context: Context, shape: FloatArray, joint: int) -> FloatArray:
    """Columns (1, N, k) of an effect in a joint's row."""
    return effect.row(context, shape, effect.start(), joint)[None]


def _gradient(effect: Effect, context: Context, shape: FloatArray, joint: int) -> FloatArray:
    """Derivative (shapes, N, k) of an effect's columns in a joint's row."""
    gradient = effect.gradient(context, shape)
    return gradient[:, :, joint] if effect.acts_on is None else gradient


def orthonormal(matrix: FloatArray) -> FloatArray:
    """Return an orthonormal basis of a matrix's columns (N, rank); columns are scaled first."""
    norms = np.linalg.norm(matrix, axis=0)
    used = matrix[:, norms > 0] / norms[norms > 0]
    if used.shape[1] == 0:
        return np.zeros((len(matrix), 0))
    values, vectors = np.linalg.eigh(used.T @ used)
    good = values > 1e-12 * max(values[-1], 1e-300)
    # Squaring the matrix costs digits; one more pass brings orthonormality back.
    basis: FloatArray = np.linalg.qr(used @ (vectors[:, good] / np.sqrt(values[good])))[0]
    return basis
