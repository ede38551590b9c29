"""The identified URDF, read back by Pinocchio and by MuJoCo."""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest

from ident.errors import InputError
from ident.multibody import Multibody
from ident.pseudo_inertia import body_parameters
from ident.rigid_body import RigidBody
from ident.urdf_export import write_urdf


def other_bodies(n: int, rng: np.random.Generator) -> np.ndarray:
    """Feasible parameters (10 n,) that have nothing to do with the URDF's."""
    factors = np.array([0.3, 0.3, 0.3, 1.5]) * rng.normal(size=(n, 6, 4))
    return np.concatenate([body_parameters(factor.T @ factor) for factor in factors])


@pytest.mark.parametrize("name", ["ur5", "panda", "vs060"])
def test_pinocchio_and_mujoco_read_back_the_dynamics(name, urdf_path, arm_joints, rng, tmp_path):
    body = Multibody.from_urdf(urdf_path(name), arm_joints(name))
    parameters = other_bodies(body.n, rng)
    written = tmp_path / "identified.urdf"
    write_urdf(urdf_path(name), body.joint_names, parameters, written, geometry=False)

    again = Multibody.from_urdf(written)
    assert again.joint_names == body.joint_names
    np.testing.assert_allclose(again.parameters, parameters, rtol=1e-9, atol=1e-9)

    model = mujoco.MjModel.from_xml_path(str(written))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    data = mujoco.MjData(model)
    assert [model.joint(k).name for k in range(model.njnt)] == list(body.joint_names)
    for q, dq, ddq in rng.normal(size=(20, 3, body.n)):
        expected = RigidBody(body).inverse_dynamics(q, dq, ddq, parameters)
        np.testing.assert_allclose(again.inverse_dynamics(q, dq, ddq), expected, rtol=1e-9, atol=1e-9)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(data.qfrc_inverse, expected, rtol=1e-9, atol=1e-8)


def test_joints_in_another_order_keep_their_parameters(urdf_path, rng, tmp_path):
    names = [f"joint_{k}" for k in (3, 1, 2, 6, 5, 4)]
    parameters = other_bodies(6, rng)
    write_urdf(urdf_path("vs060"), names, parameters, tmp_path / "out.urdf")
    again = Multibody.from_urdf(tmp_path / "out.urdf", names)
    np.testing.assert_allclose(again.parameters, parameters, rtol=1e-9, atol=1e-9)


def test_the_rest_of_the_file_stays(tmp_path, rng):
    source = tmp_path / "in" / "robot.urdf"
    source.parent.mkdir()
    mesh = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
    tool = "<inertial><mass value='9'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>"
    source.write_text(
        f"""<robot name="arm"><!-- bolts are M8 --><link name="base">{tool}</link><link name="upper">
        {mesh.format("meshes/upper.stl")}{mesh.format("package://arm/upper.stl")}</link><link name="tool">{tool}</link>
        <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
        <joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/></joint></robot>"""
    )
    target = tmp_path / "out" / "robot.urdf"
    target.parent.mkdir()
    write_urdf(source, ["shoulder"], other_bodies(1, rng), target)
    root = ET.parse(target).getroot()
    assert "bolts are M8" in target.read_text()
    files = [m.get("filename", "") for m in root.iter("mesh")]
    assert (target.parent / files[0]).resolve() == (source.parent / "meshes/upper.stl").resolve()
    assert files[1] == "package://arm/upper.stl"
    with_mass = [link.get("name") for link in root.findall("link") if link.find("inertial") is not None]
    assert with_mass == ["base", "upper"]


def test_parameters_of_no_body_are_refused(urdf_path, tmp_path, rng):
    parameters = other_bodies(6, rng)
    parameters[24] *= -1.0
    with pytest.raises(InputError, match="link of joint 3"):
        write_urdf(urdf_path("vs060"), [f"joint_{k}" for k in range(1, 7)], parameters, tmp_path / "out.urdf")
    assert not Path(tmp_path / "out.urdf").exists()
    with pytest.raises(InputError, match="no movable joint 'elbow'"):
        write_urdf(urdf_path("vs060"), ["elbow"], parameters[:10], tmp_path / "out.urdf")
