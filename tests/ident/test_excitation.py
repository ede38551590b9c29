"""Excitation design on an arm of three joints: exact pieces, honest verdicts, and motions that tell more."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import yaml

from ident.card import RobotCard
from ident.effects.base import Effect, Term
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import Links, RotorInertia
from ident.errors import InputError
from ident.excitation.clearance import ClearanceModel
from ident.excitation.design import Designer, Request
from ident.excitation.fourier import FourierFamily, Trajectory
from ident.excitation.geometry import ArmGeometry, Surroundings
from ident.excitation.information import Information
from ident.excitation.limits import MotionLimits, Shares, TorquePrior
from ident.excitation.output import check_rate, write_joint_trajectory, write_table
from ident.excitation.spheres import gap
from ident.log import JointLog
from ident.model import CurrentModel
from ident.multibody import Multibody
from ident.robot import JointLimits, Robot, load_robot

LINK = """<link name="l{k}"><inertial><origin xyz="0.01 0.02 {z}"/><mass value="{m}"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.01"/></inertial>
<collision><origin xyz="0 0 {z}"/><geometry>{shape}</geometry></collision></link>"""
JOINT = """<joint name="j{k}" type="revolute"><parent link="l{before}"/><child link="l{k}"/><axis xyz="{axis}"/>
<origin xyz="0 0 {up}"/><limit lower="-2.5" upper="2.5" velocity="2" effort="{effort}"/></joint>"""
BOX = '<box size="0.08 0.08 0.3"/>'


def write_arm(folder: Path, shape: str = BOX, effort: float = 60.0) -> Path:
    """An upright arm: a base of 0.2 m, a turning column, two links of 0.4 m."""
    links = [LINK.format(k=0, z=0.1, m=5, shape='<box size="0.2 0.2 0.2"/>')]
    links += [LINK.format(k=k, z=0.2, m=m, shape=shape) for k, m in ((1, 4), (2, 3), (3, 2))]
    joints = [
        JOINT.format(k=k, before=k - 1, axis=axis, up=up, effort=effort)
        for k, axis, up in ((1, "0 0 1", 0.25), (2, "0 1 0", 0.4), (3, "0 1 0", 0.4))
    ]
    path = folder / "arm.urdf"
    path.write_text(f"<robot name='arm'>{''.join(links + joints)}</robot>")
    return path


def arm_robot(urdf: Path, **changes: object) -> Robot:
    body = Multibody.from_urdf(urdf)
    limits = JointLimits(body.lower, body.upper, body.velocity, np.full(body.n, 15.0), body.effort)
    return Robot(RobotCard(name="arm", urdf=str(urdf)), body, dataclasses.replace(limits, **changes), urdf)


@pytest.fixture(scope="module")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_arm(tmp_path_factory.mktemp("arm"))


QUICK = Request(period=4.0, harmonics=3, restarts=2, nodes=30, iterations=40)


@pytest.fixture(scope="module")
def designer(urdf: Path) -> Designer:
    return Designer(arm_robot(urdf), QUICK)


def test_series_rests_at_both_ends_and_is_its_own_derivative(rng: np.random.Generator) -> None:
    family = FourierFamily(joints=2, period=7.0, harmonics=4)
    motion = Trajectory(family, rng.standard_normal((2, family.size))).sample(2000.0)
    for ends in (motion.dq[[0, -1]], motion.ddq[[0, -1]], motion.q[0] - motion.q[-1]):
        assert np.abs(ends).max() < 1e-12
    assert np.abs(motion.dq).max() > 0.1
    step = np.diff(motion.t).mean()
    for value, derivative in ((motion.q, motion.dq), (motion.dq, motion.ddq)):
        difference = (value[2:] - value[:-2]) / (2 * step)
        assert np.abs(difference - derivative[1:-1]).max() < 1e-4


def test_bounds_hold_between_samples(rng: np.random.Generator) -> None:
    family = FourierFamily(joints=3, period=5.0, harmonics=5)
    trajectory = Trajectory(family, rng.standard_normal((3, family.size)))
    motion = trajectory.at(family.times(5000))
    assert np.all(np.abs(motion.dq).max(axis=0) <= trajectory.bound(1))
    assert np.all(np.abs(motion.ddq).max(axis=0) <= trajectory.bound(2))
    still = trajectory.scaled(0.0, np.array([0.1, 0.2, 0.3])).at(family.times(7))
    np.testing.assert_allclose(still.q, np.tile([0.1, 0.2, 0.3], (7, 1)), atol=1e-12)


def test_symbolic_rows_equal_the_numbers(designer: Designer, rng: np.random.Generator) -> None:
    information = designer.information
    motion = designer.start(rng).at(np.array([1.3]))
    symbols = [ca.SX.sym(name, 3) for name in ("q", "dq", "ddq")]
    rows = ca.Function("rows", symbols, [information.symbolic(*symbols)])(motion.q[0], motion.dq[0], motion.ddq[0])
    np.testing.assert_allclose(rows.full() * information.scale, information.rows(motion)[0], rtol=1e-9, atol=1e-9)


def test_columns_are_independent_and_the_first_rotor_is_left_out(designer: Designer) -> None:
    names = designer.information.names
    assert "rotor-inertia1" not in names  # the same as Izz1
    assert {"rotor-inertia3", "viscous1", "coulomb2"} <= set(names)
    assert np.isfinite(designer.information.condition_number(designer.gain(designer.draw(np.random.default_rng(0)))))


def test_deviations_are_those_of_least_squares(designer: Designer, rng: np.random.Generator) -> None:
    motion = designer.draw(rng).at(designer.family.times(100))
    rows = designer.information.rows(motion).reshape(-1, designer.information.size)
    wanted = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(designer.information.deviations(designer.information.matrix(motion, 100.0)), wanted)


@pytest.mark.parametrize("own_rows", [False, True])
def test_expected_torque_is_the_same_in_symbols(designer: Designer, rng: np.random.Generator, own_rows: bool) -> None:
    prior = dataclasses.replace(designer.prior, rotor_inertia=rng.uniform(0, 1, 3))
    if own_rows:
        prior = dataclasses.replace(prior, parameters=prior.parameters * rng.uniform(0.5, 2, (3, 1)))
    motion = designer.start(rng).at(np.array([0.7]))
    symbols = [ca.SX.sym(name, 3) for name in ("q", "dq", "ddq")]
    torque = ca.Function("torque", symbols, [prior.symbolic(*symbols)])(motion.q[0], motion.dq[0], motion.ddq[0])
    np.testing.assert_allclose(torque.full()[:, 0], prior.torque(motion)[0], rtol=1e-10)


def test_distance_to_the_ground_is_exact(designer: Designer) -> None:
    clearance = designer.clearance
    assert clearance is not None
    q = np.array([0.0, np.pi / 2, 0.0])  # both links level, 0.65 m up, half of 0.08 m thick
    distances = dict(zip(map(clearance.name, range(len(clearance.pairs))), clearance.distances(q), strict=True))
    assert distances["l3 and the ground"] == pytest.approx(0.61, abs=1e-6)
    assert not any("l0 and l1" in name or "l1 and l2" in name for name in distances)


def test_no_pair_closes_faster_than_its_reach(designer: Designer, rng: np.random.Generator) -> None:
    clearance = designer.clearance
    assert clearance is not None
    for _ in range(100):
        q, step = rng.uniform(-2, 2, 3), rng.uniform(-0.2, 0.2, 3)
        change = np.abs(clearance.distances(q + step) - clearance.distances(q))
        assert np.all(change <= clearance.reach @ np.abs(step) + 1e-6)


def test_a_path_that_is_called_clear_is_clear_everywhere(designer: Designer, rng: np.random.Generator) -> None:
    clearance = designer.clearance
    assert clearance is not None
    answers = []
    for _ in range(20):
        trajectory = designer.start(rng)
        kept = clearance.along(trajectory).kept
        least = min(np.min(clearance.distances(q) - clearance.wanted) for q in trajectory.sample(200.0).q)
        answers.append(kept)
        assert least >= 0 if kept else least < 1e-3
    assert any(answers)
    assert not all(answers)


def test_verdict_names_what_is_wrong(designer: Designer) -> None:
    coefficients = np.zeros((3, designer.family.size))
    coefficients[:, 0] = (0.0, 2.4, 0.7)  # the arm hangs down into the ground
    coefficients[0, 1] = 2.0
    verdict = designer.feasibility.verify(Trajectory(designer.family, coefficients))
    assert not verdict.feasible
    text = "; ".join(verdict.violations)
    assert "velocity of joint 1" in text
    assert "the ground" in text


def test_repair_keeps_as_much_as_is_feasible(designer: Designer, rng: np.random.Generator) -> None:
    for _ in range(5):
        wild = designer.start(rng)
        wild = Trajectory(wild.family, np.column_stack([wild.coefficients[:, :1], 3.0 * wild.coefficients[:, 1:]]))
        assert not designer.feasibility.is_feasible(wild)
        repaired, kept = designer.feasibility.repair(wild)
        assert designer.feasibility.verify(repaired).feasible
        assert 0 < kept < 1
        larger = wild.scaled(min(1.0, 1.1 * kept + 0.02), wild.coefficients[:, 0])
        assert not designer.feasibility.is_feasible(larger)


def test_design_is_feasible_and_tells_more_than_random_motions(designer: Designer) -> None:
    excitation = designer.design()
    assert excitation.verdict.feasible
    verdict = designer.feasibility.verify(excitation.trajectory)
    assert verdict.closest.least >= 0.02
    motion = excitation.trajectory.sample(500.0)
    assert np.all(np.abs(motion.dq) <= 0.9 * 2.0)
    assert np.all(np.abs(motion.ddq) <= 0.9 * 15.0)
    assert np.all(np.abs(designer.prior.torque(motion)) <= 0.8 * 60.0)
    rng = np.random.default_rng(1)
    assert excitation.log_det > max(designer.information.log_det(designer.gain(designer.draw(rng))) for _ in range(30))
    assert excitation.condition_number < 20
    again = designer.design()
    np.testing.assert_array_equal(again.trajectory.coefficients, excitation.trajectory.coefficients)


def test_design_adds_to_what_is_known(designer: Designer) -> None:
    first = designer.design()
    second = designer.design(known=first.matrix)
    assert second.log_det > designer.information.log_det(2.0 * first.matrix)
    assert second.verdict.feasible


def test_condition_number_as_objective(urdf: Path, designer: Designer) -> None:
    other = Designer(arm_robot(urdf), dataclasses.replace(QUICK, objective="condition"))
    assert other.design().condition_number < designer.design().condition_number


def test_information_of_logs_is_that_of_their_motion(designer: Designer, rng: np.random.Generator) -> None:
    trajectory = designer.draw(rng)
    motion = trajectory.sample(100.0)
    log = JointLog(motion.t, motion.q, np.zeros_like(motion.q), motion.dq, motion.ddq)
    found, wanted = designer.information.of_logs([log, log]), 2.0 * designer.gain(trajectory)
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    assert np.abs((found - wanted) / scale).max() < 0.15  # the ends of the log are left out, where it rests
    with pytest.raises(InputError, match="2 joints where"):
        designer.information.of_logs([JointLog(motion.t, motion.q[:, :2], motion.q[:, :2])])


def test_what_cannot_be_met_is_named(urdf: Path, tmp_path: Path) -> None:
    weak = write_arm(tmp_path, effort=0.5)
    with pytest.raises(InputError, match="torque limit of joint"):
        Designer(arm_robot(weak), QUICK).design()
    high = dataclasses.replace(QUICK, surroundings=Surroundings(ground=3.0))
    with pytest.raises(InputError, match="the ground are too close"):
        Designer(arm_robot(urdf), high).design()
    with pytest.raises(InputError, match="no velocity limit for joint 2"):
        Designer(arm_robot(urdf, velocity=np.array([1.0, np.inf, 1.0])), QUICK)


def test_walls_keep_the_arm_inside(urdf: Path) -> None:
    inside = Surroundings(ground=None, lower=(-0.5, -np.inf, -np.inf))
    designer = Designer(arm_robot(urdf), dataclasses.replace(QUICK, restarts=1, surroundings=inside))
    trajectory = designer.design().trajectory
    assert designer.clearance is not None
    end = designer.clearance.geometry.bodies[-1]
    for q in trajectory.sample(50.0).q:
        rotation, origin = designer.robot.multibody.frame_pose(q, "j3")
        assert (end.points @ rotation.T + origin)[:, 0].min() > -0.5 + 0.019


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"harmonics": 1}, "cannot start at rest"),
        ({"objective": "volume"}, "no objective"),
        ({"restarts": 0}, "restarts"),
        ({"period": 0.0}, "period"),
        ({"drives": ("stiction",)}, "no drive effect"),
    ],
)
def test_wrong_requests_are_refused(change: dict[str, object], text: str) -> None:
    with pytest.raises(InputError, match=text):
        dataclasses.replace(QUICK, **change)


def test_wrong_shares_and_boxes_are_refused() -> None:
    with pytest.raises(InputError, match="torque share"):
        Shares(torque=1.5)
    with pytest.raises(InputError, match="box"):
        Surroundings(lower=(0.0, 0.0, 1.0), upper=(1.0, 1.0, 0.5))
    with pytest.raises(InputError, match="clearance"):
        Surroundings(clearance=-0.1)


@pytest.mark.parametrize("name", ["panda", "ur10", "xarm7"])
def test_meshes_of_real_arms_are_found_and_covered(
    name: str, urdf_path: Callable[[str], Path], arm_joints: Callable[[str], list[str] | None]
) -> None:
    path = urdf_path(name)
    body = Multibody.from_urdf(path, arm_joints(name))
    geometry = ArmGeometry.from_urdf(path, body)
    assert geometry.missing == ()
    assert {each.joint for each in geometry.bodies} == set(range(-1, body.n))
    model = ClearanceModel.build(body, geometry, Surroundings(), np.array([-np.ones(body.n), np.ones(body.n)]))
    assert "panda_link5 and panda_link7" in model.built_close() or name != "panda"
    smooth = gap(model, np.array([-np.ones(body.n), np.ones(body.n)]))
    assert smooth is not None
    poses = np.random.default_rng(2).uniform(-1.0, 1.0, (100, body.n))
    true = np.array([np.min(model.distances(q) - model.wanted) for q in poses])
    balls = smooth(poses.T).full()[0]
    near = np.abs(true) < 0.15
    assert np.mean((balls > 0.02) & (true < -0.01)) < 0.02  # hardly ever free where the bodies touch
    assert np.abs(balls[near] - true[near]).mean() < 0.04


def test_missing_meshes_are_named_and_the_rest_is_watched(tmp_path: Path) -> None:
    path = write_arm(tmp_path)
    text = path.read_text()
    path.write_text(text.replace(BOX, '<mesh filename="package://arm/gone.stl"/>', 1))
    designer = Designer(arm_robot(path), QUICK)
    assert any("package://arm/gone.stl" in note for note in designer.notes())
    assert designer.geometry is not None
    assert [body.link for body in designer.geometry.bodies] == ["l0", "l2", "l3"]
    assert "not watched" in Designer(dataclasses.replace(arm_robot(path), urdf=None), QUICK).notes()[0]


def test_friction_of_a_prior_takes_its_room(designer: Designer) -> None:
    prior = dataclasses.replace(designer.prior, friction=np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(prior.room(designer.limits), 48.0 - prior.friction)
    with pytest.raises(InputError, match="friction alone takes all torque of joint 2"):
        dataclasses.replace(prior, friction=np.array([1.0, 100.0, 1.0])).room(designer.limits)


def test_prior_from_an_identified_model(designer: Designer, rng: np.random.Generator) -> None:
    robot = designer.robot
    base = robot.rigid_body.base_parameters()
    none = np.zeros(0)

    def term(effect: Effect, *values: float) -> Term:
        return Term(effect, none, np.array(values), np.full(len(values), np.nan), none)

    terms = [term(Links(None), *base.projection @ robot.multibody.parameters), term(RotorInertia(1), 0.3)]
    terms += [term(Coulomb(2), 1.5), term(Viscous(2), 0.5)]
    model = CurrentModel(robot, tuple(terms), 10.0, 100.0, np.ones(3), "N m")
    prior = TorquePrior.from_model(model)
    np.testing.assert_allclose(prior.friction, [0.0, 0.0, 1.5 + 0.5 * 2.0])
    motion = designer.start(rng).at(np.linspace(0, 4, 9))
    wanted = designer.prior.torque(motion) + 0.3 * motion.ddq * [0, 1, 0]
    np.testing.assert_allclose(prior.torque(motion), wanted, atol=1e-9)
    with pytest.raises(InputError, match="are in A"):
        TorquePrior.from_model(dataclasses.replace(model, force_unit="A"))


def test_limits_of_the_built_in_arm() -> None:
    robot = load_robot("vs060")
    limits = MotionLimits.of(robot, Shares(position=0.5, velocity=0.5))
    np.testing.assert_allclose(limits.upper - limits.lower, 0.5 * (robot.limits.upper - robot.limits.lower))
    np.testing.assert_allclose(limits.velocity, 0.5 * robot.limits.velocity)
    assert np.all(TorquePrior.from_urdf(robot).room(limits) > 0)


def test_waypoints_come_back(designer: Designer, rng: np.random.Generator, tmp_path: Path) -> None:
    motion = designer.start(rng).sample(50.0)
    assert motion.t[-1] == 4.0
    assert len(motion) == 201
    for name, read in (("a.csv", pyarrow.csv.read_csv), ("a.parquet", pyarrow.parquet.read_table)):
        write_table(motion, tmp_path / name)
        table = read(tmp_path / name)
        assert table.column_names == ["t", *(f"{k}{j}" for k in ("q", "dq", "ddq") for j in (1, 2, 3))]
        np.testing.assert_array_equal(table["dq2"].to_numpy(), motion.dq[:, 1])
    write_joint_trajectory(motion, ["a", "it's", "c: d"], tmp_path / "a.yaml")
    message = yaml.safe_load((tmp_path / "a.yaml").read_text())
    assert message["joint_names"] == ["a", "it's", "c: d"]
    times = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in message["points"]]
    np.testing.assert_allclose(times, motion.t, atol=1e-9)
    for key, values in (("positions", motion.q), ("velocities", motion.dq), ("accelerations", motion.ddq)):
        np.testing.assert_allclose([p[key] for p in message["points"]], values, atol=1e-9)
    with pytest.raises(InputError, match="rate of 2 Hz"):
        check_rate(designer.family, 2.0)


def test_parameters_are_scaled_by_plausible_motion_where_a_urdf_has_no_limits() -> None:
    robot = load_robot("vs060")
    scales = []
    for speed in (1e4, 1e6):
        limits = dataclasses.replace(
            robot.limits, velocity=np.full(robot.n, speed), acceleration=np.full(robot.n, np.inf)
        )
        fast = dataclasses.replace(robot, limits=limits)
        scales.append(Information(fast, np.stack([limits.lower, limits.upper])).scale)
    np.testing.assert_allclose(*scales)
