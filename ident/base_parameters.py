"""Which combinations of inertial parameters a robot's motion shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from ident.multibody import Multibody
    from ident.rigid_body import RigidBody

PARAMETER_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
SEED = 0
SAMPLES_PER_COLUMN = 3
ROUNDING = 1e-5  # what a URDF's 1.5708 for pi/2 opens between columns that are dependent (7e-6 seen) is no information
ROTOR = 1e-3  # share of a rotor's column that must be its own for it to be told from the links'
ZERO = 1e-9  # coefficient, of unit columns, that is numerical noise
FARTHEST = 20.0  # [rad or m]; a limit beyond is none
SPEED, ACCELERATION = 2.0, 10.0  # [rad/s, rad/s^2; m/s, m/s^2], so that links, their turning and gravity weigh alike


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """The identifiable combinations of a regressor W's parameters pi: ``W @ pi == W[:, columns] @ projection @ pi``.

    Attributes:
        columns: parameters that stand for a combination each, in rising order, (b,).
        projection: what each combination is made of, (b, 10 n); the identity on ``columns``.
        names: the parameters that stand for the combinations, joints from 1: ``m3``, ``mx4``, ``Ixx2``.
        combinations: each combination written out but for its smallest terms, ``Ixx2 - Iyy2 + 0.0934 m3``; SI units.
    """

    columns: IntArray
    projection: FloatArray
    names: list[str]
    combinations: list[str]


def find_base_parameters(rigid_body: RigidBody, joint: int | None = None) -> BaseParameters:
    """Base parameters by QR of a random regressor (Gautier 1991), of the whole robot or of one joint's row.

    Columns are taken from the base outwards, in Pinocchio's order within a link, and kept where those before them
    leave something open. What depends on them is regrouped towards the base, as in the closed forms of Gautier and
    Khalil (1990). The motion is drawn within the limits of the angles with a fixed seed, so the answer is always
    the same; it depends on the mechanism's gravity, which decides what the first joints show. ``W @ pi == W_b @
    projection @ pi`` holds to rounding, that of the URDF's angles where they are written to six figures.

    Args:
        rigid_body: the mechanism's dynamics.
        joint: whose row, from 0; None for the whole robot.
    """
    regressor = _random_regressor(rigid_body, joint)
    scale = np.linalg.norm(regressor, axis=0)
    seen = scale > ROUNDING * scale.max(initial=0.0)
    unit = np.divide(regressor, scale, where=seen, out=np.zeros_like(regressor))
    triangle: FloatArray = np.linalg.qr(unit).R
    columns = _independent(triangle, _from_the_base(rigid_body.multibody), seen)
    weights = np.linalg.lstsq(triangle[:, columns], triangle, rcond=None)[0]
    weights[np.abs(weights) < ZERO] = 0.0
    weights[:, columns] = np.eye(len(columns))
    projection = weights * scale / scale[columns, None]
    names = [f"{name}{joint + 1}" for joint in range(rigid_body.n) for name in PARAMETER_NAMES]
    return BaseParameters(
        columns, projection, [names[c] for c in columns], [_written(row, names) for row in projection]
    )


def rotor_shows(rigid_body: RigidBody, joint: int) -> bool:
    """Whether a joint's row tells its rotor's inertia from its links'.

    It does not where no other joint turns the link about the joint's own axis: both are then one factor of ddq.

    Args:
        rigid_body: the mechanism's dynamics.
        joint: from 0.
    """
    regressor, ddq = _random_motion(rigid_body)
    row, own = regressor[:, joint], ddq[:, joint]
    scale = np.linalg.norm(row, axis=0)
    unit = row[:, scale > 0.0] / scale[scale > 0.0]
    left = own - unit @ np.linalg.lstsq(unit, own, rcond=ROUNDING)[0]
    return bool(np.linalg.norm(left) > ROTOR * np.linalg.norm(own))


def _random_regressor(rigid_body: RigidBody, joint: int | None) -> FloatArray:
    """Regressor of random motions inside the limits, (rows, 10 n)."""
    rows, _ = _random_motion(rigid_body)
    return rows.reshape(-1, 10 * rigid_body.n) if joint is None else rows[:, joint]


def _random_motion(rigid_body: RigidBody) -> tuple[FloatArray, FloatArray]:
    """Regressor (samples, n, 10 n) and the motors' accelerations (samples, n) of random motions inside the limits."""
    body = rigid_body.multibody
    n = rigid_body.n
    rng = np.random.default_rng(SEED)
    shape = (SAMPLES_PER_COLUMN * 10 * n, n)
    free = np.where(body.prismatic, 1.0, np.pi)  # where the URDF sets no limit: a turn, or a metre either way
    lower, upper = (
        np.where(np.abs(limit) > FARTHEST, at, limit) for limit, at in ((body.lower, -free), (body.upper, free))
    )
    q = rng.uniform(lower, upper, shape)
    # Not the URDF's speeds: beside what 1e4 rad/s ask for, written where there is no limit, gravity would be rounding.
    dq = rng.uniform(-SPEED, SPEED, shape)
    ddq = rng.uniform(-ACCELERATION, ACCELERATION, shape)
    coupling = rigid_body.coupling
    return rigid_body.regressor(q, dq, ddq), ddq if coupling is None else coupling.motor_motion(ddq)


def _from_the_base(body: Multibody) -> IntArray:
    return np.concatenate([np.arange(10 * k, 10 * k + 10) for k in body.tree.order])


def _independent(triangle: FloatArray, order: IntArray, candidates: FloatArray) -> IntArray:
    """Columns that are not combinations of those before them in ``order`` (Gram-Schmidt, done twice to be exact)."""
    basis = np.zeros((len(triangle), 0))
    chosen = []
    for column in order:
        rest = triangle[:, column]
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        size = np.linalg.norm(rest)
        if candidates[column] and size > ROUNDING:
            chosen.append(column)
            basis = np.column_stack([basis, rest / size])
    return np.array(sorted(chosen), dtype=np.int64)


def _written(row: FloatArray, names: list[str]) -> str:
    terms = ""
    for index in np.flatnonzero(np.abs(row) > ROUNDING):
        size = abs(row[index])
        factor = "" if np.isclose(size, 1.0, rtol=1e-9) else f"{size:.4g} "
        sign = "-" if row[index] < 0 else "+"
        terms += f" {sign} {factor}{names[index]}"
    return terms.removeprefix(" + ").lstrip()
