import sqlite3
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from ident.errors import InputError
from ident.log import JointLog
from ident.log_writer import write_log
from ident.readers import open_log, open_logs
from ident.robot import load_robot

DATA = Path(__file__).parents[2].parent / "shared" / "data"
MAPPING = """
[log]
time = "ms"
position = {position}
current = {current}
velocity = "speed"
scale = {{ time = 1e-3, position = 0.5, current = [-1.0, 1.0], velocity = 2.0 }}
"""
URDF = """<robot name="pair"><link name="base"/>
<link name="one"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="two"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="3" effort="10"/></joint>
<joint name="elbow" type="revolute"><parent link="one"/><child link="two"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1.5" velocity="3" effort="10"/></joint></robot>"""


@pytest.fixture
def robot(write_card):
    return load_robot(write_card("pair", URDF))


@pytest.fixture
def log():
    t = np.arange(50) / 100.0
    q = np.stack([np.sin(t), 0.5 * np.cos(3 * t)], axis=1)
    segment = np.repeat([3, 1, 1], [20, 10, 20])
    return JointLog(t, q, q[:, ::-1] * 7.0, dq=q + 0.1, temperature=q + 30.0, segment=segment, name="made")


def assert_same(one, other):
    for key in ("t", "q", "current", "dq", "ddq", "tau_ext", "wrench", "temperature", "segment"):
        a, b = getattr(one, key), getattr(other, key)
        assert (a is None) == (b is None), key
        assert a is None or np.array_equal(a, b), key


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_contract_log_comes_back_as_written(tmp_path, robot, log, suffix):
    full = log.replace(ddq=log.q * 2, tau_ext=log.q * 3, wrench=np.arange(300.0).reshape(50, 6))
    write_log(full, tmp_path / f"made{suffix}")
    source = open_log(tmp_path / f"made{suffix}", robot)
    assert source.name == "made"
    assert source.read().name == "made"
    assert_same(source.read(), full)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("rows", [1, 7, 20, 1000])
def test_blocks_are_full_and_keep_segments_apart(tmp_path, robot, log, suffix, rows):
    write_log(log, tmp_path / f"made{suffix}")
    blocks = list(open_log(tmp_path / f"made{suffix}", robot).blocks(rows))
    expected = [len(block) for block in log.blocks(rows)]
    assert [len(block) for block in blocks] == expected
    assert np.array_equal(np.concatenate([block.q for block in blocks]), log.q)
    assert all(len(set(block.segment.tolist())) == 1 for block in blocks)


def test_parquet_is_walked_in_bounded_pieces(tmp_path, robot):
    t = np.arange(200_000) / 1000.0
    q = np.sin(t)[:, None] * [1.0, 0.5]
    write_log(JointLog(t, q, q), tmp_path / "long.parquet")
    assert pyarrow.parquet.ParquetFile(tmp_path / "long.parquet").num_row_groups == 2
    source = open_log(tmp_path / "long.parquet", robot)
    assert [len(block) for block in source.blocks(90_000)] == [90_000, 90_000, 20_000]
    assert np.array_equal(np.concatenate([block.t for block in source.blocks(64)]), t)


def test_csv_of_other_programs(tmp_path, robot):
    text = '\ufeff"t"; i1 ;q1;q2;i2;note\r\n0.0;1;0.1;0.2;2;hello\r\n\r\n0.01;1;0.1;0.2;2;\r\n'
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    log = open_log(tmp_path / "a.csv", robot).read()
    assert log.t.tolist() == [0.0, 0.01]
    assert log.current.tolist() == [[1.0, 2.0], [1.0, 2.0]]


def mapped(write_card, listed):
    position = '["a", "b"]' if listed else '"angles"'
    current = '["c", "d"]' if listed else '"amps"'
    return load_robot(write_card("pair", URDF, MAPPING.format(position=position, current=current)))


def assert_mapped(log):
    assert np.allclose(log.t, [0.0, 0.01, 0.02])
    assert np.allclose(log.q, [[0.5, 0.25]] * 3)
    assert np.allclose(log.current, [[-3.0, 4.0]] * 3)
    assert log.dq is None or np.allclose(log.dq, [[0.2, 0.4]] * 3)


def test_mapped_names_and_scales_in_csv_and_parquet(tmp_path, write_card):
    robot = mapped(write_card, listed=True)
    columns = {"ms": [0, 10, 20], "a": [1.0] * 3, "b": [0.5] * 3, "c": [3.0] * 3, "d": [4.0] * 3}
    pyarrow.parquet.write_table(pa.table(columns), tmp_path / "a.parquet")
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    for suffix in (".csv", ".parquet"):
        assert_mapped(open_log(tmp_path / f"a{suffix}", robot).read())


