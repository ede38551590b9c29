"""Shape parameters by variable projection: the linear parameters are eliminated, the shapes searched within bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from ident.arrays import BoolArray, FloatArray
from ident.design import Design
from ident.effects.base import Context, Term
from ident.least_squares import triangle
from ident.walk import Block


def optimise_shapes(
    design: Design,
    blocks: Sequence[Block],
    joints: Sequence[int] | None = None,
    contexts: Sequence[Context] | None = None,
    dependent: bool = False,
) -> Design:
    """Return the design with the shape parameters that fit the blocks best, joint by joint (default: every joint).

    While a joint's shapes are searched, its row has link parameters of its own: the search then needs no other row.
    The gradient is Kaufman's (1975, BIT 15:49) on the effects' own derivatives.

    Args:
        design: the regression.
        blocks: its rows.
        joints: whose shapes are searched.
        contexts: what effects see of each block.
        dependent: whether only effects are searched that depend on the fitted model, from the shapes that they have.
    """
    terms = list(design.terms)
    open_terms = [k for k, t in enumerate(terms) if t.effect.shapes and (t.effect.needs or not dependent)]
    of_joints = range(design.robot.n) if joints is None else joints
    searches = [(j, [k for k in open_terms if terms[k].effect.joint == j]) for j in of_joints]
    searches = [(joint, searched) for joint, searched in searches if searched]
    if not searches:  # what effects see of the blocks is dear
        return design
    contexts = contexts or [design.context(block.motion) for block in blocks]
    for joint, searched in searches:
        for k, shape in zip(searched, _search(design, blocks, contexts, joint, searched, not dependent), strict=True):
            terms[k] = replace(terms[k], shape=shape)
    return replace(design, terms=tuple(terms))


def _search(
    design: Design, blocks: Sequence[Block], contexts: Sequence[Context], joint: int, searched: list[int], anew: bool
) -> list[FloatArray]:
    problem = _Projection.of(design, blocks, contexts, joint, searched)
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
    contexts: Sequence[Context]
    keep: Sequence[BoolArray]
    basis: FloatArray
    target: FloatArray
    lower: FloatArray
    joint: int

    @staticmethod
    def of(
        design: Design, blocks: Sequence[Block], contexts: Sequence[Context], joint: int, searched: list[int]
    ) -> _Projection:
        fixed = tuple(t for k, t in enumerate(design.terms) if k not in searched and t.effect.acts_on in (None, joint))
        rest = replace(design, terms=fixed)
        keep = [design.kept(block, joint) for block in blocks]
        matrix = np.vstack([rest.matrix(c, rest.start(), joint)[k] for c, k in zip(contexts, keep, strict=True)])
        target = np.concatenate([block.log.current[k, joint] for block, k in zip(blocks, keep, strict=True)])
        target = target * design.scale[joint]
        basis = orthonormal(matrix)
        terms = tuple(design.terms[k] for k in searched)
        lower = np.array([c.lower for t in terms for c in t.effect.coefficients(design.robot)])
        target = target - basis @ (basis.T @ target)
        return _Projection(terms, contexts, keep, basis, target, lower, joint)

    def split(self, shape: FloatArray) -> list[FloatArray]:
        return np.split(shape, np.cumsum([len(t.effect.shapes) for t in self.terms])[:-1])

    def columns(self, shape: FloatArray) -> FloatArray:
        shapes = self.split(shape)
        parts = [
            np.hstack(
                [t.effect.row(c, s, t.effect.start(), self.joint) for t, s in zip(self.terms, shapes, strict=True)]
            )[keep]
            for c, keep in zip(self.contexts, self.keep, strict=True)
        ]
        return self._away(np.vstack(parts))

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
            parts = [self._gradient(term, c, own)[:, keep] for c, keep in zip(self.contexts, self.keep, strict=True)]
            gradient = np.concatenate(parts, axis=1)
            used = coefficients[first : first + gradient.shape[2]]
            first += gradient.shape[2]
            for derivative in gradient:
                moved = self._away(derivative @ used)
                jacobian.append(-(moved - basis @ (basis.T @ moved)))
        return np.stack(jacobian, axis=1)

    def _gradient(self, term: Term, context: Context, shape: FloatArray) -> FloatArray:
        """Derivative (shapes, N, k) of a term's columns in the joint's row."""
        gradient = term.effect.gradient(context, shape)
        return gradient[:, :, self.joint] if term.effect.acts_on is None else gradient

    def _away(self, columns: FloatArray) -> FloatArray:
        return columns - self.basis @ (self.basis.T @ columns)

    def _coefficients(self, columns: FloatArray) -> FloatArray:
        solved = np.asarray(np.linalg.lstsq(columns, self.target)[0])
        if np.any(solved < self.lower):
            upper = triangle(np.column_stack([columns, self.target]))
            solved = lsq_linear(upper[:, :-1], upper[:, -1], bounds=(self.lower, np.inf), method="bvls").x
        return solved


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
