"""Laws of friction: the columns that their papers write, and the shapes that they are tried at."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ident.effects.base import Context
from ident.effects.electrical import SensorDrift, TorqueSaturation
from ident.effects.friction import Coulomb, LoadFriction, PositionFriction
from ident.effects.friction_curve import Sigmoid, Stribeck, ViscousNonlinear
from ident.effects.hysteresis import CrossJointHysteresis, MaxwellSlip
from ident.effects.transmission import CrossJointFriction
from ident.signals import Motion

HALVES = (slice(0, 170), slice(170, None))


def test_friction_by_the_load_of_bodies_is_that_of_the_urdf(context):
    motion, bodies = context.motion, context.robot.multibody.parameters
    load = context.robot.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, bodies)[:, 1]
    nothing = np.zeros(0)
    found = LoadFriction(1, per_newton_metre=2.0).columns(context, nothing, nothing)[:, 0]
    fitted = LoadFriction(1).columns(context, nothing, nothing)[:, 0]
    np.testing.assert_allclose(found * np.abs(context.load[:, 1]), 2.0 * fitted * np.abs(load), atol=1e-9)


def test_friction_by_a_load_that_drives_is_apart_from_that_by_one_that_is_driven(context):
    nothing = np.zeros(0)
    driving, driven = LoadFriction(1, driven=True).columns(context, nothing, nothing).T
    onward = context.load[:, 1] * context.motion.dq[:, 1] > 0.0
    fast = np.abs(context.motion.dq[:, 1]) > 0.1
    size = np.sign(context.motion.dq[:, 1]) * np.abs(context.load[:, 1])
    np.testing.assert_allclose(driving[fast], np.where(onward, size, 0.0)[fast], atol=1e-9)
    np.testing.assert_allclose(driven[fast], np.where(onward, 0.0, size)[fast], atol=1e-9)


def test_a_fluid_turns_with_the_velocity_where_dry_friction_builds_up(context):
    survey = SimpleNamespace(smoothing=np.full(6, 1e-3), presliding=np.full(6, 2e-3), presliding_exponent=np.ones(6))
    dq = context.motion.dq[:, 1]
    for law in ViscousNonlinear.candidates(survey, 1):
        shape = np.array([law.shapes[0].starts[0]])
        found = law.columns(context, shape, law.start())[:, 0]
        np.testing.assert_allclose(found, np.tanh(dq / 1e-3) * np.abs(dq) ** shape, atol=1e-8)


def test_a_saturation_without_an_end_is_one_whose_knee_is_far(context):
    plain, levels = TorqueSaturation(1, 2.0), TorqueSaturation(1, 2.0, levels=True)
    assert (plain.fuller(None), levels.fuller(None)) == ([levels], [])
    assert levels.shapes[1].upper == 2.0
    nothing = np.zeros(0)
    far, near = (levels.columns(context, np.array([4.0, knee]), nothing)[:, 0] for knee in (100.0, 0.2))
    np.testing.assert_allclose(far, plain.columns(context, np.array([4.0]), nothing)[:, 0], rtol=1e-6)
    # Beyond a knee that is near, the share is what it is at the largest force; below it there is none.
    share = near / context.total[:, 1]
    force = np.abs(context.total[:, 1]) / 2.0
    beyond, below = share[force > 0.8], share[force < 0.03]
    assert min(len(beyond), len(below)) > 5
    np.testing.assert_allclose(beyond, 1.0, atol=5e-3)
    np.testing.assert_allclose(below, 0.0, atol=1e-3)
    told = levels.summary(context.robot, np.array([4.0, 0.2]), np.array([0.25]))
    assert told == {"share": pytest.approx(0.2), "power": 4.0, "knee": 0.2}


def test_a_film_that_lags_is_that_of_the_speed_before(context):
    motion, shape = context.motion, np.array([0.1, 1.0, 0.2])
    lagging, at_once = (Stribeck(1, power=None, lags=lags) for lags in (True, False))
    found = lagging.columns(context, shape, lagging.start())[:, 0]
    film, speed, steps = [], np.abs(motion.dq[:, 1]), np.diff(motion.t, prepend=motion.t[0])
    for one, step in zip(speed.tolist(), steps.tolist(), strict=True):
        film.append(one if not film else one + (film[-1] - one) * np.exp(-step / 0.2))
    sign = np.tanh(motion.dq[:, 1] / lagging.smoothing)
    np.testing.assert_allclose(found, sign * np.exp(-np.array(film) / 0.1), atol=1e-9)
    assert not np.allclose(found, at_once.columns(context, shape[:2], at_once.start())[:, 0], atol=0.01)


def test_a_power_of_speed_is_tried_on_either_side_of_viscous_friction():
    survey = SimpleNamespace(smoothing=np.full(6, 2e-3), presliding=np.zeros(6), presliding_exponent=np.ones(6))
    ranges = [form.shapes[0] for form in ViscousNonlinear.candidates(survey, 1)]
    assert [(s.lower, s.upper, s.starts) for s in ranges] == [(0.1, 0.9, (0.5, 0.2)), (1.1, 4.0, (2.0, 3.0))]


@pytest.mark.parametrize(
    ("slides", "reach", "fewest"), [(False, 1.5, 1.05), (False, 6.0, 0.3), (False, 0.01, 6.0), (True, 0.5, 0.5)]
)
def test_friction_swings_a_quarter_and_more_over_the_positions_seen(slides, reach, fewest):
    figures = {"smoothing": 2e-3, "presliding": 1e-4, "presliding_exponent": 0.5, "reach": reach}
    robot = SimpleNamespace(multibody=SimpleNamespace(prismatic=[slides] * 6))
    survey = SimpleNamespace(robot=robot, **{key: np.full(6, value) for key, value in figures.items()})
    one, two = PositionFriction.candidates(survey, 1)
    assert one.turn == (1.0 if slides else 2.0 * np.pi)
    assert (one.harmonics, two.harmonics) == (1, 2)
    assert (one.smoothing, one.presliding, one.presliding_exponent) == (2e-3, 1e-4, 0.5)
    for (swings,) in (one.shapes, two.shapes):
        assert swings.lower == pytest.approx(fewest, abs=0.01)
        assert all(swings.lower < start < swings.upper for start in swings.starts)


@pytest.mark.parametrize(
    ("gears", "slides", "quicker"), [(None, False, 1.0), (100.0, False, 1.0), (10.0, False, 5.0), (10.0, True, 1.0)]
)
def test_friction_falls_and_rises_by_as_much_of_the_motors_speed(gears, slides, quicker):
    figures = {"smoothing": 2e-3, "presliding": 0.0, "presliding_exponent": 1.0}
    ratio = None if gears is None else np.full(6, gears)
    robot = SimpleNamespace(multibody=SimpleNamespace(prismatic=[slides] * 6), gear_ratio=ratio)
    survey = SimpleNamespace(robot=robot, **{key: np.full(6, value) for key, value in figures.items()})
    for kind, fastest in ((Stribeck, 0.5), (Sigmoid, 0.2)):
        (law,) = kind.candidates(survey, 1)
        speed = law.shapes[0]
        assert speed.upper == pytest.approx(quicker * fastest)
        assert max(speed.starts) < speed.upper


@pytest.mark.parametrize("exponent", [0.0, 0.3, 0.7, 1.0])
def test_friction_that_yields_builds_up_as_dahl_wrote(vs060, exponent):
    """Over steps of any length what small steps of his differential equation give."""
    q = np.zeros((9, 6))
    q[:, 1] = 1e-4 * np.array([0.0, 0.5, 3.0, 2.9, 2.2, 2.4, -4.0, -3.8, -3.8])
    law = Coulomb(1, presliding=1e-4, presliding_exponent=exponent)
    motion = Motion(np.arange(9.0), q, np.zeros((9, 6)), np.zeros((9, 6)))
    found = law.columns(Context(vs060, motion), np.zeros(0), law.start())[:, 0]
    z, expected = 0.0, [0.0]
    for step in np.diff(q[:, 1]):
        small = step / 20_000
        for _ in range(20_000):
            z = np.clip(z + small / 1e-4 * max(1.0 - z * np.sign(small), 0.0) ** exponent, -1.0, 1.0)
        expected.append(z)
    np.testing.assert_allclose(found, expected, atol=2e-4)
    assert np.all(np.abs(found) <= 1.0)


@pytest.mark.parametrize("slip", [1e-5, 1e-4])
def test_friction_builds_up_from_where_a_joint_turned_between_samples(vs060, slip):
    """At 100 Hz what it is at 10 kHz, of turns of .4 to 2 rad/s^2: a sample is then up to 25 um wide on either side."""
    t = np.arange(80_000) / 1e4
    w = np.array([2.0, 3.1, 4.7])[:, None, None]
    phase = np.random.default_rng(2).uniform(0, 6, (3, 1, 6))
    q, dq, ddq = (np.sum(0.05 * w**k * np.sin(w * t[:, None] + phase + 0.5 * k * np.pi), axis=0) for k in range(3))
    law, motion = Coulomb(1, presliding=slip, presliding_exponent=0.5), Motion(t, q, dq, ddq)
    fine, coarse = (law.columns(Context(vs060, m), np.zeros(0), law.start())[:, 0] for m in (motion, motion[::100]))
    np.testing.assert_allclose(coarse[1:], fine[::100][1:], atol=0.03)


def test_a_symmetric_sigmoid_is_one_without_shift(context):
    # Few turns tell a shift: it is tried only where the plain law shows.
    plain, full = Sigmoid(1, symmetric=True), Sigmoid(1)
    assert plain.fuller(None) == [full]
    assert full.fuller(None) == []
    one, both = np.array([0.06]), np.array([0.06, 0.0])
    columns = [law.columns(context, shape, law.start()) for law, shape in ((plain, one), (full, both))]
    np.testing.assert_array_equal(*columns)
    np.testing.assert_array_equal(plain.gradient(context, one), full.gradient(context, both)[:1])
    figures = {law.summary(context.robot, x, np.ones(1))["shift"] for law, x in ((plain, one), (full, both))}
    assert figures == {0.0}


def test_a_searched_power_of_stribeck_friction_is_the_given_one(context):
    given, searched = Stribeck(1, power=1.3), Stribeck(1, power=None)
    columns = given.columns(context, np.array([0.05]), given.start())
    np.testing.assert_allclose(searched.columns(context, np.array([0.05, 1.3]), searched.start()), columns)
    assert searched.summary(context.robot, np.array([0.05, 1.3]), np.array([2.0])) == {
        "force": 2.0,
        "speed": 0.05,
        "power": 1.3,
    }


@pytest.mark.parametrize("presliding", [0.0, 3e-4])
def test_a_mix_of_two_joints_is_no_friction_of_one(vs060, presliding):
    survey = SimpleNamespace(robot=vs060, presliding=np.full(6, presliding), presliding_exponent=np.full(6, 0.5))
    forms = CrossJointFriction.candidates(survey, 4)
    assert {(form.source, form.side) for form in forms} == {(k, side) for k in (0, 1, 2, 3, 5) for side in (1, -1)}
    for form in forms:
        mix = form.shapes[0]
        assert min(abs(mix.lower), abs(mix.upper)) == pytest.approx(0.2)
        assert mix.ends == (form.side > 0, form.side < 0)
        # The other joint's own may build up over a fraction of a milliradian: of that this one's motion moves none.
        assert min(abs(np.cos(mix.starts))) < 1e-5
        # What yields turns over a displacement, and over no speed.
        assert len(form.shapes) == (1 if presliding else 2)


def test_force_of_friction_that_follows_the_other_joint_alone_is_along_its_motion(vs060):
    form = CrossJointFriction(4, 5)
    force = np.array([-2.0, 0.0])
    told = form.summary(vs060, np.array([-0.5 * np.pi + 1e-3, 0.02]), force)
    assert (told["force"], told["mix"]) == (2.0, pytest.approx(0.5 * np.pi + 1e-3))
    # The joint's own motion counts: below nought it is dragged along.
    assert form.summary(vs060, np.array([-0.8, 0.02]), force)["force"] == -2.0


def test_friction_of_two_joints_builds_up_over_their_motion_together(context):
    form, mix = CrossJointFriction(4, 5, 1, presliding=3e-4, presliding_exponent=0.5), 0.7
    columns = form.columns(context, np.array([mix]), form.start())
    q, dq = (np.cos(mix) * x[:, 4] + np.sin(mix) * x[:, 5] for x in (context.motion.q, context.motion.dq))
    alone = Coulomb(0, presliding=3e-4, presliding_exponent=0.5)
    moved = replace(context.motion, q=np.tile(q[:, None], (1, 6)), dq=np.tile(dq[:, None], (1, 6)))
    wanted = alone.columns(Context(context.robot, moved), np.zeros(0), alone.start())
    np.testing.assert_allclose(columns, np.column_stack([wanted, context.motion.dq[:, 5]]))
    memory = form.start()
    parts = [form.columns(replace(context, motion=context.motion[rows]), np.array([mix]), memory) for rows in HALVES]
    np.testing.assert_allclose(np.concatenate(parts), columns)


def test_a_drift_that_settles_is_a_steady_one_at_first_and_then_ends():
    drift, steady = SensorDrift(0, since=100.0, settles=True), SensorDrift(0, since=100.0)
    t = np.array([100.0, 100.1, 1e4])
    motion = Motion(t, *np.zeros((3, 3, 1)))
    columns = drift.columns(Context(None, motion), np.array([20.0]), np.zeros(0))[:, 0]
    assert columns[1] == pytest.approx(steady.columns(Context(None, motion), np.zeros(0), np.zeros(0))[1, 0], rel=3e-3)
    assert columns[2] == pytest.approx(20.0 / 3600.0)


def test_the_rate_of_a_drift_that_settles_is_its_mean_over_the_logs():
    motion = Motion(np.array([100.0, 160.0]), *np.zeros((3, 2, 1)))
    for seconds in (5.0, 20.0, 3000.0):
        drift = SensorDrift(0, since=100.0, settles=True, over=60.0)
        columns = drift.columns(Context(None, motion), np.array([seconds]), np.zeros(0))[:, 0]
        np.testing.assert_allclose(columns, [0.0, 60.0 / 3600.0])


@pytest.mark.parametrize("side", [1, -1])
def test_hysteresis_that_two_joints_drive_brakes_this_one(context, side):
    form, shape = CrossJointHysteresis(4, 5, side), np.array([2e-2, 1.5])
    columns = form.columns(context, shape, form.start())
    alone = MaxwellSlip(0)
    q = side * context.motion.q[:, 5] + 1.5 * context.motion.q[:, 4]
    moved = replace(context.motion, q=np.tile(q[:, None], (1, 6)))
    np.testing.assert_allclose(columns, alone.columns(Context(context.robot, moved), shape[:1], alone.start()))
    assert form.summary(context.robot, shape, np.array([0.0, 2.0, 0.0])) == {
        "force": 2.0,
        "slip": 2e-2,
        "own": 1.5 * side,
    }


def spots(angle):
    """Dry friction with three spots that rub, at no even distances."""
    return sum(size * np.exp(-(((angle - at) / 0.22) ** 2)) for at, size in ((-0.7, 0.5), (0.1, 0.9), (0.6, 0.6)))


def test_spots_that_rub_are_told_by_half_waves_over_the_range(context):
    survey = SimpleNamespace(reach=np.full(6, 2.0), middle=np.full(6, -0.1))
    one, two = PositionFriction(1, harmonics=1), PositionFriction(1)
    (waves,) = two.fuller(survey)
    assert (one.fuller(survey), waves.fuller(survey), waves.shapes) == ([], [], ())
    assert len(waves.coefficients(context.robot)) == waves.harmonics == 12
    t = np.linspace(0.0, 20.0, 4001)
    q = np.zeros((len(t), 6))
    q[:, 1] = -0.1 + np.sin(2.0 * np.pi * 0.21 * t)
    motion = Motion(t, q, np.gradient(q, t, axis=0), np.zeros_like(q))
    there = replace(context, motion=motion)
    columns = waves.columns(there, np.zeros(0), waves.start())
    wanted = np.tanh(motion.dq[:, 1] / waves.smoothing) * spots(q[:, 1])
    columns, coulomb = np.column_stack([columns, np.tanh(motion.dq[:, 1] / waves.smoothing)]), 12
    found = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    np.testing.assert_allclose(columns @ found, wanted, atol=0.03)
    summary = waves.summary(context.robot, np.zeros(0), np.delete(found, coulomb))
    assert summary["force"] == pytest.approx(0.45, rel=0.05)
    assert summary["most_at"] == pytest.approx(0.1, abs=0.03)
    # Beyond its ends friction is as at them.
    q[:, 1] = np.where(np.arange(len(t)) % 2, 1.4, 0.9)
    at, beyond = waves.columns(there, np.zeros(0), waves.start())[:2] / np.tanh(motion.dq[:2, [1]] / waves.smoothing)
    np.testing.assert_allclose(beyond, at, atol=1e-9)


def test_a_short_range_has_no_room_for_spots():
    survey = SimpleNamespace(reach=np.full(6, 0.5), middle=np.zeros(6))
    assert PositionFriction(1).fuller(survey) == []
