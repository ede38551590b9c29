"""What a motion tells of a robot's parameters: the information matrix of its base regressor and drive columns."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.cutoff import choose_cutoff
from ident.errors import InputError
from ident.log import LogSource
from ident.robot import Robot
from ident.signals import Motion
from ident.symbolic import motor_forces, motor_motion, regressor
from ident.walk import walk

DRIVE_COLUMNS = ("rotor-inertia", "viscous", "coulomb")
STANDSTILL = 0.02  # share of the velocity limit over which the sign of the velocity turns
SAMPLES = 1000
FASTEST = 10.0  # [rad/s; m/s]; beside motion at 1e4, which URDFs write for no limit, gravity would be rounding
CUTOFF_ROWS = 60_000  # of a log from which the cut-off of its filter is chosen
SEED = 0
ROUNDING = 1e-5
NOISE_SHARE = 0.01  # noise of a torque as a share of the joint's limit, or of its largest torque where it has none


class Information:
    """Information that torques of a motion hold about base parameters, rotor inertias and friction.

    Torques are taken to be disturbed by noise independent between joints, so that the information of a motion is the
    integral over time of ``W' W`` with each joint's row of W divided by its noise: per unit of noise density, since
    samples taken closer together than the noise's correlation tell nothing new.

    Args:
        robot: the robot.
        span: positions to refer scales to, (2, n).
        drives: columns beside the links': any of rotor-inertia, viscous and coulomb.
        noise: standard deviation of each joint's torque noise, (n,); by default a hundredth of its limit.
    """

    def __init__(
        self,
        robot: Robot,
        span: FloatArray,
        drives: tuple[str, ...] = DRIVE_COLUMNS,
        noise: FloatArray | None = None,
    ) -> None:
        self.robot = robot
        self.drives = drives
        self.standstill = STANDSTILL * _speed(robot)
        base = robot.rigid_body.base_parameters()
        self._base = base.columns
        names = [*base.names, *(f"{kind}{joint + 1}" for kind in drives for joint in range(robot.n))]
        motion = _random_motion(robot, span)
        self.noise = _default_noise(robot, motion) if noise is None else np.array(noise, dtype=float)
        rows = self._all_rows(motion).reshape(-1, len(names))
        self.columns = _independent(rows, len(self._base))
        self.names = [names[k] for k in self.columns]
        self.scale = np.sqrt(np.mean(rows[:, self.columns] ** 2, axis=0) * robot.n)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.columns)

    def rows(self, motion: Motion) -> FloatArray:
        """Regressor (N, n, size), each joint's row over its noise."""
        return self._all_rows(motion)[:, :, self.columns]

    def matrix(self, motion: Motion, seconds: float) -> FloatArray:
        """Information (size, size) of a motion sampled evenly over ``seconds``."""
        rows = self.rows(motion).reshape(-1, self.size)
        return rows.T @ rows * (seconds / len(motion))

    def of_logs(self, logs: Iterable[LogSource]) -> FloatArray:
        """Information (size, size) of motions already made.

        Raises:
            InputError: a log is too short to filter or has another number of joints.
        """
        total = np.zeros((self.size, self.size))
        for source in logs:
            head = next(source.blocks(CUTOFF_ROWS), None)
            if head is None:
                raise InputError("no rows", f"log {source.name}", "give a log with motion")
            if head.n != self.robot.n:
                what = f"{head.n} joints where {self.robot.name} has {self.robot.n}"
                raise InputError(what, f"log {source.name}", "give a log of this robot")
            for block in walk(source, choose_cutoff(head).hertz):
                kept = block.keep
                motion = Motion(*(x[kept] for x in (block.motion.t, block.motion.q, block.motion.dq, block.motion.ddq)))
                if len(motion):
                    total += self.matrix(motion, len(motion) / head.rate)
        return total

    def log_det(self, matrix: FloatArray) -> float:
        """Logarithm of the determinant, columns in units of the scale of random motion; -inf where singular."""
        sign, value = np.linalg.slogdet(matrix / np.outer(self.scale, self.scale))
        return float(value) if sign > 0 else -np.inf

    def condition_number(self, matrix: FloatArray, links_only: bool = False) -> float:
        """Condition number of the regressor behind a matrix, its columns scaled to unit length."""
        part = matrix[: len(self._base), : len(self._base)] if links_only else matrix
        length = np.sqrt(np.diag(part))
        if np.any(length == 0):
            return np.inf
        values = np.linalg.eigvalsh(part / np.outer(length, length))
        return float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else np.inf

    def deviations(self, matrix: FloatArray) -> FloatArray:
        """Standard deviations (size,) of the parameters identified, per root of the noise density."""
        scaled = matrix / np.outer(self.scale, self.scale)
        return np.sqrt(np.diag(np.linalg.inv(scaled))) / self.scale  # type: ignore[no-any-return]

    def symbolic(self, q: ca.SX, dq: ca.SX, ddq: ca.SX) -> ca.SX:
        """Regressor (n, size) over noise and scale as an expression."""
        body, coupling = self.robot.multibody, self.robot.coupling
        links = regressor(body.tree, body.gravity, q, dq, ddq)[:, self._base.tolist()]
        links, dq, ddq = motor_forces(coupling, links), motor_motion(coupling, dq), motor_motion(coupling, ddq)
        own = {"rotor-inertia": ddq, "viscous": dq, "coulomb": ca.tanh(dq / ca.DM(self.standstill))}
        rows = ca.horzcat(links, *[ca.diag(own[kind]) for kind in self.drives])[:, self.columns.tolist()]
        weights = 1.0 / np.outer(self.noise, self.scale)
        return ca.densify(rows) * ca.DM(weights)

    def _all_rows(self, motion: Motion) -> FloatArray:
        n = self.robot.n
        links = self.robot.rigid_body.regressor(motion.q, motion.dq, motion.ddq)[:, :, self._base]
        turning = self.robot.motors(motion)
        own = {
            "rotor-inertia": turning.ddq,
            "viscous": turning.dq,
            "coulomb": np.tanh(turning.dq / self.standstill),
        }
        diagonal = [own[kind][:, :, None] * np.eye(n) for kind in self.drives]
        rows: FloatArray = np.concatenate([links, *diagonal], axis=2) / self.noise[:, None]
        return rows


