"""The Pinocchio adapter, against MuJoCo and by hand."""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest

from ident.errors import InputError
from ident.multibody import Multibody

ROBOTS = ["ur5", "panda", "xarm7", "vs060"]

SLIDER = """<robot name="slider"><link name="rail"/><link name="cart">
  <inertial><mass value="95"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" effort="0" velocity="0"/></joint></robot>"""

LINK = """<link name="{0}"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
  <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>"""
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0 0 0.3"/>
  <axis xyz="0 1 0"/>{4}</joint>"""
LIMIT = '<limit lower="-1" upper="1" effort="9" velocity="2"/>'


def two_joints(tmp_path: Path, kind: str = "revolute", extra: str = LIMIT) -> Path:
    """A base and two links; the second joint is of the kind given."""
    links = "".join(LINK.format(name) for name in ("base", "upper", "fore"))
    joints = JOINT.format("shoulder", "revolute", "base", "upper", LIMIT)
    joints += JOINT.format("elbow", kind, "upper", "fore", extra)
    path = tmp_path / "two.urdf"
    path.write_text(f'<robot name="two">{links}{joints}</robot>')
    return path


def mujoco_model(path: Path, joints: tuple[str, ...]) -> mujoco.MjModel:
    root = ET.parse(path).getroot()
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for joint in root.findall("joint"):
        if joint.get("name") not in joints:
            joint.set("type", "fixed")
    compiler = {"balanceinertia": "false", "inertiafromgeom": "false", "discardvisual": "true"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", compiler)
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    model.dof_armature[:] = 0.0
    return model


@pytest.mark.parametrize("name", ROBOTS)
def test_inverse_dynamics_and_mass_matrix_agree_with_mujoco(name, urdf_path, arm_joints, rng):
    body = Multibody.from_urdf(urdf_path(name), arm_joints(name))
    model = mujoco_model(urdf_path(name), body.joint_names)
    data = mujoco.MjData(model)
    at = [model.joint(joint).dofadr[0] for joint in body.joint_names]
    assert model.nv == body.n
    for _ in range(20):
        q, dq, ddq = rng.normal(size=(3, body.n))
        data.qpos[at], data.qvel[at], data.qacc[at] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(body.inverse_dynamics(q, dq, ddq), data.qfrc_inverse[at], atol=1e-9)
        product = np.zeros(model.nv)
        mujoco.mj_mulM(model, data, product, data.qacc)
        np.testing.assert_allclose(body.mass_matrix(q) @ ddq, product[at], atol=1e-9)


def test_dynamics_terms_add_up_to_inverse_dynamics(urdf_path, rng):
    body = Multibody.from_urdf(urdf_path("ur10"))
    q, dq, ddq = rng.normal(size=(3, body.n))
    total = body.mass_matrix(q) @ ddq + body.coriolis_matrix(q, dq) @ dq + body.gravity_torque(q)
    np.testing.assert_allclose(total, body.inverse_dynamics(q, dq, ddq), atol=1e-10)


def test_the_order_of_the_card_holds_everywhere(urdf_path, rng):
    body = Multibody.from_urdf(urdf_path("vs060"))
    mixed_order = [3, 0, 5, 1, 4, 2]
    mixed = Multibody.from_urdf(urdf_path("vs060"), [body.joint_names[k] for k in mixed_order])
    q, dq, ddq = rng.normal(size=(3, body.n))
    pose, mixed_pose = body.frame_pose(q), mixed.frame_pose(q[mixed_order])
    np.testing.assert_allclose(
        mixed.inverse_dynamics(q[mixed_order], dq[mixed_order], ddq[mixed_order]),
        body.inverse_dynamics(q, dq, ddq)[mixed_order],
        atol=1e-12,
    )
    np.testing.assert_allclose(
        mixed.coriolis_matrix(q[mixed_order], dq[mixed_order]),
        body.coriolis_matrix(q, dq)[np.ix_(mixed_order, mixed_order)],
        atol=1e-12,
    )
    np.testing.assert_allclose(mixed_pose[1], pose[1], atol=1e-12)
    np.testing.assert_allclose(mixed.frame_jacobian(q[mixed_order]), body.frame_jacobian(q)[:, mixed_order], atol=1e-12)
    np.testing.assert_array_equal(mixed.velocity, body.velocity[mixed_order])
    np.testing.assert_array_equal(mixed.parameters.reshape(6, 10), body.parameters.reshape(6, 10)[mixed_order])
    parents = [mixed.joint_names[p] if p >= 0 else "base" for p in mixed.tree.parent[mixed.tree.order]]
    assert parents == ["base", "joint_1", "joint_2", "joint_3", "joint_4", "joint_5"]


def test_frame_jacobian_is_the_derivative_of_the_pose(urdf_path, rng):
    body = Multibody.from_urdf(urdf_path("panda"))
    q = rng.normal(size=body.n)
    frame = "panda_link5"
    jacobian = body.frame_jacobian(q, frame)
    step = 1e-6
    for j in range(body.n):
        shift = step * np.eye(body.n)[j]
        (after, ahead), (before, behind) = body.frame_pose(q + shift, frame), body.frame_pose(q - shift, frame)
        np.testing.assert_allclose(jacobian[:3, j], (ahead - behind) / (2 * step), atol=1e-8)
        spin = (after - before) / (2 * step) @ body.frame_pose(q, frame)[0].T
        np.testing.assert_allclose(jacobian[3:, j], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


def test_tool_frames_are_those_at_the_end_of_the_chain(urdf_path, arm_joints):
    tools = {name: Multibody.from_urdf(urdf_path(name), arm_joints(name)).tool_frame for name in ROBOTS}
    assert tools == {"ur5": "tool0", "panda": "panda_hand_tcp", "xarm7": "link_eef", "vs060": "tool0"}


def test_a_slider_is_a_robot(tmp_path):
    path = tmp_path / "slider.urdf"
    path.write_text(SLIDER)
    body = Multibody.from_urdf(path)
    assert body.prismatic.tolist() == [True]
    np.testing.assert_allclose(body.inverse_dynamics(np.zeros(1), np.ones(1), np.full(1, 2.0)), [190.0])
    assert np.isinf(body.velocity).all()  # a speed limit of nought is none
    assert np.isinf(body.effort).all()


def test_a_continuous_joint_is_one_unlimited_angle(tmp_path):
    body = Multibody.from_urdf(two_joints(tmp_path, "continuous", ""))
    limited = Multibody.from_urdf(two_joints(tmp_path))
    assert (body.lower[1], body.upper[1]) == (-np.inf, np.inf)
    q = np.array([0.3, 7.0])
    np.testing.assert_allclose(body.gravity_torque(q), limited.gravity_torque(q))


@pytest.mark.parametrize("link", ["base", "upper", "fore"])
@pytest.mark.parametrize("kind", ["revolute", "fixed"])
def test_a_joint_may_have_a_links_name(tmp_path, kind, link):
    named_apart = two_joints(tmp_path, kind)
    plain = Multibody.from_urdf(named_apart, ["shoulder"])
    named_apart.write_text(named_apart.read_text().replace('name="elbow"', f'name="{link}"'))
    alike = Multibody.from_urdf(named_apart, ["shoulder"])
    np.testing.assert_allclose(alike.gravity_torque(np.ones(1)), plain.gravity_torque(np.ones(1)))
    assert link in alike.frame_names
    if kind == "revolute":
        assert Multibody.from_urdf(named_apart).joint_names == ("shoulder", link)


def test_joints_not_named_are_locked_at_zero(urdf_path, rng):
    whole = Multibody.from_urdf(urdf_path("panda"))
    arm = Multibody.from_urdf(urdf_path("panda"), whole.joint_names[:7])
    q = rng.normal(size=7)
    np.testing.assert_allclose(arm.gravity_torque(q), whole.gravity_torque(np.append(q, 0.0))[:7], atol=1e-12)


def test_mimicking_joints_are_not_among_the_default_ones(urdf_path):
    path = urdf_path("panda")
    assert Multibody.from_urdf(path).joint_names[-1] == "panda_finger_joint1"
    with pytest.raises(InputError, match="'panda_finger_joint2' mimics 'panda_finger_joint1'"):
        Multibody.from_urdf(path, ["panda_finger_joint2"])


def test_parameters_can_be_replaced(urdf_path, rng):
    body = Multibody.from_urdf(urdf_path("vs060"))
    double = body.with_parameters(2.0 * body.parameters)
    q, dq, ddq = rng.normal(size=(3, 6))
    np.testing.assert_allclose(double.inverse_dynamics(q, dq, ddq), 2.0 * body.inverse_dynamics(q, dq, ddq))
    np.testing.assert_allclose(double.parameters, 2.0 * body.parameters)
    massless = body.parameters.copy()
    massless[50:60] = 0.0
    assert np.isfinite(body.with_parameters(massless).gravity_torque(q)).all()
    massless[51] = 0.1
    with pytest.raises(InputError, match="joint_6 has a first moment but no mass"):
        body.with_parameters(massless)


@pytest.mark.parametrize("kind", ["floating", "planar", "spherical", ""])
def test_other_joints_are_refused_by_name(tmp_path, kind):
    with pytest.raises(InputError, match=f"joint 'elbow' is {kind or 'of no type'}"):
        Multibody.from_urdf(two_joints(tmp_path, kind))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<robot", "not valid XML .*line 1"),
        ('<sdf version="1.6"/>', "root element is <sdf>"),
        ("<robot><link name='a'/></robot>", "no name"),
        ('<robot name="x"><link name="a"/></robot>', "no joint that moves"),
        ('<robot name="x"><link name="a"/><link name="a"/></robot>', "link 'a' is not unique"),
        (SLIDER.replace('lower="-1"', 'lower="low"'), "limit lower of joint 'slide' is 'low'"),
        (SLIDER.replace('child link="cart"', 'child link="card"'), "card"),
    ],
)
def test_a_bad_urdf_is_refused_with_its_reason(tmp_path, capfd, text, reason):
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(InputError, match=reason) as caught:
        Multibody.from_urdf(path)
    assert str(path) in caught.value.where
    assert capfd.readouterr().err == ""


def test_a_missing_or_nameless_file_is_refused(tmp_path, urdf_path):
    with pytest.raises(InputError, match="cannot be read"):
        Multibody.from_urdf(tmp_path / "none.urdf")
    with pytest.raises(InputError, match="<robot> element has no name"):
        Multibody.from_urdf(urdf_path("ur3-nameless"))


def test_unknown_names_are_refused_with_those_there_are(urdf_path):
    path = urdf_path("vs060")
    with pytest.raises(InputError, match=r"no movable joint 'joint_7'.*joint_1, .*joint_6"):
        Multibody.from_urdf(path, ["joint_1", "joint_7"])
    with pytest.raises(InputError, match="'joint_1' is named twice"):
        Multibody.from_urdf(path, ["joint_1", "joint_1"])
    body = Multibody.from_urdf(path)
    with pytest.raises(InputError, match=r"no frame 'hand'.*tool0"):
        body.frame_pose(np.zeros(6), "hand")


def test_gravity_is_the_one_given(urdf_path):
    upside_down = Multibody.from_urdf(urdf_path("vs060"), gravity=(0.0, 0.0, 9.81))
    upright = Multibody.from_urdf(urdf_path("vs060"))
    q = np.full(6, 0.4)
    np.testing.assert_allclose(upside_down.gravity_torque(q), -upright.gravity_torque(q))