def test_mapped_arrays_in_npz_mat_and_parquet(tmp_path, write_card):
    robot = mapped(write_card, listed=False)
    arrays = {
        "ms": np.array([0.0, 10.0, 20.0]),
        "angles": np.array([[1.0, 0.5]] * 3),
        "amps": np.array([[3, 4]] * 3),
        "speed": np.array([[0.1, 0.2]] * 3, dtype=np.float32),
    }
    np.savez(tmp_path / "a.npz", **arrays, comment="no number")
    scipy.io.savemat(tmp_path / "a.mat", arrays)
    pyarrow.parquet.write_table(pa.table({k: list(v) for k, v in arrays.items()}), tmp_path / "a.parquet")
    for suffix in (".npz", ".mat", ".parquet"):
        log = open_log(tmp_path / f"a{suffix}", robot).read()
        assert log.dq is not None
        assert_mapped(log)


def test_one_card_reads_foreign_logs_and_converted_ones(tmp_path, write_card, log):
    robot = mapped(write_card, listed=False)
    for suffix in (".csv", ".parquet"):
        write_log(log, tmp_path / f"made{suffix}")
        assert_same(open_log(tmp_path / f"made{suffix}", robot).read(), log)


def test_converted_parquet_is_not_scaled_again_when_the_card_maps_contract_names(tmp_path, write_card, log):
    mapping = '[log]\ntime = "t"\nposition = ["q1", "q2"]\ncurrent = ["i1", "i2"]\nscale = { current = -1.0 }'
    robot = load_robot(write_card("pair", URDF, mapping))
    write_log(log, tmp_path / "made.parquet")
    assert np.array_equal(open_log(tmp_path / "made.parquet", robot).read().current, log.current)
    write_log(log, tmp_path / "made.csv")
    assert np.array_equal(open_log(tmp_path / "made.csv", robot).read().current, -log.current)


TYPES1, TYPES2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)


