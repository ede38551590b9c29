"""Inertial parameters that a real body can have: those nearest to a fit, and among its equals those nearest to CAD."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.design import Design
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import Links, RotorInertia
from ident.errors import InputError
from ident.least_squares import Factors, Solution, triangle
from ident.pseudo_inertia import body_parameters, pseudo_inertia

NEVER_NEGATIVE = {RotorInertia.name: "inertia", Coulomb.name: "force", Viscous.name: "damping"}
"""Coefficients that physics keeps from being negative, beside those with bounds of their own."""

MARGIN = 1e-6
"""Smallest eigenvalue asked of a pseudo-inertia in units of its link; well above the solver's 1e-8."""

EQUAL = 1e-4
"""Relative rise of the sum of squared residuals up to which two models fit equally well."""

HELD = 1e-3
"""Share of the residual that a coefficient may add and still count as held by its bound."""

SMALLEST_MASS = 1e-3  # [kg]
USUAL_LENGTH = 0.2  # [m] of a link whose URDF places no joint away from it
USUAL_DENSITY = 20.0  # [kg/m] mass by length of a link of which nothing is known


class SolverFailure(RuntimeError):
    """The conic solver found no answer, or one that breaks a constraint."""


@dataclass(frozen=True, eq=False)
class FeasibleEstimate:
    """One feasible set of parameters.

    Attributes:
        parameters: standard inertial parameters (10 n,), in Pinocchio's order about the joints' frames [SI].
        coefficients: the design's linear parameters (p,): base parameters and what is not links.
        rise: rise of each joint's root-mean-square residual over the free fit [percent], (n,).
        overall_rise: the same over all joints, each weighted as in the fit [percent].
        smallest_eigenvalue: of each link's pseudo-inertia, in units of the link's mass and length, (n,).
        held: coefficients that a bound holds, ``rotor-inertia of joint 7``.
    """

    parameters: FloatArray
    coefficients: FloatArray
    rise: FloatArray
    overall_rise: float
    smallest_eigenvalue: FloatArray
    held: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Feasible:
    """Feasible parameters of a fit.

    Attributes:
        nearest: the feasible model with the least residual.
        preferred: of the models whose squared residual is within `EQUAL` of that, the one nearest to the prior.
        prior: what was taken for the prior: ``CAD``, or ``generic`` links of the robot's size.
        status: the solver's word on both.
    """

    nearest: FeasibleEstimate
    preferred: FeasibleEstimate
    prior: str
    status: str


def feasible_parameters(
    design: Design, factors: Factors, solution: Solution, prior: FloatArray | None = None
) -> Feasible:
    """Find physically feasible parameters for a fit with shared links.

    Every link's pseudo-inertia is kept positive definite (Wensing et al. 2018; Sousa and Cortesao 2014), every mass
    above 1 g, rotor inertias and Coulomb and viscous friction from being negative. The first estimate has the least
    residual in the fit's own metric. What these data leave open (most standard parameters) the second settles by
    the entropic distance to the prior, ``tr(J0^-1 J) - log det J`` summed over links (Lee, Wensing and Park 2020).

    Args:
        design: the fitted columns.
        factors: their triangular factors.
        solution: the free estimate.
        prior: CAD parameters (10 n,); links without mass in it, or all with None, are taken as generic.

    Raises:
        InputError: the links have parameters of their own in each joint's row: units then differ row by row, and no
            one body stands behind them.
        SolverFailure: the solver gave up, or its answer breaks a constraint.
    """
    problem = _Problem(design, factors, solution, prior)
    least, first = problem.nearest()
    preferred, second = problem.preferred(least)
    has_prior = prior is not None and bool(np.any(np.reshape(prior, (-1, 10))[:, 0] > SMALLEST_MASS))
    status = first if first == second else f"{first}, then {second}"
    prior_name = "CAD" if has_prior else "generic"
    return Feasible(problem.estimate(least), problem.estimate(preferred), prior_name, status)


