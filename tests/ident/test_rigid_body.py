"""The compiled loops, against Pinocchio sample by sample."""

import numpy as np
import pytest

from ident.compiled import CHUNK
from ident.multibody import Multibody
from ident.rigid_body import RigidBody

ROBOTS = ["ur5", "panda", "xarm7", "vs060"]

BRANCHED = """<robot name="branched"><link name="base"/>
{links}
<joint name="a" type="revolute"><parent link="base"/><child link="la"/><origin xyz=".1 .2 .3" rpy=".3 -.4 .5"/>
  <axis xyz=".6 0 .8"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="b" type="prismatic"><parent link="la"/><child link="lb"/><origin xyz="-.2 .1 .4" rpy="1 .2 -.7"/>
  <axis xyz="0 .6 .8"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="c" type="revolute"><parent link="lb"/><child link="lc"/><origin xyz=".3 .1 .1" rpy="-.4 .9 .1"/>
  <axis xyz="0 -1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="d" type="revolute"><parent link="la"/><child link="ld"/><origin xyz="0 .1 -.3" rpy=".4 .2 .2"/>
  <axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint></robot>"""
LINK = """<link name="l{}"><inertial><origin xyz=".1 -.05 .2"/><mass value="{}"/>
  <inertia ixx=".3" ixy=".01" ixz="-.02" iyy=".4" iyz=".03" izz=".5"/></inertial></link>"""


@pytest.fixture(params=[*ROBOTS, "branched"])
def body(request, urdf_path, arm_joints, tmp_path):
    """Arms, and a tree with a sliding joint, skew axes and a card order that is not the tree's."""
    if request.param != "branched":
        return Multibody.from_urdf(urdf_path(request.param), arm_joints(request.param))
    path = tmp_path / "branched.urdf"
    path.write_text(BRANCHED.format(links="".join(LINK.format(x, k + 1) for k, x in enumerate("abcd"))))
    return Multibody.from_urdf(path, ["c", "d", "a", "b"], gravity=(0.5, -1.0, -9.6))


@pytest.fixture
def motion(body, rng):
    return rng.normal(size=(3, 30, body.n))


def test_regressor_and_inverse_dynamics_are_those_of_pinocchio(body, motion):
    rigid_body = RigidBody(body)
    expected = np.array([body.inverse_dynamics(*sample) for sample in zip(*motion, strict=True)])
    np.testing.assert_allclose(rigid_body.regressor(*motion) @ body.parameters, expected, atol=1e-11)
    np.testing.assert_allclose(rigid_body.inverse_dynamics(*motion, body.parameters), expected, atol=1e-11)
    for j, of_joint in enumerate(expected.T):
        np.testing.assert_allclose(rigid_body.inverse_dynamics(*motion, body.parameters, joint=j), of_joint, atol=1e-11)


def test_momentum_terms_and_mass_matrix_are_those_of_pinocchio(body, motion):
    q, dq, _ = motion
    mass = np.array([body.mass_matrix(x) for x in q])
    coriolis = np.array([body.coriolis_matrix(x, v) for x, v in zip(q, dq, strict=True)])
    rigid_body = RigidBody(body)
    terms = rigid_body.momentum_terms(q, dq, body.parameters)
    np.testing.assert_allclose(rigid_body.mass_matrix(q, body.parameters), mass, atol=1e-11)
    np.testing.assert_allclose(terms.momentum, np.einsum("tij,tj->ti", mass, dq), atol=1e-11)
    np.testing.assert_allclose(terms.coriolis_transpose, np.einsum("tji,tj->ti", coriolis, dq), atol=1e-11)
    np.testing.assert_allclose(terms.gravity, [body.gravity_torque(x) for x in q], atol=1e-11)


def test_every_joint_may_have_parameters_of_its_own(body, motion, rng):
    q, dq, ddq = motion
    rigid_body = RigidBody(body)
    own = rng.normal(size=(body.n, 10 * body.n))
    regressor = rigid_body.regressor(q, dq, ddq)
    np.testing.assert_allclose(
        rigid_body.inverse_dynamics(q, dq, ddq, own), np.einsum("tjc,jc->tj", regressor, own), atol=1e-9
    )
    mass, terms = rigid_body.mass_matrix(q, own), rigid_body.momentum_terms(q, dq, own)
    for j in range(body.n):
        np.testing.assert_allclose(mass[:, j], rigid_body.mass_matrix(q, own[j])[:, j], atol=1e-12)
        shared = rigid_body.momentum_terms(q, dq, own[j])
        for field in ("momentum", "coriolis_transpose", "gravity"):
            np.testing.assert_allclose(getattr(terms, field)[:, j], getattr(shared, field)[:, j], atol=1e-12)


