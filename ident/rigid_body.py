"""Rigid-body dynamics of whole logs, linear in the inertial parameters, with a set of parameters for each joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.base_parameters import BaseParameters, find_base_parameters
from ident.compiled import over_rows
from ident.link_motion import Chain
from ident.multibody import Multibody, Tree
from ident.rigid_body_kernels import inverse_dynamics_rows, mass_matrix_rows, momentum_rows, regressor_rows


@dataclass(frozen=True, eq=False)
class MomentumTerms:
    """What a momentum observer integrates, each (N, n): ``momentum`` M dq, ``coriolis_transpose`` C^T dq, ``gravity``.

    d(momentum)/dt = torque + coriolis_transpose - gravity (De Luca and Mattone 2003).
    """

    momentum: FloatArray
    coriolis_transpose: FloatArray
    gravity: FloatArray


class RigidBody:
    """Batch dynamics of a mechanism.

    Motions are (N, n) arrays [rad, rad/s, rad/s^2; prismatic m] in the order of ``multibody.joint_names``; one sample
    may be given as (n,), and the answer then has no N either. ``parameters`` are (10 n,), or (n, 10 n) with row j for
    joint j: in current units with unknown gains every joint has its own. ``gravity`` (3,) [m/s^2] in the base frame
    is the mechanism's unless given. Every method raises ValueError where a shape is wrong.

    Args:
        multibody: the mechanism.
    """

    def __init__(self, multibody: Multibody) -> None:
        self.multibody = multibody
        self._base: dict[int | None, BaseParameters] = {}
        tree = multibody.tree
        self.chain = Chain(
            tree.order, tree.parent, tree.prismatic, tree.axis, tree.rotation, tree.translation, _supports(tree)
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.multibody.n

    def regressor(
        self, q: FloatArray, dq: FloatArray, ddq: FloatArray, gravity: FloatArray | None = None
    ) -> FloatArray:
        """Regressor Y, (N, n, 10 n): joint torques are ``Y @ parameters`` (Khalil and Dombre 2002, ch. 12)."""
        motion = self._motion(q, dq, ddq)
        out = np.zeros((len(motion[0]), self.n, 10 * self.n))
        over_rows(regressor_rows, (self.chain, self._gravity(gravity)), *motion, out)
        return out if np.ndim(q) == 2 else out[0]

    def inverse_dynamics(
        self,
        q: FloatArray,
        dq: FloatArray,
        ddq: FloatArray,
        parameters: FloatArray,
        gravity: FloatArray | None = None,
    ) -> FloatArray:
        """Joint torques ``Y @ parameters``, (N, n), without Y in memory."""
        motion = self._motion(q, dq, ddq)
        out = np.empty(motion[0].shape)
        over_rows(
            inverse_dynamics_rows, (self.chain, self._gravity(gravity), self._per_joint(parameters)), *motion, out
        )
        return out if np.ndim(q) == 2 else out[0]

    def momentum_terms(
        self, q: FloatArray, dq: FloatArray, parameters: FloatArray, gravity: FloatArray | None = None
    ) -> MomentumTerms:
        """Generalised momentum, C^T dq and gravity torque, each (N, n)."""
        motion = self._motion(q, dq)
        out = np.empty((len(motion[0]), 3, self.n))
        over_rows(momentum_rows, (self.chain, self._gravity(gravity), self._per_joint(parameters)), *motion, out)
        terms = out if np.ndim(q) == 2 else out[0]
        return MomentumTerms(terms[..., 0, :], terms[..., 1, :], terms[..., 2, :])

    def mass_matrix(self, q: FloatArray, parameters: FloatArray) -> FloatArray:
        """Joint-space inertia matrix, (N, n, n); row j from row j of the parameters, symmetric where those agree."""
        (rows,) = self._motion(q)
        out = np.zeros((len(rows), self.n, self.n))
        over_rows(mass_matrix_rows, (self.chain, self._per_joint(parameters)), rows, out)
        return out if np.ndim(q) == 2 else out[0]

    def base_parameters(self, joint: int | None = None) -> BaseParameters:
        """Parameters that motion shows: of the whole robot, or of the row of one joint (counted from 0)."""
        if joint not in self._base:
            self._base[joint] = find_base_parameters(self, joint)
        return self._base[joint]

    def _motion(self, *arrays: FloatArray) -> list[FloatArray]:
        # The kernels check nothing: a wrong shape would read past the arrays' ends.
        shape = np.shape(arrays[0])
        if len(shape) not in (1, 2) or shape[-1] != self.n or any(np.shape(x) != shape for x in arrays):
            raise ValueError(f"motion of shapes {[np.shape(x) for x in arrays]}, expected (N, {self.n}) or ({self.n},)")
        return [np.ascontiguousarray(x, dtype=np.float64).reshape(-1, self.n) for x in arrays]

    def _gravity(self, gravity: FloatArray | None) -> FloatArray:
        if gravity is None:
            return self.multibody.gravity
        if np.shape(gravity) != (3,):
            raise ValueError(f"gravity of shape {np.shape(gravity)}, expected (3,)")
        return np.ascontiguousarray(gravity, dtype=np.float64)

    def _per_joint(self, parameters: FloatArray) -> FloatArray:
        if parameters.shape not in ((10 * self.n,), (self.n, 10 * self.n)):
            raise ValueError(f"parameters of shape {parameters.shape}, expected (10 n,) or (n, 10 n) with n = {self.n}")
        if parameters.ndim == 1:
            parameters = np.broadcast_to(parameters, (self.n, 10 * self.n))
        return np.ascontiguousarray(parameters, dtype=np.float64)


def _supports(tree: Tree) -> BoolArray:
    """Whether joint j carries link k, (n, n)."""
    n = len(tree.order)
    supports = np.eye(n, dtype=np.bool_)
    for k in tree.order:
        if tree.parent[k] >= 0:
            supports[:, k] |= supports[:, tree.parent[k]]
    return supports