def joint_state(types, names, k, stamp, velocity=True, effort=True):
    """A message of 2 joints and others, 8 ms apart: q = k/100 (1, 2), current = k (1, 2)."""
    values = {"shoulder": 1.0, "elbow": 2.0, "A": 1.0, "B": 2.0}
    base = np.array([values.get(name, 99.0) for name in names])
    stamp_type, header_type = types.types["builtin_interfaces/msg/Time"], types.types["std_msgs/msg/Header"]
    stamp = stamp_type(sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = header_type(stamp=stamp, frame_id="", **({"seq": k} if types is TYPES1 else {}))
    return types.types["sensor_msgs/msg/JointState"](
        header=header,
        name=list(names),
        position=base * k / 100,
        velocity=base / 10 if velocity else np.zeros(0),
        effort=base * k if effort else np.zeros(0),
    )


def write_bag(path, topics, header=lambda k: 10**18 + 8_000_000 * k, plugin=StoragePlugin.SQLITE3, **arrays):
    """Write 20 messages on each topic (name -> joint names); bag stamps 8 ms apart with jitter."""
    types = TYPES1 if path.suffix == ".bag" else TYPES2
    kind = "sensor_msgs/msg/JointState"
    rng = np.random.default_rng(0)
    if path.suffix == ".bag":
        writer, serialize = Writer1(path), types.serialize_ros1
    else:
        writer, serialize = Writer2(path, version=8, storage_plugin=plugin), types.serialize_cdr
    with writer:
        for topic, names in topics.items():
            connection = writer.add_connection(topic, kind, typestore=types)
            for k in range(20):
                stamp = 10**18 + 8_000_000 * k + int(rng.integers(0, 10**6))
                writer.write(connection, stamp, serialize(joint_state(types, names, k, header(k), **arrays), kind))


def assert_bag(log, exact=True):
    k = np.arange(20)[:, None]
    assert np.allclose(log.q, k / 100 * [1, 2])
    assert np.allclose(log.current, k * [1, 2])
    assert np.allclose(log.dq, [0.1, 0.2])
    assert log.t[0] == 0.0
    assert np.allclose(log.t, 0.008 * k[:, 0], atol=1e-9 if exact else 1e-3)


JOINTS = ("elbow", "gripper", "shoulder")


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_rosbag2_with_and_without_metadata(tmp_path, robot, plugin):
    write_bag(tmp_path / "rec", {"/joint_states": JOINTS}, plugin=plugin)
    assert_bag(open_log(tmp_path / "rec", robot).read())
    (tmp_path / "rec" / "metadata.yaml").unlink()
    (file,) = (tmp_path / "rec").iterdir()
    source = open_log(file, robot)
    assert_bag(source.read())
    assert_bag(open_log(tmp_path / "rec", robot).read())
    assert sum(len(block) for block in source.blocks(7)) == 20


def test_rosbag2_of_old_ros_without_message_definitions(tmp_path, robot):
    write_bag(tmp_path / "rec", {"/joint_states": JOINTS})
    (tmp_path / "rec" / "metadata.yaml").unlink()
    (file,) = (tmp_path / "rec").iterdir()
    with sqlite3.connect(file) as base:
        base.execute("DROP TABLE message_definitions")
        base.execute("DROP TABLE schema")
        base.execute("DROP TABLE metadata")
    assert_bag(open_log(file, robot).read())


def test_ros1_bag(tmp_path, robot):
    write_bag(tmp_path / "rec.bag", {"/arm": JOINTS})
    assert_bag(open_log(tmp_path / "rec.bag", robot).read())


@pytest.mark.parametrize("header", [lambda k: k + 1, lambda k: 10**18, lambda k: 10**18 + 80_000_000 * k])
def test_bag_time_is_taken_where_header_stamps_are_nonsense(tmp_path, robot, header):
    write_bag(tmp_path / "rec", {"/joint_states": JOINTS}, header=header)
    assert_bag(open_log(tmp_path / "rec", robot).read(), exact=False)


def test_the_topic_that_carries_the_joints_is_chosen(tmp_path, robot):
    write_bag(tmp_path / "rec", {"/a_gripper": ("finger",), "/arm": JOINTS})
    assert_bag(open_log(tmp_path / "rec", robot).read())


def test_bag_joints_may_be_named_by_the_card_and_effort_is_scaled(tmp_path, write_card):
    mapping = '[log]\ntime = "t"\nposition = ["A", "B"]\ncurrent = "effort"\nscale = { current = -1.0 }'
    robot = load_robot(write_card("pair", URDF, mapping))
    write_bag(tmp_path / "rec", {"/arm": ("B", "A")})
    log = open_log(tmp_path / "rec", robot).read()
    assert np.allclose(log.current, -np.arange(20)[:, None] * [1, 2])


def test_bag_without_velocity(tmp_path, robot):
    write_bag(tmp_path / "rec", {"/arm": JOINTS}, velocity=False)
    assert open_log(tmp_path / "rec", robot).read().dq is None


@pytest.mark.parametrize(
    ("topics", "arrays", "words"),
    [
        ({"/arm": ("one", "two")}, {}, "joints one, two, not all of shoulder, elbow"),
        ({}, {}, "no sensor_msgs/JointState"),
        ({"/arm": JOINTS}, {"effort": False}, "effort has 0 values for 3 joints"),
    ],
)
def test_bags_that_hold_no_log(tmp_path, robot, topics, arrays, words):
    write_bag(tmp_path / "rec", topics, **arrays)
    with pytest.raises(InputError, match=words):
        open_log(tmp_path / "rec", robot).read()


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".mat", ".db3", ".mcap", ".bag"])
@pytest.mark.parametrize("content", [b"", b"\x00\x01\xff\xfe rubbish \x80", b"t,q1,q2\n"])
def test_unreadable_files_are_refused_in_one_line(tmp_path, robot, suffix, content):
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_log(path, robot).read()
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_logs_by_file_glob_and_folder_are_sorted_and_taken_once(tmp_path, robot, log):
    for name in ("b.csv", "a.parquet", "c.csv"):
        write_log(log, tmp_path / name)
    write_bag(tmp_path / "rec", {"/arm": JOINTS})
    (tmp_path / "notes.txt").write_text("not a log")
    names = [source.name for source in open_logs([tmp_path / "c.csv", tmp_path, str(tmp_path / "*.csv")], robot)]
    assert names == ["c", "a", "b", "rec"]


@pytest.mark.parametrize("pattern", ["nothing.csv", "*.bag", "empty"])
def test_patterns_without_a_log_are_refused(tmp_path, robot, pattern):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"no log"):
        open_logs([tmp_path / pattern], robot)


def test_whole_numbers_become_floats(tmp_path, robot):
    columns = {name: [0, 1] for name in ("t", "q1", "q2", "i1", "i2")}
    pyarrow.parquet.write_table(pa.table(columns), tmp_path / "a.parquet")
    log = open_log(tmp_path / "a.parquet", robot).read()
    assert log.t.dtype == log.q.dtype == log.current.dtype == np.float64
    assert log.segment.dtype == np.int64


