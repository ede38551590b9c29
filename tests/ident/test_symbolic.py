"""Symbolic dynamics against Pinocchio, and their derivatives against finite differences."""

from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from ident.arrays import FloatArray
from ident.multibody import Multibody
from ident.symbolic import base_poses, inverse_dynamics, regressor

ROBOTS = ["ur5", "panda", "xarm7", "vs060"]

Find = Callable[[str], Path]
Joints = Callable[[str], list[str] | None]


@pytest.fixture(params=ROBOTS)
def arm(request: pytest.FixtureRequest, urdf_path: Find, arm_joints: Joints) -> Multibody:
    return Multibody.from_urdf(urdf_path(request.param), arm_joints(request.param), gravity=(1.0, -2.0, -9.3))


def symbols(n: int) -> list[ca.SX]:
    return [ca.SX.sym(name, n) for name in ("q", "dq", "ddq")]


def closeness(a: FloatArray, b: FloatArray) -> float:
    return float(np.max(np.abs(a - b)) / np.max(np.abs(b)))


def test_inverse_dynamics_equals_pinocchio(arm: Multibody, rng: np.random.Generator) -> None:
    motion = symbols(arm.n)
    torque = ca.Function("f", motion, [inverse_dynamics(arm.tree, arm.gravity, arm.parameters, *motion)])
    for _ in range(20):
        q, dq, ddq = rng.uniform(-3, 3, (3, arm.n))
        assert closeness(torque(q, dq, ddq).full()[:, 0], arm.inverse_dynamics(q, dq, ddq)) < 1e-11


def test_regressor_equals_pinocchio(arm: Multibody, rng: np.random.Generator) -> None:
    motion = symbols(arm.n)
    rows = ca.Function("f", motion, [regressor(arm.tree, arm.gravity, *motion)])
    for _ in range(20):
        q, dq, ddq = rng.uniform(-3, 3, (3, arm.n))
        wanted = pin.computeJointTorqueRegressor(arm.model, arm.data, q, dq, ddq)  # these robots keep the card's order
        assert closeness(rows(q, dq, ddq).full(), np.array(wanted)) < 1e-11


def test_poses_equal_pinocchio(arm: Multibody, rng: np.random.Generator) -> None:
    q = ca.SX.sym("q", arm.n)
    poses = ca.Function("f", [q], [ca.vertcat(*[origin for _, origin in base_poses(arm.tree, q)])])
    at = rng.uniform(-3, 3, arm.n)
    wanted = [arm.frame_pose(at, name)[1] for name in arm.joint_names]
    assert closeness(poses(at).full()[:, 0], np.concatenate(wanted)) < 1e-12


@pytest.mark.parametrize("arm", ["ur5", "vs060"], indirect=True)
def test_derivatives_equal_finite_differences(arm: Multibody, rng: np.random.Generator) -> None:
    motion = symbols(arm.n)
    x = ca.vertcat(*motion)
    for value in (
        inverse_dynamics(arm.tree, arm.gravity, arm.parameters, *motion),
        ca.vec(ca.densify(regressor(arm.tree, arm.gravity, *motion))),
    ):
        f, jacobian = ca.Function("f", [x], [value]), ca.Function("j", [x], [ca.jacobian(value, x)])
        at, along, step = rng.uniform(-2, 2, 3 * arm.n), rng.standard_normal(3 * arm.n), 1e-5
        difference = (f(at + step * along) - f(at - step * along)).full()[:, 0] / (2 * step)
        assert closeness((jacobian(at) @ along).full()[:, 0], difference) < 1e-7


LINK = (
    "<link name='l{0}'><inertial><origin xyz='.1 .2 .3'/><mass value='2'/>"
    "<inertia ixx='.3' ixy='.01' ixz='.02' iyy='.4' iyz='.03' izz='.5'/></inertial></link>"
)
JOINT = (
    "<joint name='j{0}' type='{1}'><parent link='l{2}'/><child link='l{0}'/><axis xyz='{3}'/>"
    "<origin xyz='.1 .3 .2' rpy='.3 .2 .1'/><limit lower='-1' upper='1' velocity='1' effort='1'/></joint>"
)


def test_tree_with_branches_and_sliding_joints(tmp_path: Path, rng: np.random.Generator) -> None:
    links = "".join(LINK.format(k) for k in range(4))
    joints = [(1, "prismatic", 0, "0 1 0"), (2, "revolute", 1, "0.6 0 0.8"), (3, "revolute", 1, "1 0 0")]
    path = tmp_path / "tree.urdf"
    path.write_text(f"<robot name='tree'>{links}{''.join(JOINT.format(*joint) for joint in joints)}</robot>")
    arm = Multibody.from_urdf(path, ["j3", "j1", "j2"])
    motion = symbols(arm.n)
    values = [
        inverse_dynamics(arm.tree, arm.gravity, arm.parameters, *motion),
        regressor(arm.tree, arm.gravity, *motion) @ arm.parameters,
    ]
    for value in values:
        torque = ca.Function("f", motion, [value])
        q, dq, ddq = rng.uniform(-1, 1, (3, arm.n))
        assert closeness(torque(q, dq, ddq).full()[:, 0], arm.inverse_dynamics(q, dq, ddq)) < 1e-12