def _speed(robot: Robot) -> FloatArray:
    """Speed (n,) to which scales refer."""
    return np.minimum(robot.limits.velocity, FASTEST)


def _random_motion(robot: Robot, span: FloatArray) -> Motion:
    rng = np.random.default_rng(SEED)
    shape, speed = (SAMPLES, robot.n), _speed(robot)
    surge = np.where(np.isfinite(robot.limits.acceleration), robot.limits.acceleration, 5.0 * speed)
    q, dq, ddq = (rng.uniform(low, high, shape) for low, high in ((span[0], span[1]), (-speed, speed), (-surge, surge)))
    return Motion(np.arange(float(SAMPLES)), q, 0.5 * dq, 0.5 * ddq)


def _default_noise(robot: Robot, motion: Motion) -> FloatArray:
    body = robot.multibody
    torque = robot.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, body.parameters)
    largest = np.maximum(np.abs(torque).max(axis=0), 1e-9)
    return NOISE_SHARE * np.where(np.isfinite(robot.limits.effort), robot.limits.effort, largest)


def _independent(rows: FloatArray, first: int) -> IntArray:
    """The ``first`` columns, which are independent, and those after them that are no combination of ones before."""
    triangle = np.linalg.qr(rows / np.linalg.norm(rows, axis=0)).R
    basis = np.linalg.qr(triangle[:, :first]).Q
    chosen = list(range(first))
    for column in range(first, triangle.shape[1]):
        rest = triangle[:, column]
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        size = float(np.linalg.norm(rest))
        if size > ROUNDING:
            chosen.append(column)
            basis = np.column_stack([basis, rest / size])
    return np.array(chosen, dtype=np.int64)