def test_other_formats_and_no_pattern_are_refused(tmp_path, robot):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="folder with 0 logs"):
        open_log(tmp_path / "empty", robot)
    with pytest.raises(InputError, match="no such log"):
        open_log(tmp_path / "gone.csv", robot)
    (tmp_path / "a.xlsx").write_text("")
    with pytest.raises(InputError, match="xlsx is not read"):
        open_log(tmp_path / "a.xlsx", robot)
    with pytest.raises(InputError, match="no logs"):
        open_logs([], robot)


measured = pytest.mark.skipif(not DATA.is_dir(), reason="the measured logs are not here")
UR_JOINTS = "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3"


def measured_robot(write_card, joints, mapping=""):
    """A chain of joints with generous limits: enough of a robot to read a log."""
    parts, parent = ['<robot name="chain"><link name="base"/>'], "base"
    for name in joints:
        parts.append(f'<link name="{name}_link"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0"')
        parts.append('ixz="0" iyz="0"/></inertial></link>')
        parts.append(f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>')
        parts.append('<axis xyz="0 0 1"/><limit lower="-16" upper="16" velocity="4" effort="1"/></joint>')
        parent = f"{name}_link"
    return load_robot(write_card("chain", "\n".join([*parts, "</robot>"]), mapping))


@measured
def test_ur10_bag_takes_its_own_time(write_card):
    robot = measured_robot(write_card, [f"{name}_joint" for name in UR_JOINTS.split()])
    log = open_log(DATA / "ur10_unisa" / "ur10_exciting_trajectory.db3", robot).read()
    assert len(log) == 3441
    assert log.rate == pytest.approx(125.0)
    assert log.t[-1] == pytest.approx(27.52)
    with pytest.raises(InputError, match=r"joint_space_trajectory \(trajectory_msgs/msg/JointTrajectory\)"):
        open_log(DATA / "ur10_unisa" / "validation_trajectory.db3", robot).read()


@measured
def test_panda_bag(write_card):
    robot = measured_robot(write_card, [f"fer_joint{k}" for k in range(1, 8)])
    log = open_log(DATA / "ur10_unisa" / "panda_exciting_trajectory.db3", robot).read()
    assert (len(log), log.n) == (727, 7)
    assert log.rate == pytest.approx(30.0, abs=0.01)


@measured
def test_ur3_mat_is_the_middle_of_its_bag(write_card):
    mapping = """[log]
time = "mt"
position = "mq"
velocity = "mdq"
current = "mtorque"
scale = { current = -1.0 }"""
    mat = open_log(DATA / "ur3_aspectum" / "id1.mat", measured_robot(write_card, list("abcdef"), mapping)).read()
    names = '["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"]'
    robot = measured_robot(write_card, list("abcdef"), mapping.replace('"mq"', names))
    bag = open_log(DATA / "ur3_aspectum" / "id1.bag", robot).read()
    assert (len(mat), len(bag)) == (5200, 5941)
    start = int(np.searchsorted(bag.t, mat.t[0] - 0.004))
    assert np.allclose(bag.q[start : start + 5200], mat.q)
    assert np.allclose(bag.current[start : start + 5200], mat.current)
    assert np.mean(mat.dq * mat.current) > 0  # friction: torque along motion once the sign is turned


@measured
def test_lwr_npz(write_card):
    mapping = """[log]
time = "times"
position = "positions"
velocity = "velocities"
acceleration = "accelerations"
current = "torques\""""
    log = open_log(
        DATA / "kuka_lwr4_flobaroid" / "measurements_3.npz", measured_robot(write_card, list("abcdefg"), mapping)
    ).read()
    assert (len(log), log.n) == (5027, 7)
    assert log.ddq is not None
    assert log.rate == pytest.approx(200.0, abs=0.1)


@measured
def test_emps_mat_with_its_external_force(write_card):
    mapping = """[log]
time = "t"
position = "qm"
current = "vir"
tau_ext = "pulses_N"
scale = { current = 35.1507, tau_ext = 35.1507 }"""
    robot = measured_robot(write_card, ["x"], mapping)
    pulses = open_log(DATA / "emps" / "DATA_EMPS_PULSES.mat", robot).read()
    assert pulses.tau_ext is not None
    assert np.max(pulses.tau_ext) == pytest.approx(175.8, abs=0.1)
    assert open_log(DATA / "emps" / "DATA_EMPS.mat", robot).read().tau_ext is None
