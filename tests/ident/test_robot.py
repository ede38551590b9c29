"""Robot cards, right and wrong."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ident.errors import InputError
from ident.robot import built_in_robots, load_robot

VS060 = Path(__file__).parents[2] / "ident" / "robots" / "vs060" / "vs060.urdf"


def card(tmp_path: Path, text: str = "", urdf: Path = VS060) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(f"name = 'mine'\nurdf = {str(urdf)!r}\n{text}")
    return path


def test_the_built_in_arm_loads_by_name():
    robot = load_robot("vs060")
    assert built_in_robots() == ["vs060"]
    assert (robot.name, robot.n, robot.unit) == ("vs060", 6, "%Use")
    assert robot.joints == tuple(f"joint_{k}" for k in range(1, 7))
    assert robot.gain is None  # the paper's case
    assert robot.coupling is None
    np.testing.assert_array_equal(robot.gear_ratio, [120, 160, 120, 100, 100, 80])
    np.testing.assert_array_equal(robot.limits.lower, [-2.967, -2.094, -2.182, -4.712, -2.094, -6.283])
    np.testing.assert_array_equal(robot.limits.upper, [2.967, 2.094, 2.705, 4.712, 2.094, 6.283])
    np.testing.assert_array_equal(robot.limits.velocity, [3.927, 2.618, 2.858, 3.927, 3.022, 6.283])
    np.testing.assert_array_equal(robot.limits.acceleration, [19.73, 16.84, 20.71, 20.97, 23.72, 33.51])
    _, tool = robot.multibody.frame_pose(np.zeros(6))
    np.testing.assert_allclose(tool, [-0.010, 0.0, 0.1815 + 0.1635 + 0.3050 + 0.1645 + 0.1355 + 0.0700 + 0.020])


def test_the_built_in_arm_weighs_28_kg_and_every_link_is_a_body_that_could_exist():
    full = pin.buildModelFromUrdf(str(VS060))
    assert sum(inertia.mass for inertia in full.inertias) == pytest.approx(28.0)
    for values in load_robot("vs060").multibody.parameters.reshape(6, 10):
        pseudo_inertia = pin.PseudoInertia.FromDynamicParameters(values).toMatrix()
        assert np.linalg.eigvalsh(pseudo_inertia).min() > 1e-5


def test_the_built_in_arm_does_not_touch_itself_at_home():
    model = pin.buildModelFromUrdf(str(VS060))
    shapes = pin.buildGeomFromUrdf(model, str(VS060), pin.COLLISION)
    links = [shape.parentJoint for shape in shapes.geometryObjects]
    for a in range(len(links)):
        for b in range(a + 1, len(links)):
            if abs(links[a] - links[b]) > 1:
                shapes.addCollisionPair(pin.CollisionPair(a, b))
    data, shape_data = model.createData(), shapes.createData()
    home, folded = np.zeros(6), np.array([0.0, 2.0, 2.7, 0.0, 0.0, 0.0])
    assert not pin.computeCollisions(model, data, shapes, shape_data, home, True)
    assert pin.computeCollisions(model, data, shapes, shape_data, folded, True)


def test_a_card_is_found_by_its_path_or_its_folder(tmp_path):
    path = card(tmp_path)
    assert load_robot(path).name == load_robot(str(tmp_path)).name == "mine"


def test_a_urdf_path_is_relative_to_the_card(tmp_path):
    (tmp_path / "arm.urdf").write_text(VS060.read_text())
    assert load_robot(card(tmp_path, urdf=Path("arm.urdf"))).n == 6


def test_defaults(tmp_path):
    robot = load_robot(card(tmp_path))
    assert robot.unit == "A"
    assert (robot.gain, robot.gear_ratio, robot.card.log) == (None, None, None)
    np.testing.assert_array_equal(robot.multibody.gravity, [0.0, 0.0, -9.81])
    assert np.isinf(robot.limits.acceleration).all()


@pytest.mark.parametrize("unit", ["N*m", "Nm", "N m", "N"])
def test_a_robot_that_reports_torque_has_gains_of_one(tmp_path, unit):
    np.testing.assert_array_equal(load_robot(card(tmp_path, f"current_unit = '{unit}'")).gain, np.ones(6))


def test_the_drive_is_read(tmp_path):
    wrist = np.eye(6) - 0.5 * np.eye(6, k=-1)
    drive = f"[drive]\ngain = {[1.5] * 6}\ngear_ratio = {[100] * 6}\ncoupling = {wrist.tolist()}"
    robot = load_robot(card(tmp_path, drive))
    np.testing.assert_array_equal(robot.gain, [1.5] * 6)
    np.testing.assert_array_equal(robot.gear_ratio, [100.0] * 6)
    np.testing.assert_array_equal(robot.coupling.matrix, wrist)


def test_limits_of_the_card_override_those_of_the_urdf(tmp_path):
    text = "joints = ['joint_3', 'joint_1']\n[limits]\nlower = [-1, -2]\nvelocity = [inf, 1.0]\neffort = [5, 6]"
    limits = load_robot(card(tmp_path, text)).limits
    np.testing.assert_array_equal(limits.lower, [-1, -2])
    np.testing.assert_array_equal(limits.upper, [2.705, 2.967])
    np.testing.assert_array_equal(limits.velocity, [np.inf, 1.0])
    np.testing.assert_array_equal(limits.effort, [5, 6])


def test_the_log_table_takes_names_of_columns_or_of_arrays(tmp_path):
    log = "joints = ['joint_1', 'joint_2']\n[log]\ntime = 'mt'\nposition = 'mq'\ncurrent = ['i0', 'i1']\n"
    log += "scale = { time = 1e-3, current = [-1, 1] }"
    mapping = load_robot(card(tmp_path, log)).card.log
    assert (mapping.time, mapping.position, mapping.current) == ("mt", "mq", ["i0", "i1"])
    assert (mapping.velocity, mapping.segment) == (None, None)
    assert (mapping.scale.time, mapping.scale.position, mapping.scale.current) == (1e-3, 1.0, [-1.0, 1.0])


def test_every_mistake_is_reported_at_once_by_its_key(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(f"""
        name = 3
        urdf = {str(VS060)!r}
        joints = ["joint_1", "elbow"]
        colour = "white"
        gravity = [0, 0]
        [drive]
        gain = [1, 2, 3]
        gear_ratio = [100, -100]
        coupling = [[1, 0], [1]]
        [limits]
        jerk = [1, 1]
        [log]
        position = ["a", 3]
        current = "i"
        scale = {{ position = [1, 1, 1], time = "ms" }}
        """)
    with pytest.raises(InputError) as caught:
        load_robot(path)
    problems = dict(problem.split(": ", 1) for problem in caught.value.what.split("; "))
    assert set(problems) == {
        "name",
        "colour",
        "gravity",
        "drive.gain",
        "drive.gear_ratio.1",
        "drive.coupling.1",
        "limits.jerk",
        "log.time",
        "log.position.1",
        "log.scale.position",
        "log.scale.time",
    }
    assert problems["colour"] == problems["limits.jerk"] == "unknown key"
    assert problems["log.time"] == "missing"
    assert problems["drive.gain"] == "3 values where there are 2 joints"
    assert str(path) in caught.value.where


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("joints = ['joint_1', 'elbow']", "joints: no movable joint 'elbow'.*joint_6"),
        ("joints = ['joint_1', 'joint_1']", "joints: joint 'joint_1' is named twice"),
        ("joints = ['flange']", "joints: no movable joint 'flange'"),
        ("[drive]\ngain = [1, 1, 1, 1, 1]", "drive.gain: 5 values where there are 6 joints"),
        ("[limits]\nlower = [0, 0, 0, 0, 0, 9]", "limits.lower: lower is not below upper at joint 6"),
        ("joints = ['joint_1', 'joint_2']\n[drive]\ncoupling = [[1, 1], [1, 1]]", "drive.coupling: singular"),
        ("joints = ['joint_1']\n[drive]\ngain = [nan]", "drive.gain.0"),
        (
            "joints = ['joint_1']\n[log]\ntime = 't'\nposition = 'q'\ncurrent = 'i'\nwrench = ['fx']",
            "log.wrench: 1 v",
        ),
    ],
)
def test_a_mistake_against_the_urdf_is_reported_by_its_key(tmp_path, text, problem):
    with pytest.raises(InputError, match=problem):
        load_robot(card(tmp_path, text))


def test_a_wrong_urdf_is_reported_with_the_rest(tmp_path):
    with pytest.raises(InputError, match=r"colour: unknown key; urdf: .*none.urdf"):
        load_robot(card(tmp_path, "colour = 1", Path("none.urdf")))


def test_an_unreadable_card_is_refused(tmp_path):
    path = card(tmp_path, "joints = = 3\n")
    with pytest.raises(InputError, match=r"not valid TOML .*line 3"):
        load_robot(path)
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(InputError, match="not UTF-8"):
        load_robot(path)
    with pytest.raises(InputError, match=r"no robot 'vs061'.*vs060"):
        load_robot("vs061")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("drive = 3", "drive: should be a table"),
        ("joints = []", "joints: list should have at least 1 item, not 0"),
        ("[log]\ntime = 't'\nposition = { a = 1 }\ncurrent = 'i'", "log.position: input should be a valid list"),
    ],
)
def test_a_value_of_the_wrong_kind_is_reported_in_the_card_s_own_words(tmp_path, text, what):
    with pytest.raises(InputError) as caught:
        load_robot(card(tmp_path, text))
    assert caught.value.what == what
