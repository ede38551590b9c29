"""Gears that couple joints: dynamics, identification and gaps of the motors, against Pinocchio and known laws."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from ident.arrays import FloatArray
from ident.coupling import Coupling
from ident.excitation.information import Information
from ident.excitation.limits import MotionLimits, Shares, TorquePrior
from ident.gap import baseline_model, find_gap
from ident.identification import identify
from ident.log import JointLog
from ident.robot import Robot
from ident.signals import Motion

WRIST = np.eye(6)
WRIST[4, 3], WRIST[5, 3], WRIST[5, 4] = -0.1, 0.2, -0.7
NOISE, DRY, VISCOUS, ROTOR = 0.1, 1.2, 0.8, 0.3


def coupled(robot: Robot, speeds: FloatArray) -> Robot:
    """The robot with its motors coupled, in torques for currents."""
    drive = robot.card.drive.model_copy(update={"coupling": speeds.tolist()})
    return replace(robot, card=robot.card.model_copy(update={"drive": drive, "current_unit": "N*m"}))


@pytest.fixture(scope="module")
def wrist(vs060: Robot) -> Robot:
    return coupled(vs060, WRIST)


@pytest.fixture(scope="module")
def two_arm(arm: Robot) -> Robot:
    return coupled(arm, np.array([[1.0, 0.0], [-0.7, 1.0]]))


def record(robot: Robot, motion: Motion, seed: int, hidden: Callable[[Motion], FloatArray] | None = None) -> JointLog:
    """Torques of the motors, by Pinocchio and the law of virtual work, with friction and rotors of the motors."""
    matrix = np.array(robot.card.drive.coupling)
    torque = np.stack(
        [robot.multibody.inverse_dynamics(*row) for row in zip(motion.q, motion.dq, motion.ddq, strict=True)]
    )
    motors = Motion(motion.t, *(x @ matrix.T for x in (motion.q, motion.dq, motion.ddq)))
    current = np.linalg.solve(matrix.T, torque.T).T + ROTOR * motors.ddq
    current += DRY * np.tanh(motors.dq / 5e-3) + VISCOUS * motors.dq
    if hidden is not None:
        current += hidden(motors)
    return JointLog(
        motion.t, motion.q, current + NOISE * np.random.default_rng(seed).normal(size=current.shape), name=f"log{seed}"
    )


def test_a_motor_is_told_in_its_joints_units_whether_or_not_the_gear_ratio_is_in_the_matrix() -> None:
    plain, geared = np.array([[1.0, 0.0], [-0.7, 1.0]]), np.array([[100.0, 0.0], [-35.0, 50.0]])
    np.testing.assert_allclose(Coupling(plain).matrix, Coupling(geared).matrix)
    np.testing.assert_allclose(Coupling(geared).joints @ Coupling(geared).matrix, np.eye(2), atol=1e-15)


def test_a_matrix_without_coupling_is_none(vs060: Robot) -> None:
    assert coupled(vs060, np.diag([80.0] * 6)).coupling is None


def test_power_of_motors_is_that_of_joints(wrist: Robot, rng: np.random.Generator) -> None:
    coupling, (force, dq) = wrist.coupling, rng.normal(size=(2, 6))
    assert coupling is not None
    speed = coupling.matrix @ dq
    assert coupling.motor_force(force) @ speed == pytest.approx(force @ dq)
    np.testing.assert_allclose(coupling.joint_force(coupling.motor_force(force)), force)


@pytest.mark.parametrize("shared", [True, False])
def test_dynamics_are_those_of_the_motors(wrist: Robot, vs060: Robot, rng: np.random.Generator, shared: bool) -> None:
    q, dq, ddq = rng.uniform(-1.0, 1.0, (3, 5, 6))
    parameters = np.tile(vs060.multibody.parameters, (6, 1))
    if not shared:
        parameters *= rng.uniform(0.5, 2.0, (6, 1))
    onto = np.linalg.inv(WRIST).T

    def motors(joints: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Row j of C^-T times the joints' forces by the parameters of row j."""
        return np.stack([np.tensordot(joints(parameters[j]), onto[j], (-1, 0)) for j in range(6)], axis=-1)

    body, joints = wrist.rigid_body, vs060.rigid_body
    force = body.inverse_dynamics(q, dq, ddq, parameters)
    np.testing.assert_allclose(force, motors(lambda p: joints.inverse_dynamics(q, dq, ddq, p)), atol=1e-12)
    for j in range(6):
        np.testing.assert_array_equal(body.inverse_dynamics(q, dq, ddq, parameters, joint=j), force[:, j])
    np.testing.assert_allclose(force, np.einsum("tjk,jk->tj", body.regressor(q, dq, ddq), parameters), atol=1e-10)
    terms = body.momentum_terms(q, dq, parameters)
    for name in ("momentum", "coriolis_transpose", "gravity"):
        wanted = motors(lambda p, name=name: getattr(joints.momentum_terms(q, dq, p), name))
        np.testing.assert_allclose(getattr(terms, name), wanted, atol=1e-12)
    inertia = body.mass_matrix(q, parameters)
    np.testing.assert_allclose(np.einsum("tjk,tk->tj", inertia, dq @ WRIST.T), terms.momentum, atol=1e-12)
    if shared:
        np.testing.assert_allclose(inertia, inertia.transpose(0, 2, 1), atol=1e-12)


