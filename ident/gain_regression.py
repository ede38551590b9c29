"""The regression behind drive gains: logs to factors, gains to likelihood, residuals to spread."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import FloatArray
from ident.bilinear import Bilinear, GainPrior, least, without_own
from ident.design import Design, Rows
from ident.effects.base import Coefficient, Context, Effect, initial_term
from ident.effects.friction import LoadFriction
from ident.effects.rigid_body import Links
from ident.errors import InputError
from ident.fit import with_coefficients
from ident.least_squares import Factors, Solution, factorise
from ident.log import LogSource
from ident.payload import CarryingMotion, KnownLoad, Payload, UnknownInertia, carrying, last_joint
from ident.robot import Robot
from ident.shapes import optimise_shapes
from ident.signals import Motion
from ident.uncertainty import correlation_time, covariance
from ident.walk import Block, collect, kept_rows, walk

ROUNDS = 3
"""Renewals of the joints' weights, and of the load that friction depends on."""

Bounds = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class GainTangent(Effect):
    """Change of the joints' torque with the logarithms of their gains, along given directions.

    Attributes:
        directions: (n, d) as nested tuples.
    """

    directions: tuple[tuple[float, ...], ...] = ()

    def coefficients(self, robot: Robot) -> tuple[Coefficient, ...]:
        """Return one small change a direction."""
        return tuple(Coefficient(f"log gain {k + 1}", "1") for k in range(len(self.directions[0])))

    def columns(self, context: Context, shape: FloatArray, memory: FloatArray) -> FloatArray:
        """Return the load of links and payload along each direction, (N, n, d)."""
        if context.load is None:
            raise InputError("no load on the links", "drive gains", "give a Context with a load")
        columns: FloatArray = context.load[:, :, None] * np.array(self.directions)
        return columns


@dataclass(frozen=True, eq=False)
class GainFit:
    """Gains that fit logs best, and what goes with them.

    Attributes:
        design: the columns in current units: shared ones first, then each joint's own.
        factors: their triangular factors.
        problem: the bilinear problem with its final weights.
        start: gains that the search began with, (n,).
        gains: those it found [N m per unit of current], (n,).
        shared: coefficients of the shared columns [SI], (s,).
        own: each joint's own coefficients in current units.
        residual: root mean square residual of each joint in current units, (n,).
    """

    design: Design
    factors: Factors
    problem: Bilinear
    start: FloatArray
    gains: FloatArray
    shared: FloatArray
    own: list[FloatArray]
    residual: FloatArray


