"""Rigid-body dynamics of whole logs, linear in the inertial parameters, with a set of parameters for each joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.base_parameters import BaseParameters, find_base_parameters
from ident.compiled import over_rows
from ident.coupling import Coupling
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

    Where gears couple joints, motions are the joints' and torques the motors': row j is what motor j gives, from the
    parameters of row j.

    Args:
        multibody: the mechanism.
        coupling: of its motors, if any.
    """

    def __init__(self, multibody: Multibody, coupling: Coupling | None = None) -> None:
        self.multibody, self.coupling = multibody, coupling
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
        if self.coupling is not None:
            out = np.einsum("kj,tkp->tjp", self.coupling.joints, out)
        return out if np.ndim(q) == 2 else out[0]

    def inverse_dynamics(
        self,
        q: FloatArray,
        dq: FloatArray,
        ddq: FloatArray,
        parameters: FloatArray,
        gravity: FloatArray | None = None,
        joint: int | None = None,
    ) -> FloatArray:
        """Joint torques ``Y @ parameters``, (N, n), without Y in memory; of one ``joint`` (from 0) alone (N,)."""
        motion, along = self._motion(q, dq, ddq), self._gravity(gravity)
        # Where gears couple joints, a motor's force is of several.
        alone = joint is not None and self.coupling is None
        asked = np.array([joint], dtype=np.int64) if alone else self.chain.order

        def torques(own: FloatArray) -> FloatArray:
            out = np.empty(motion[0].shape)
            over_rows(inverse_dynamics_rows, (self.chain, along, own, asked), *motion, out)
            return out

        out = self._of_motors(torques, self._per_joint(parameters))
        found = out if joint is None else out[:, joint]
        return found if np.ndim(q) == 2 else found[0]

    def momentum_terms(
        self, q: FloatArray, dq: FloatArray, parameters: FloatArray, gravity: FloatArray | None = None
    ) -> MomentumTerms:
        """Generalised momentum, C^T dq and gravity torque, each (N, n)."""
        motion, along = self._motion(q, dq), self._gravity(gravity)

        def rows(own: FloatArray) -> FloatArray:
            out = np.empty((len(motion[0]), 3, self.n))
            over_rows(momentum_rows, (self.chain, along, own), *motion, out)
            return out

        out = self._of_motors(rows, self._per_joint(parameters))
        terms = out if np.ndim(q) == 2 else out[0]
        return MomentumTerms(terms[..., 0, :], terms[..., 1, :], terms[..., 2, :])

    def mass_matrix(self, q: FloatArray, parameters: FloatArray) -> FloatArray:
        """Inertia matrix, (N, n, n); row j from row j of the parameters, symmetric where those agree.

        In joint space or, where gears couple joints, that of the motors.
        """
        (motion,) = self._motion(q)

        def columns(own: FloatArray) -> FloatArray:
            out = np.zeros((len(motion), self.n, self.n))
            over_rows(mass_matrix_rows, (self.chain, own), motion, out)
            # by columns, that the last axis is that of the force
            return out.transpose(0, 2, 1)

        out = self._of_motors(columns, self._per_joint(parameters)).transpose(0, 2, 1)
        if self.coupling is not None:
            out = out @ self.coupling.joints
        return out if np.ndim(q) == 2 else out[0]

    def base_parameters(self, joint: int | None = None) -> BaseParameters:
        """Parameters that motion shows: of the whole robot, or of the row of one joint (counted from 0)."""
        if joint not in self._base:
            self._base[joint] = find_base_parameters(self, joint)
        return self._base[joint]

    def _of_motors(self, forces: Callable[[FloatArray], FloatArray], parameters: FloatArray) -> FloatArray:
        """The motors' forces (..., n), each by its own row of the parameters, of what gives those of the joints."""
        out = forces(parameters)
        if self.coupling is not None:
            for j in self.coupling.mixed:
                own = np.ascontiguousarray(np.broadcast_to(parameters[j], parameters.shape))
                out[..., j] = self.coupling.motor_force(forces(own))[..., j]
        return out

    def _motion(self, *arrays: FloatArray) -> list[FloatArray]:
        # The kernels check nothing: a wrong shape would read past the arrays' ends.
        shape = np.shape(arrays[0])
        if len(shape) not in (1, 2) or shape[-1] != self.n or any(np.shape(x) != shape for x in arrays):
            raise ValueError(f"motion of shapes {[np.shape(x) for x in arrays]}, expected (N, {self.n}) or ({self.n},)")
        return [_for_kernels(x).reshape(-1, self.n) for x in arrays]

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
        return _for_kernels(parameters)


def _for_kernels(values: FloatArray) -> FloatArray:
    """Numbers in one piece of memory that could be written to, as those of logs cannot.

    For such every kernel would be compiled once more, which takes seconds.
    """
    # np.require does as much in ten times the time, and observers come by here at every sample.
    found = np.ascontiguousarray(values, dtype=np.float64)
    return found if found.flags.writeable else found.copy()


def _supports(tree: Tree) -> BoolArray:
    """Whether joint j carries link k, (n, n)."""
    n = len(tree.order)
    supports = np.eye(n, dtype=np.bool_)
    for k in tree.order:
        if tree.parent[k] >= 0:
            supports[:, k] |= supports[:, tree.parent[k]]
    return supports