def test_expressions_of_torque_and_regressor_are_those_of_the_numbers(wrist: Robot, swinging) -> None:
    motion = swinging(1.0)
    prior = replace(TorquePrior.from_urdf(wrist), rotor_inertia=np.full(6, ROTOR))
    information = Information(wrist, MotionLimits.of(wrist, Shares()).span)
    symbols = [ca.SX.sym(name, 6) for name in ("q", "dq", "ddq")]
    for expression, wanted in (
        (prior.symbolic(*symbols), prior.torque(motion)[7]),
        (information.symbolic(*symbols), information.rows(motion)[7] / information.scale),
    ):
        found = ca.Function("f", symbols, [expression])(motion.q[7], motion.dq[7], motion.ddq[7]).full()
        np.testing.assert_allclose(found.reshape(wanted.shape), wanted, atol=1e-9)


def test_friction_and_rotors_of_coupled_motors_are_identified(wrist: Robot, swinging) -> None:
    found = identify(wrist, [record(wrist, swinging(30.0, seed=seed), seed) for seed in (1, 2)])
    test = record(wrist, swinging(20.0, seed=5), 5)
    error = found.model.predict(test) - test.current
    np.testing.assert_allclose(np.sqrt(np.nanmean(error**2, axis=0)), NOISE, rtol=0.05)
    friction = {
        (t.effect.name, t.effect.joint): t.coefficients[0] for t in found.model.terms if t.effect.joint is not None
    }
    for joint in range(6):
        assert friction["coulomb", joint] == pytest.approx(DRY, rel=0.03)
        assert friction["viscous", joint] == pytest.approx(VISCOUS, rel=0.05)
    assert found.warnings == ()


@pytest.mark.parametrize("lost", [False, True])
def test_a_gap_names_what_a_coupled_motor_hides_and_nothing_else(two_arm: Robot, swinging, lost: bool) -> None:
    def stribeck(motors: Motion) -> FloatArray:
        speed = motors.dq[:, 1]
        force = 0.6 * np.sign(speed) * np.exp(-(np.abs(speed / 0.08) ** 1.5))
        return np.outer(force, [0.0, 1.0])

    hidden = stribeck if lost else None
    train = [record(two_arm, swinging(40.0, seed=seed, n=2), seed, hidden) for seed in (1, 2, 3)]
    test = record(two_arm, swinging(40.0, seed=9, n=2), 9, hidden)
    found = find_gap(baseline_model(two_arm, train), train, [test])
    assert [(one.effect, one.joints) for one in found.findings] == ([("stribeck", (1,))] if lost else [])
    assert found.unexplained == ()
    np.testing.assert_allclose(found.evidence.after, NOISE, rtol=0.06)