class GainRegression:
    """Logs without and with a payload as one regression with unknown gains.

    Args:
        robot: the robot.
        without, with_: logs without and with the payload; the latter empty where there is none.
        payload: the payload, None where there is none.
        cutoff: cut-off [Hz] of the zero-phase filter.
        effects: what each joint has besides links.
        share_links: one set of links for all joints, or one for each joint's row.
    """

    def __init__(
        self,
        robot: Robot,
        without: Sequence[LogSource],
        with_: Sequence[LogSource],
        payload: Payload | None,
        cutoff: float,
        effects: Sequence[Effect],
        share_links: bool,
    ) -> None:
        self.robot, self.without, self.with_, self.cutoff = robot, without, with_, cutoff
        self.payload = np.zeros(10) if payload is None else payload.parameters(robot)
        links: list[Effect] = [Links(None)] if share_links else [Links(j) for j in range(robot.n)]
        body: list[Effect] = [] if payload is None else [KnownLoad(None, tuple(self.payload.tolist()))]
        if payload is not None and payload.inertia is None:
            body.append(UnknownInertia(None))
        self.effects = (*links, *body, *effects)
        self.first = len(Links(None).base(robot).columns) if share_links else 0  # shared columns before the payload's
        self.known = None if payload is None else self.first
        self.held = [*collect(without, cutoff), *carrying(collect(with_, cutoff))]

    def fit(self, prior: GainPrior | None, bounds: Bounds) -> GainFit:
        """Find the gains; where friction depends on the load, the load is renewed with them."""
        plain = [e for e in self.effects if not isinstance(e, LoadFriction)]
        found = self._search(Design(self.robot, tuple(map(initial_term, plain)), np.ones(self.robot.n)), prior, bounds)
        if len(plain) == len(self.effects):
            return found
        for _ in range(ROUNDS - 1):
            terms = tuple(map(initial_term, self.effects))
            design = Design(self.robot, terms, np.ones(self.robot.n), self.load(found))
            found = replace(self._search(design, prior, bounds), start=found.start)
        return found

    def link_parameters(self, found: GainFit) -> FloatArray:
        """Inertial parameters (n, 10 n) [SI] of each joint's row; only base parameters are set."""
        rows = np.zeros((self.robot.n, 10 * self.robot.n))
        for term, effect in enumerate(t.effect for t in found.design.terms):
            if isinstance(effect, Links) and effect.joint is None:
                rows[:, effect.base(self.robot).columns] = found.shared[: self.first]
            elif isinstance(effect, Links):
                # A joint's own columns stand in the order of the terms, and its links before the rest.
                count = len(found.design.columns_of_term(term))
                values = found.own[effect.at][:count] * found.gains[effect.at]
                rows[effect.at, effect.base(self.robot).columns] = values
        return rows

    def load(self, found: GainFit) -> _Load:
        """What links and payload ask of the joints, at the gains found."""
        carried = self.payload.copy()
        if self.known is not None and len(found.shared) > self.known + 1:
            carried[4:] += found.shared[self.known + 1 :]
        links = self.link_parameters(found)
        loaded = links.copy()
        loaded[:, 10 * last_joint(self.robot) :][:, :10] += carried
        return _Load(self.robot, links, loaded)

    def spread(self, found: GainFit) -> FloatArray:
        """Covariance (n, n) of the logarithms of the gains from the data alone; inf where they do not determine one.

        The model is linearised in links, own terms and the logarithms. The payload's column stays out of it: it is
        the sum of the tangents less the links' part, so tangents of one and links of nought give the same residual.
        """
        directions = found.problem.directions
        tangent = GainTangent(None, tuple(map(tuple, directions.tolist())))
        terms = [t for t in found.design.terms if not isinstance(t.effect, KnownLoad)]
        design = Design(self.robot, (initial_term(tangent), *terms), found.gains, self.load(found))
        parameters = np.zeros(design.count)
        moved = design.columns_of_term(0)
        if self.known is None:
            parameters[design.columns_of_term(1)] = found.shared
        else:
            parameters[moved] = 1.0
        for j, (gain, own) in enumerate(zip(found.gains, found.own, strict=True)):
            parameters[design.columns_of_joint(j)[-len(own) :]] = gain * own
        for number, term in enumerate(design.terms):
            if isinstance(term.effect, Links) and self.known is not None:
                parameters[design.columns_of_term(number)] = 0.0
        weights = found.problem.weights / found.gains**2
        unused = np.zeros((0, 0))
        solution = Solution(parameters, np.ones(design.count, dtype=bool), unused, weights, np.nan, unused)
        everything = covariance(with_coefficients(design, parameters), design, solution, self.held)
        held = kept_rows(self.held)
        spread: FloatArray = everything[np.ix_(moved, moved)] * held / found.factors.rows
        undetermined = np.diag(spread) <= 0.0
        spread = directions @ spread @ directions.T
        if undetermined.any():
            open_ = np.abs(directions[:, undetermined]).max(axis=1) > 1e-9
            spread[open_, open_] = np.inf
        return spread

    def _search(self, design: Design, prior: GainPrior | None, bounds: Bounds) -> GainFit:
        """Find gains and coefficients for one design; weights follow the residual of the round before."""
        design = optimise_shapes(design, self.held)
        factors = factorise(design, design.rows(self._walk()))
        shared = sum(len(design.columns_of_term(k)) for k, t in enumerate(design.terms) if t.effect.acts_on is None)
        triangles = [without_own(upper, shared) for upper in factors.triangles]
        coefficients = [least(upper[:, :-1], upper[:, -1]) for upper in factors.triangles]
        rows = list(design.rows(self.held))
        weights, residual = _weigh(rows, coefficients)
        start = gains = Bilinear(triangles, self.known, weights).start()
        for _ in range(ROUNDS):
            problem = Bilinear(triangles, self.known, weights)
            gains = problem.solve(gains, prior, bounds)
            sigma = problem.shared(gains)
            own = [
                least(upper[:, shared:-1], upper[:, -1] - upper[:, :shared] @ sigma / gain)
                for upper, gain in zip(factors.triangles, gains, strict=True)
            ]
            weights, residual = _weigh(rows, [np.append(sigma / g, o) for g, o in zip(gains, own, strict=True)])
        return GainFit(design, factors, problem, start, gains, sigma, own, residual)

    def _walk(self) -> Iterator[Block]:
        for source in self.without:
            yield from walk(source, self.cutoff)
        for source in self.with_:
            yield from carrying(walk(source, self.cutoff))


@dataclass(frozen=True, eq=False)
class _Load:
    """What effects see of a motion, which knows whether the robot carries the payload."""

    robot: Robot
    links: FloatArray
    loaded: FloatArray

    def __call__(self, motion: Motion) -> Context:
        parameters = self.loaded if isinstance(motion, CarryingMotion) else self.links
        load = self.robot.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, parameters)
        return Context(self.robot, motion, load, parameters)


def _weigh(rows: list[Rows], coefficients: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """One over variance times correlation time of each joint's residual, and its root mean square, (n,) each."""
    weights, size = np.empty(len(coefficients)), np.empty(len(coefficients))
    for j, values in enumerate(coefficients):
        residual = np.concatenate([r.target[:, j] - r.matrices[j] @ values for r in rows])
        size[j] = np.sqrt(np.mean(residual**2))
        weights[j] = 1.0 / (max(size[j] ** 2, 1e-300) * correlation_time(residual))
    return weights, size