def test_momentum_changes_by_torque_coriolis_and_gravity(body, motion, rng):
    """d(M dq)/dt = torque + C^T dq - g holds row by row with parameters that no one body could have."""
    q, dq, ddq = motion
    rigid_body = RigidBody(body)
    own = rng.normal(size=(body.n, 10 * body.n))
    step = 1e-6
    after = rigid_body.momentum_terms(q + step * dq, dq + step * ddq, own).momentum
    before = rigid_body.momentum_terms(q - step * dq, dq - step * ddq, own).momentum
    terms = rigid_body.momentum_terms(q, dq, own)
    expected = rigid_body.inverse_dynamics(q, dq, ddq, own) + terms.coriolis_transpose - terms.gravity
    np.testing.assert_allclose((after - before) / (2 * step), expected, rtol=1e-6, atol=1e-5)


def test_gravity_given_replaces_that_of_the_mechanism(body, motion):
    rigid_body = RigidBody(body)
    still = np.zeros_like(motion[0])
    rest = rigid_body.inverse_dynamics(motion[0], still, still, body.parameters)
    np.testing.assert_allclose(
        rigid_body.inverse_dynamics(motion[0], still, still, body.parameters, gravity=2.0 * body.gravity), 2.0 * rest
    )
    terms = rigid_body.momentum_terms(motion[0], still, body.parameters, gravity=np.zeros(3))
    np.testing.assert_array_equal(terms.gravity, 0.0)


def test_one_sample_and_many_agree_to_the_bit(urdf_path, rng):
    body = Multibody.from_urdf(urdf_path("vs060"))
    rigid_body = RigidBody(body)
    q, dq, ddq = rng.normal(size=(3, 2 * CHUNK + 5, body.n))  # more than one thread's share, and a rest
    pi = body.parameters
    rows = [0, CHUNK - 1, CHUNK, len(q) - 1]
    regressor, torque = rigid_body.regressor(q, dq, ddq), rigid_body.inverse_dynamics(q, dq, ddq, pi)
    terms, mass = rigid_body.momentum_terms(q, dq, pi), rigid_body.mass_matrix(q, pi)
    for k in rows:
        np.testing.assert_array_equal(rigid_body.regressor(q[k], dq[k], ddq[k]), regressor[k])
        np.testing.assert_array_equal(rigid_body.inverse_dynamics(q[k], dq[k], ddq[k], pi), torque[k])
        np.testing.assert_array_equal(rigid_body.momentum_terms(q[k], dq[k], pi).momentum, terms.momentum[k])
        np.testing.assert_array_equal(rigid_body.mass_matrix(q[k], pi), mass[k])


def test_arrays_of_any_memory_layout_are_read(urdf_path, rng):
    body = Multibody.from_urdf(urdf_path("vs060"))
    q, dq, ddq = rng.normal(size=(3, 10, body.n))
    q32 = q.astype(np.float32)
    rigid_body = RigidBody(body)
    expected = rigid_body.regressor(q32.astype(float), dq, ddq)
    np.testing.assert_array_equal(rigid_body.regressor(q32, np.asfortranarray(dq), ddq[::-1][::-1]), expected)
    frozen = q.copy()
    frozen.flags.writeable = False
    np.testing.assert_array_equal(rigid_body.regressor(frozen, dq, ddq), rigid_body.regressor(q, dq, ddq))


def test_wrong_shapes_are_refused(urdf_path):
    rigid_body = RigidBody(Multibody.from_urdf(urdf_path("vs060")))
    six, five = np.zeros((4, 6)), np.zeros((4, 5))
    with pytest.raises(ValueError, match="motion of shapes"):
        rigid_body.regressor(five, five, five)
    with pytest.raises(ValueError, match="motion of shapes"):
        rigid_body.momentum_terms(six, six[:3], np.zeros(60))
    with pytest.raises(ValueError, match="parameters of shape"):
        rigid_body.mass_matrix(six, np.zeros(59))
    with pytest.raises(ValueError, match="gravity of shape"):
        rigid_body.regressor(six, six, six, gravity=np.zeros(2))


def test_a_slider_feels_only_its_mass_along_its_axis(tmp_path):
    path = tmp_path / "slider.urdf"
    path.write_text(
        """<robot name="slider"><link name="rail"/><link name="cart"/><joint name="slide" type="prismatic">
        <parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
    )
    rigid_body = RigidBody(Multibody.from_urdf(path))
    parameters = np.array([95.0, *np.zeros(9)])
    motion = np.array([[0.1]]), np.array([[3.0]]), np.array([[2.0]])
    np.testing.assert_allclose(rigid_body.inverse_dynamics(*motion, parameters), [[190.0]])
    np.testing.assert_allclose(rigid_body.momentum_terms(*motion[:2], parameters).momentum, [[285.0]])
    assert rigid_body.base_parameters().names == ["m1"]
