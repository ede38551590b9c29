"""The optimisation behind excitation design: CasADi expressions with exact derivatives, solved by IPOPT."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ident.arrays import FloatArray
from ident.excitation.fourier import FourierFamily, Trajectory
from ident.excitation.information import Information
from ident.excitation.limits import MotionLimits, TorquePrior

NODES_PER_HARMONIC = 16
OBJECTIVES = ("log-det", "condition")
TIGHTER = 0.97  # share of the limits given to the optimiser: between its nodes a motion goes a little farther
SOLVER = {
    "hessian_approximation": "limited-memory",
    "limited_memory_max_history": 20,
    "mu_strategy": "adaptive",
    "tol": 1e-3,
    "acceptable_tol": 1e-2,
    "acceptable_iter": 8,
    "print_level": 0,
    "sb": "yes",
}


@dataclass(frozen=True)
class Outcome:
    """What IPOPT said of a run: its status and the number of iterations."""

    status: str
    iterations: int


class Optimiser:
    """Improves motions of a family within limits that are held at evenly spaced instants.

    Args:
        information: what to gain.
        family: motions to choose from.
        limits: to keep.
        prior: torques to expect.
        gap: smooth distance beyond the clearance as a function of q, None where nothing can touch.
        objective: ``log-det`` to maximise the determinant of the information (D-optimal), ``condition`` to minimise
            the Frobenius condition number of the column-scaled regressor.
        nodes: instants at which regressor and limits are evaluated; by default 16 a harmonic.
        iterations: at most, a run.
    """

    def __init__(
        self,
        information: Information,
        family: FourierFamily,
        limits: MotionLimits,
        prior: TorquePrior,
        gap: ca.Function | None,
        objective: str = "log-det",
        nodes: int | None = None,
        iterations: int = 60,
    ) -> None:
        self.information, self.family = information, family
        nodes = NODES_PER_HARMONIC * family.harmonics if nodes is None else nodes
        n, p = family.joints, information.size
        basis = [ca.DM(b) for b in family.basis(family.times(nodes))]
        x, known, room = ca.MX.sym("x", family.size * n), ca.MX.sym("known", p, p), ca.MX.sym("room")
        coefficients = ca.reshape(x, family.size, n)
        motion = [(b @ coefficients).T for b in basis]  # each (n, nodes)
        gained = _information(information, motion, nodes) * (family.period / nodes)
        rows, low, high = _limits(limits, prior, motion, nodes)
        if gap is not None:
            rows.append(gap.map(nodes)(motion[0]).T - room)
            low, high = [*low, np.zeros(nodes)], [*high, np.full(nodes, np.inf)]
        self._lower, self._upper = np.concatenate(low), np.concatenate(high)
        value = _objective(objective, p)(known + gained)
        problem: dict[str, Any] = {"x": x, "p": ca.vertcat(ca.vec(known), room), "f": value, "g": ca.vertcat(*rows)}
        options: dict[str, Any] = {
            "print_time": False,
            "error_on_fail": False,
            "ipopt": {**SOLVER, "max_iter": iterations},
        }
        self._solver = ca.nlpsol("excitation", "ipopt", problem, options)

    def improve(
        self, start: Trajectory, known: FloatArray | None = None, room: float = 0.0
    ) -> tuple[Trajectory, Outcome]:
        """Improve a motion; the answer may overstep limits a little and has to be verified.

        Args:
            start: motion to begin from.
            known: information already gathered, (size, size).
            room: distance [m] to keep beyond the clearance, by the stand-in for distances.
        """
        scale = self.information.scale
        given = np.zeros((len(scale), len(scale))) if known is None else known / np.outer(scale, scale)
        answer = self._solver(
            x0=start.coefficients.ravel(), p=np.append(given.ravel(), room), lbg=self._lower, ubg=self._upper
        )
        found = answer["x"].full().reshape(self.family.joints, self.family.size)
        stats = self._solver.stats()
        if not np.all(np.isfinite(found)):
            found = start.coefficients
        return Trajectory(self.family, found), Outcome(str(stats["return_status"]), int(stats["iter_count"]))


def _information(information: Information, motion: list[ca.MX], nodes: int) -> ca.MX:
    """Sum over the nodes of W' W in scaled columns, (size, size)."""
    symbols = [ca.SX.sym(name, information.robot.n) for name in ("q", "dq", "ddq")]
    rows = ca.Function("rows", symbols, [information.symbolic(*symbols)], {"cse": True})
    stacked = ca.vertcat(*ca.horzsplit(rows.map(nodes)(*motion), information.size))
    return stacked.T @ stacked


def _limits(
    limits: MotionLimits, prior: TorquePrior, motion: list[ca.MX], nodes: int
) -> tuple[list[ca.MX], list[FloatArray], list[FloatArray]]:
    """Expressions that are to stay within bounds, each over its limit so that all are of the order of one."""
    n = prior.robot.n
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    symbols = [ca.SX.sym(name, n) for name in ("q", "dq", "ddq")]
    torque = ca.Function("torque", symbols, [prior.symbolic(*symbols)], {"cse": True}).map(nodes)(*motion)
    rows = []
    for values, size in (
        (motion[0] - ca.repmat(ca.DM(middle), 1, nodes), half),
        (motion[1], limits.velocity),
        (motion[2], limits.acceleration),
        (torque, prior.room(limits)),
    ):
        known = np.flatnonzero(np.isfinite(size)).tolist()
        if known:
            rows.append(ca.vec(values[known, :] / ca.repmat(ca.DM(size[known]), 1, nodes)))
    bounds = [np.full(row.numel(), TIGHTER) for row in rows]
    return rows, [-b for b in bounds], bounds


def _objective(objective: str, size: int) -> ca.Function:
    """Objective to minimise as a function of a scaled information matrix (size, size)."""
    matrix = ca.SX.sym("matrix", size, size)
    if objective == "log-det":
        _, log_det = _cholesky(matrix)
        return ca.Function("objective", [matrix], [-log_det])
    length = ca.sqrt(ca.diag(matrix))
    lower, _ = _cholesky(matrix / (length @ length.T))
    # The trace of a correlation matrix is its size, so that of its inverse is all that varies.
    return ca.Function("objective", [matrix], [0.5 * ca.log(ca.sumsqr(_inverse_triangle(lower)))])


def _cholesky(matrix: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Lower factor and log determinant of a positive definite matrix, written out operation by operation."""
    size = matrix.shape[0]
    rest, lower, log_det = ca.SX(matrix), ca.SX(size, size), ca.SX(0)
    for k in range(size):
        pivot = rest[k, k]
        log_det += ca.log(pivot)
        column = rest[k:, k] / ca.sqrt(pivot)
        lower[k:, k] = column
        if k + 1 < size:
            rest[k + 1 :, k + 1 :] -= column[1:] @ column[1:].T
    return lower, log_det


def _inverse_triangle(lower: ca.SX) -> ca.SX:
    """Inverse of a lower triangular matrix, row by row."""
    size = lower.shape[0]
    inverse = ca.SX(size, size)
    for k in range(size):
        inverse[k, k] = 1 / lower[k, k]
        if k:
            inverse[k, :k] = -(lower[k, :k] @ inverse[:k, :k]) / lower[k, k]
    return inverse