@dataclass(frozen=True, eq=False)
class _Problem:
    """The least-squares problem in scaled variables: 10 a link in units of its mass and length, then the others."""

    design: Design
    factors: Factors
    solution: Solution
    prior: FloatArray | None

    @property
    def n(self) -> int:
        return self.design.robot.n

    @cached_property
    def links(self) -> tuple[int, Links]:
        """The term that holds the shared links: its number and its effect."""
        found = [(k, term.effect) for k, term in enumerate(self.design.terms) if isinstance(term.effect, Links)]
        if len(found) != 1 or found[0][1].joint is not None:
            what = "feasible parameters need links that all joints share"
            raise InputError(what, "feasible parameters", "know the drive gains, or estimate them with the links")
        return found[0]

    @cached_property
    def centre(self) -> FloatArray:
        """Scaled parameters (n, 10) of the prior, made feasible."""
        sizes = self.sizes
        scaled = np.zeros((self.n, 10))
        given = np.zeros((self.n, 10)) if self.prior is None else np.reshape(self.prior, (self.n, 10))
        for k, (values, size) in enumerate(zip(given, sizes, strict=True)):
            known = values[0] > SMALLEST_MASS and np.any(values[4:])
            matrix = pseudo_inertia(values / size) if known else np.diag([0.1, 0.1, 0.1, 1.0])
            eigenvalues, vectors = np.linalg.eigh(matrix)
            scaled[k] = body_parameters((vectors * np.maximum(eigenvalues, 1e-3)) @ vectors.T)
        return scaled

    @cached_property
    def sizes(self) -> FloatArray:
        """Unit of each link's parameters (n, 10): powers of its length times its mass."""
        tree = self.design.robot.multibody.tree
        reach = np.linalg.norm(tree.translation, axis=1)
        lengths = np.full(self.n, USUAL_LENGTH)
        for child, parent in enumerate(tree.parent):
            if parent >= 0 and reach[child] > USUAL_LENGTH / 2:
                lengths[parent] = reach[child]
        masses = USUAL_DENSITY * lengths
        if self.prior is not None:
            given = np.reshape(self.prior, (self.n, 10))[:, 0]
            masses = np.where(given > SMALLEST_MASS, given, masses)
        powers = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
        sizes: FloatArray = masses[:, None] * lengths[:, None] ** powers
        return sizes

    @cached_property
    def others(self) -> list[int]:
        """Numbers of the linear parameters that are not links' and whose columns are not nought."""
        columns = set(self.design.columns_of_term(self.links[0]).tolist())
        norms = np.linalg.norm(self._rows(np.eye(self.design.count))[0], axis=0)
        return [k for k in range(self.design.count) if k not in columns and norms[k] > 0.0]

    @cached_property
    def mapping(self) -> FloatArray:
        """Design's parameters from scaled variables, (p, 10 n + others)."""
        number, effect = self.links
        mapping = np.zeros((self.design.count, 10 * self.n + len(self.others)))
        base = effect.base(self.design.robot).projection
        mapping[self.design.columns_of_term(number), : 10 * self.n] = base * self.sizes.ravel()
        mapping[self.others, 10 * self.n + np.arange(len(self.others))] = 1.0
        norms = np.linalg.norm(self._rows(mapping)[0], axis=0)
        mapping[:, 10 * self.n :] /= norms[10 * self.n :]
        return mapping

    @cached_property
    def regression(self) -> tuple[FloatArray, FloatArray]:
        """Triangle (v, v) and target (v,) of the scaled problem, in units of the free fit's residual."""
        rows, target = self._rows(self.mapping)
        upper = triangle(np.column_stack([rows, target]))
        return upper[:-1, :-1] / self.residual, upper[:-1, -1] / self.residual

    @cached_property
    def residual(self) -> float:
        """Norm of the weighted residual without bounds."""
        rows, target = self._rows(self.mapping)
        return float(np.linalg.norm(rows @ np.linalg.lstsq(rows, target)[0] - target))

    @cached_property
    def lower(self) -> FloatArray:
        """Lower bounds of the other parameters."""
        coefficients = self.design.coefficients()
        bounds = []
        for k in self.others:
            term, coefficient = coefficients[k]
            kept = NEVER_NEGATIVE.get(self.design.terms[term].effect.name) == coefficient.name
            bounds.append(max(coefficient.lower, 0.0 if kept else -np.inf))
        return np.array(bounds)

    def nearest(self) -> tuple[FloatArray, str]:
        """Scaled variables of least residual, and the solver's status."""
        cp = _cvxpy()
        upper, target = self.regression
        v = cp.Variable(upper.shape[1])
        # The trace keeps what the data leave open from drifting; it costs the residual a millionth.
        size = sum(cp.trace(J) for J in self._matrices(v))
        return _solved(cp.Minimize(cp.sum_squares(upper @ v - target) + 1e-6 * size), self._constraints(v), v)

    def preferred(self, nearest: FloatArray) -> tuple[FloatArray, str]:
        """Scaled variables nearest to the prior among those that fit as well as ``nearest``, and the status."""
        cp = _cvxpy()
        upper, target = self.regression
        v = cp.Variable(upper.shape[1])
        excess = float(np.sum((upper @ nearest - target) ** 2))
        equal = cp.norm(upper @ v - target) <= np.sqrt(excess + EQUAL * (1.0 + excess))
        # For what neither data nor prior determine: the least.
        distance = 1e-9 * cp.sum_squares(v[10 * self.n :] / np.linalg.norm(self._rows(self.mapping)[1]))
        for matrix, centre in zip(self._matrices(v), pseudo_inertia(self.centre), strict=True):
            distance += cp.trace(np.linalg.inv(centre) @ matrix) - cp.log_det(matrix)
        return _solved(cp.Minimize(distance), [*self._constraints(v), equal], v)

    def estimate(self, v: FloatArray) -> FeasibleEstimate:
        """Return the parameters of scaled variables, after checking every constraint on them.

        Raises:
            SolverFailure: a constraint is broken.
        """
        scaled = v[: 10 * self.n].reshape(self.n, 10)
        smallest = np.array([np.linalg.eigvalsh(matrix)[0] for matrix in pseudo_inertia(scaled)])
        if np.any(smallest <= 0.0):
            joint = int(np.argmin(smallest)) + 1
            raise SolverFailure(f"the solver's pseudo-inertia of link {joint} has eigenvalue {smallest.min():.1e}")
        coefficients = self.mapping @ v
        others = coefficients[self.others]
        # The solver keeps a bound to its tolerance; the little it oversteps is taken back.
        coefficients[self.others] = np.maximum(others, self.lower)
        scale = self.mapping[self.others, 10 * self.n + np.arange(len(others))]
        at_bound = np.flatnonzero(others - self.lower < HELD * scale * self.residual)
        free = self.factors.residual_variance(self.design, self.solution.parameters)
        here = self.factors.residual_variance(self.design, coefficients)
        weights = self.solution.weights
        rise: FloatArray = 100.0 * (np.sqrt(np.divide(here, free, where=free > 0, out=np.ones(self.n))) - 1.0)
        overall = 100.0 * (float(np.sqrt(np.sum(weights * here) / np.sum(weights * free))) - 1.0)
        return FeasibleEstimate(
            (scaled * self.sizes).ravel(), coefficients, rise, overall, smallest, self._names(at_bound)
        )

    def _names(self, others: IntArray) -> tuple[str, ...]:
        coefficients = self.design.coefficients()
        effects = [self.design.terms[coefficients[self.others[k]][0]].effect for k in others]
        return tuple(e.name if e.joint is None else f"{e.name} of joint {e.joint + 1}" for e in effects)

    def _rows(self, mapping: FloatArray) -> tuple[FloatArray, FloatArray]:
        """All joints' factors, weighted as in the fit, as one regression in the variables that ``mapping`` takes."""
        rows, targets = [], []
        for j, (upper, weight) in enumerate(zip(self.factors.triangles, self.solution.weights, strict=True)):
            rows.append(np.sqrt(weight) * upper[:, :-1] @ mapping[self.design.columns_of_joint(j)])
            targets.append(np.sqrt(weight) * upper[:, -1])
        return np.vstack(rows), np.concatenate(targets)

    def _matrices(self, v: Any) -> list[Any]:
        cp = _cvxpy()
        basis = pseudo_inertia(np.eye(10)).reshape(10, 16).T
        return [cp.reshape(basis @ v[10 * k : 10 * k + 10], (4, 4), order="C") for k in range(self.n)]

    def _constraints(self, v: Any) -> list[Any]:
        constraints = [matrix >> MARGIN * np.eye(4) for matrix in self._matrices(v)]
        constraints.append(v[0 : 10 * self.n : 10] >= SMALLEST_MASS / self.sizes[:, 0])
        bounded = np.flatnonzero(np.isfinite(self.lower))
        if len(bounded):
            scale = self.mapping[np.array(self.others)[bounded], 10 * self.n + bounded]
            constraints.append(v[10 * self.n + bounded] >= self.lower[bounded] / scale)
        return constraints


def _cvxpy() -> Any:
    """cvxpy takes a second to import and has partial types."""
    return import_module("cvxpy")


def _solved(objective: Any, constraints: list[Any], v: Any) -> tuple[FloatArray, str]:
    cp = _cvxpy()
    problem = cp.Problem(objective, constraints)
    try:
        with warnings.catch_warnings():
            # An answer short of the solver's tolerance is checked like any other, and its status is told.
            warnings.simplefilter("ignore", UserWarning)
            problem.solve(solver=cp.CLARABEL)
    except cp.error.SolverError as error:
        raise SolverFailure(f"the conic solver gave up ({error})") from error
    if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE) or v.value is None:
        raise SolverFailure(f"the conic solver found no feasible parameters ({problem.status})")
    return np.array(v.value), str(problem.status)
