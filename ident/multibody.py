"""The robot's mechanism: the one typed adapter around Pinocchio, and the plain arrays the batch kernels walk."""

from __future__ import annotations

import copy
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.errors import InputError
from ident.urdf import Urdf, read_urdf

EARTH_GRAVITY = (0.0, 0.0, -9.81)
MASSLESS = 1e-12  # [kg] below this a link has no centre of mass to speak of


@dataclass(frozen=True, eq=False)
class Tree:
    """The kinematic tree as plain arrays, joints counted in the card's order.

    Attributes:
        order: joints such that each stands after its parent, (n,).
        parent: the joint each joint hangs on, -1 for the base, (n,).
        prismatic: whether each joint slides, (n,).
        axis: unit axis of each joint in its own frame, (n, 3).
        rotation, translation: fixed placement of each joint's frame (at q = 0) in its parent's joint frame, or in the
            base link for parent -1, (n, 3, 3) and (n, 3) [m]; ``rotation`` maps child coordinates to the parent's.
    """

    order: IntArray
    parent: IntArray
    prismatic: BoolArray
    axis: FloatArray
    rotation: FloatArray
    translation: FloatArray


@dataclass(frozen=True, eq=False)
class Multibody:
    """A fixed-base tree of revolute and prismatic joints; every array is in the order of ``joint_names``.

    Attributes:
        model: Pinocchio's model of the listed joints, the others locked at zero. One value a joint, continuous
            joints too; its joints may stand in another order (see ``model_index``).
        joint_names: the joints, in the card's order.
        lower, upper, velocity, effort: the URDF's limits [rad or m, per s, N m or N], (n,), inf where it has none.
        gravity: gravity in the base frame [m/s^2], (3,).
        parameters: inertial parameters of the URDF, (10 n,): per joint ``m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz,
            Izz`` of all that moves rigidly with it, about the origin of the joint's frame [kg, kg m, kg m^2].
        tree: the mechanism as plain arrays.
        model_index: where each joint stands in Pinocchio's q and v, (n,).
        tool_frame: the last body frame that the end of the chain carries.
        data: Pinocchio's workspace for the model.
    """

    model: Any
    joint_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    effort: FloatArray
    gravity: FloatArray
    parameters: FloatArray
    tree: Tree
    model_index: IntArray
    tool_frame: str
    data: Any

    @staticmethod
    def from_urdf(
        path: str | Path, joints: Sequence[str] | None = None, gravity: Sequence[float] = EARTH_GRAVITY
    ) -> Multibody:
        """Read a URDF; joints that are not named stay locked at zero. Meshes are neither needed nor looked for.

        Args:
            path: the URDF file.
            joints: joints in the order wanted; by default those that move and do not mimic, from the base outwards.
            gravity: gravity in the base frame [m/s^2].

        Raises:
            InputError: the file is missing or unreadable, a joint is of a kind other than revolute, continuous or
                prismatic, or a named joint is not there.
        """
        urdf = read_urdf(Path(path))
        full = _build(urdf)
        names = urdf.choose(joints, list(full.names)[1:])
        locked = [index for index, name in enumerate(full.names) if index > 0 and name not in names]
        model = _reduced(full, locked)
        model.gravity = pin.Motion(np.asarray(gravity, dtype=float), np.zeros(3))
        limits = urdf.limits(names)
        index = np.array([model.joints[model.getJointId(name)].idx_v for name in names], dtype=np.int64)
        model.lowerPositionLimit[index], model.upperPositionLimit[index] = limits[:2]
        return Multibody(
            model,
            names,
            *limits,
            np.array(gravity, dtype=float),
            _parameters(model, names),
            _tree(model, names),
            index,
            _tool_frame(model),
            model.createData(),
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def prismatic(self) -> BoolArray:
        """Whether each joint slides, (n,)."""
        return self.tree.prismatic

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all links, joints and other frames."""
        return tuple(frame.name for frame in self.model.frames)

    def with_parameters(self, parameters: FloatArray) -> Multibody:
        """Return the mechanism with other inertial parameters (10 n,), e.g. identified ones.

        Raises:
            InputError: a link has a first moment but no mass, which Pinocchio cannot hold.
        """
        model = self.model.copy()
        for name, values in zip(self.joint_names, np.reshape(parameters, (self.n, 10)), strict=True):
            model.inertias[model.getJointId(name)] = _inertia(values, name)
        changed = copy.copy(self)
        fields = {"model": model, "parameters": np.array(parameters, dtype=float).ravel(), "data": model.createData()}
        for field, value in fields.items():
            object.__setattr__(changed, field, value)
        return changed

    def inverse_dynamics(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """Joint torques [N m, N] of one motion sample by recursive Newton-Euler; all (n,)."""
        tau = pin.rnea(self.model, self.data, self._in_model(q), self._in_model(dq), self._in_model(ddq))
        return np.array(tau)[self.model_index]

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Joint-space inertia matrix, (n, n)."""
        mass: FloatArray = np.triu(pin.crba(self.model, self.data, self._in_model(q)))
        mass = mass + np.triu(mass, 1).T
        return mass[np.ix_(self.model_index, self.model_index)]

    def coriolis_matrix(self, q: FloatArray, dq: FloatArray) -> FloatArray:
        """Coriolis matrix C in Christoffel form, dM/dt = C + C^T, (n, n)."""
        matrix = pin.computeCoriolisMatrix(self.model, self.data, self._in_model(q), self._in_model(dq))
        return np.array(matrix)[np.ix_(self.model_index, self.model_index)]

    def gravity_torque(self, q: FloatArray) -> FloatArray:
        """Joint torques that hold the robot still against gravity, (n,)."""
        torque = pin.computeGeneralizedGravity(self.model, self.data, self._in_model(q))
        return np.array(torque)[self.model_index]

    def frame_pose(self, q: FloatArray, frame: str | None = None) -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and position (3,) [m] of a frame (default: the tool's) in the base.

        Raises:
            InputError: no frame has that name.
        """
        frame_id = self._frame_id(frame)
        pin.framesForwardKinematics(self.model, self.data, self._in_model(q))
        pose = self.data.oMf[frame_id]
        return np.array(pose.rotation), np.array(pose.translation)

    def frame_jacobian(self, q: FloatArray, frame: str | None = None) -> FloatArray:
        """Jacobian [linear; angular] of a frame's origin (default: the tool's) in base axes, (6, n).

        Raises:
            InputError: no frame has that name.
        """
        frame_id = self._frame_id(frame)
        aligned = pin.LOCAL_WORLD_ALIGNED
        jacobian = pin.computeFrameJacobian(self.model, self.data, self._in_model(q), frame_id, aligned)
        return np.array(jacobian)[:, self.model_index]

    def _in_model(self, values: FloatArray) -> FloatArray:
        ordered = np.empty(self.n)
        ordered[self.model_index] = values
        return ordered

    def _frame_id(self, frame: str | None) -> int:
        # getFrameId answers an unknown name with the number of frames, so the name is looked for first
        name = self.tool_frame if frame is None else frame
        if not self.model.existFrame(name):
            known = ", ".join(f.name for f in self.model.frames if f.type == pin.FrameType.BODY)
            raise InputError(f"no frame {name!r}", f"robot {self.model.name}", f"name one of its links: {known}")
        return int(self.model.getFrameId(name))


def _build(urdf: Urdf) -> Any:
    """Let Pinocchio read the URDF; its reason for a refusal is only on standard error."""
    with _standard_error() as said:
        try:
            return _renamed(pin.buildModelFromXML(urdf.text))
        except Exception as error:
            reason = str(error)
    lines = [line.removeprefix("Error:").strip() for line in (said[0] if said else "").splitlines()]
    why = "; ".join(line for line in lines if line and not line.startswith("at line")) or reason
    raise InputError(f"not a URDF that Pinocchio can read ({why})", str(urdf.path), "mend the file")


def _renamed(model: Any) -> Any:
    """Give frames of joints that have a link's name one of their own.

    URDF allows the same name, and so does Pinocchio until it looks for one of them.
    """
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for frame in model.frames:
        if frame.type != pin.FrameType.BODY and frame.name in links:
            frame.name = f"{frame.name} (joint)"
    return model


def _reduced(model: Any, locked: list[int]) -> Any:
    """The model without some joints, which become frames under the names of their joints."""
    for frame in model.frames:
        if frame.type == pin.FrameType.JOINT and frame.parentJoint in locked:
            model.names[frame.parentJoint] = frame.name
    return pin.buildReducedModel(model, locked, pin.neutral(model))


@contextmanager
def _standard_error() -> Iterator[list[str]]:
    """Collect what the C++ side writes to file descriptor 2; the list is filled on exit."""
    said: list[str] = []
    with tempfile.TemporaryFile() as sink:
        kept = os.dup(2)
        os.dup2(sink.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            sink.seek(0)
            said.append(sink.read().decode(errors="replace"))


def _tree(model: Any, names: tuple[str, ...]) -> Tree:
    ids = [model.getJointId(name) for name in names]
    card = {model_id: index for index, model_id in enumerate(ids)}
    placements = [model.jointPlacements[i] for i in ids]
    twists = np.array([_own_twist(model, i) for i in ids]).reshape(-1, 2, 3)
    prismatic = np.linalg.norm(twists[:, 0], axis=1) > 0.5
    return Tree(
        order=np.argsort(ids).astype(np.int64),
        parent=np.array([card.get(model.parents[i], -1) for i in ids], dtype=np.int64),
        prismatic=prismatic,
        axis=np.where(prismatic[:, None], twists[:, 0], twists[:, 1]),
        rotation=np.array([p.rotation for p in placements]),
        translation=np.array([p.translation for p in placements]),
    )


def _own_twist(model: Any, joint_id: int) -> FloatArray:
    """Twist [linear, angular] of a joint at unit speed, in its own frame, the other joints at rest."""
    speed = np.zeros(model.nv)
    speed[model.joints[joint_id].idx_v] = 1.0
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model), speed)
    return np.array(data.v[joint_id].vector)


def _parameters(model: Any, names: tuple[str, ...]) -> FloatArray:
    return np.concatenate([model.inertias[model.getJointId(name)].toDynamicParameters() for name in names])


def _inertia(values: FloatArray, name: str) -> Any:
    if abs(values[0]) > MASSLESS:
        return pin.Inertia.FromDynamicParameters(values)
    if np.any(np.abs(values[1:4]) > MASSLESS):
        what = f"the link of joint {name} has a first moment but no mass"
        raise InputError(what, "inertial parameters", "take a feasible set of parameters")
    ixx, ixy, iyy, ixz, iyz, izz = values[4:]
    return pin.Inertia(0.0, np.zeros(3), np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]))


def _tool_frame(model: Any) -> str:
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == model.njoints - 1]
    return str(bodies[-1].name)
