"""Causes of the whole robot, told from what single joints might have."""

from dataclasses import replace

import numpy as np
import planar_arm
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, lfilter_zi
from scipy.spatial.transform import Rotation

from ident.effects.attached import GravityBalancer, Payload
from ident.effects.rigid_body import CableSpring
from ident.effects.timing import Delay, FilterLag
from ident.effects.transmission import Elasticity
from ident.gap import baseline_model, find_gap, ranking
from ident.gap.candidates import Trial
from ident.gap.on_all import Whole
from ident.gap.ranking import by_motion, mostly_there, ranked
from ident.gap.rows import gap_of, panel_of, survey_of
from ident.gap.whole import _denied, _exhausts, _Judge, _rivals, _stands_alone
from ident.log import JointLog
from ident.robot import load_robot

CRANE = """<robot name="crane"><link name="base"/>
<link name="column"><inertial><mass value="8"/><origin xyz=".05 0 .3"/>
<inertia ixx=".1" iyy=".1" izz=".05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="boom"><inertial><mass value="5"/><origin xyz=".6 0 0"/>
<inertia ixx=".02" iyy=".2" izz=".2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pan" type="revolute"><parent link="base"/><child link="column"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="3" effort="100"/></joint>
<joint name="lift" type="revolute"><parent link="column"/><child link="boom"/><origin xyz="0 0 .6"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="3" effort="100"/></joint></robot>"""


@pytest.fixture(scope="module")
def crane(write_card):
    """A boom on an upright column."""
    return load_robot(write_card("crane", CRANE, 'current_unit = "A"'))


def record(crane, seed, tilt=(0.0, 0.0), yields=0.0):
    """The boom hardly lifts, and its current is too noisy to show a tilt of milliradians."""
    rng = np.random.default_rng(seed)
    t = np.arange(4000) / 100.0
    size = np.array([0.35, 0.15])
    waves = (
        size * rng.uniform(0.5, 1.0, 2) * np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 6, 2))
        for f in (0.07, 0.19, 0.31)
    )
    spline = CubicSpline(t, sum(waves))
    q, dq, ddq = spline(t), spline(t, 1), spline(t, 2)
    down = Rotation.from_euler("xyz", [*tilt, 0.0]).inv().apply([0.0, 0.0, -9.81])
    torque = crane.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(crane.multibody.parameters, (2, 1)), down)
    torque += planar_arm.friction(dq)
    torque += np.array([0.03, 0.8]) * np.random.default_rng(seed + 50).standard_normal(q.shape)
    held = 0.0
    for k in range(1, len(t)):
        held = np.clip(held + (q[k, 0] - q[k - 1, 0]) / 0.1, -1.0, 1.0)
        torque[k, 0] += yields * held
    return JointLog(t=t, q=q, current=torque, name=f"log{seed}")


def test_a_tilt_that_an_upright_joint_alone_shows_comes_before_springs_of_it(crane):
    # A balancer with twice as many parameters explains a ten-thousandth more.
    tilt = (0.002, -0.0015)
    model = baseline_model(crane, [record(crane, seed) for seed in (1, 2, 3)])
    found = find_gap(model, [record(crane, seed, tilt) for seed in (4, 5, 6)], refit=False)
    (one,) = found.findings
    assert (one.effect, one.joints) == ("base-tilt", ())
    assert list(one.alternatives) == ["gravity-balancer"]
    assert (one.parameters["roll"], one.parameters["pitch"]) == pytest.approx(tilt, rel=0.05)


def test_a_tilt_and_friction_that_yields_each_show_only_beside_the_other(crane):
    # Half of what the column lacks is neither's: alone the one would leave the other unexplained.
    tilt = (0.002, -0.0015)
    model = baseline_model(crane, [record(crane, seed) for seed in (1, 2, 3)])
    found = find_gap(model, [record(crane, seed, tilt, 0.12) for seed in (4, 5, 6)], refit=False)
    assert {(one.effect, one.joints) for one in found.findings} == {("base-tilt", ()), ("maxwell-slip", (0,))}
    tilted = next(one for one in found.findings if one.effect == "base-tilt")
    assert (tilted.parameters["roll"], tilted.parameters["pitch"]) == pytest.approx(tilt, rel=0.1)


@pytest.mark.parametrize(
    ("told", "denied"),
    [([406.0, -183.0, -58.0, -1.0], True), ([3196.0, 523.0, 537.0, -2.0], False), ([3130.0, 1929.0, -175.0], False)],
)
def test_joints_may_deny_a_cause_of_all(told, denied):
    assert _denied(np.array(told)) is denied


def test_a_spring_is_not_tried_in_full_whose_fuller_form_has_a_shape_that_it_has_not():
    spring = Elasticity(0, rings=True)
    named = Whole(spring, np.array([0.01, 0.3]), np.ones(1), np.ones((1, 4)), 9.0, 9.0)
    assert spring.shapes
    assert _Judge(None, None, [], False, None)._in_full(named) is named


@pytest.mark.parametrize(("standing", "first"), [(99.0, "delay"), (90.0, "filter-lag")])
def test_small_errors_of_a_model_do_not_choose_between_a_delay_and_a_filter(standing, first):
    def whole(effect, standing, likelihood):
        return Whole(effect, np.zeros(1), np.zeros(1), np.zeros((1, 4)), likelihood, standing)

    delay, lag = whole(Delay(None), standing, 103.0), whole(FilterLag(None), 100.0, 102.0)
    payload = whole(Payload(None), 99.5, 104.0)
    assert ranked([delay, lag])[0].effect.name == first
    assert ranked([payload, lag])[0] is lag


@pytest.mark.parametrize(
    ("moving", "standing", "first"), [(2.0, 98.0, "filter-lag"), (-2.0, 98.0, "delay"), (2.0, 90.0, "delay")]
)
def test_motion_chooses_between_a_delay_and_a_filter(monkeypatch, moving, standing, first):
    def whole(effect, standing):
        return Whole(effect, np.zeros(1), np.zeros(1), np.zeros((1, 4)), standing, standing)

    gains = {"delay": 10.0, "filter-lag": 10.0 + moving}
    monkeypatch.setattr(ranking, "_in_motion", lambda panel, problems, one, parameters: gains[one.effect.name])
    effects = Payload(None), Delay(None), Delay(None), FilterLag(None)
    payload, delay, late, lag = map(whole, effects, (120.0, 100.0, 99.0, standing))
    found = by_motion(None, [], [payload, delay, late, lag])
    assert found[0] is payload
    assert found[1].effect.name == first
    assert len(found) == 4
    assert by_motion(None, [], [payload]) == [payload]


@pytest.mark.parametrize(("share", "there"), [(0.17, False), (0.9, True), (2.5, False)])
def test_most_of_the_current_passes_a_filter(share, there):
    lag = Whole(FilterLag(None), np.array([2.7]), np.array([share]), np.zeros((6, 4)), 100.0, 90.0)
    assert mostly_there(lag) is there
    assert mostly_there(replace(lag, law=lag))


@pytest.mark.parametrize("late", [True, False])
def test_a_delay_and_a_filter_each_tell_their_own_logs_motion_best(arm, late):
    def filtered(log):
        pole = np.exp(-1.0 / (0.015 * planar_arm.RATE))
        passes = [0.5 * (1.0 - pole)] * 2, [1.0, -pole]
        return replace(log, current=lfilter(*passes, log.current, axis=0, zi=0.5 * (1.0 + pole) * log.current[:1])[0])

    train = [planar_arm.delayed(log, 0.015) if late else filtered(log) for log in planar_arm.logs(arm, 1)]
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    problems = [gap_of(model, panel, j).problem(panel) for j in range(2)]
    delay = Whole(Delay(None), np.array([0.015]), np.array([0.015]), np.zeros((2, 4)), 100.0, 100.0)
    lag = Whole(FilterLag(None), np.array([1.0 / (2.0 * np.pi * 0.015)]), np.ones(1), np.zeros((2, 4)), 101.0, 100.0)
    assert by_motion(panel, problems, [lag, delay])[0].effect.name == ("delay" if late else "filter-lag")
    assert by_motion(panel, problems, [delay, lag])[0].effect.name == ("delay" if late else "filter-lag")


@pytest.mark.parametrize(
    ("joint", "others", "stands"),
    [(3, 0.0, True), (3, -60.0, False), (2, 0.0, False), (2, 100.0, False)],
    ids=["own joint", "costs others", "another joint", "another joint, borne out"],
)
def test_a_spring_that_shows_on_one_joint_must_be_worth_its_choice_among_all_joints(joint, others, stands):
    # On the joint it explains 1.1 times what a balancer there does.
    likelihoods, singles = np.array([0.0, 0.0, others, 440.0]), np.array([5.0, 5.0, 5.0, 400.0])
    spring = Whole(Elasticity(joint), np.zeros(0), np.ones(1), np.zeros((4, 4)), float(likelihoods.sum()), 0.0)
    balancer = Trial(GravityBalancer(3), np.zeros(0), 400.0, columns=2)
    assert _stands_alone(spring, balancer, likelihoods, singles, 3) is stands


@pytest.mark.parametrize(("size", "exhausted"), [(0.0, True), (0.4, False)])
def test_a_cause_beside_which_much_has_a_memory_leaves_too_much(arm, size, exhausted):
    """A liquid that sloshes follows no signal of a moment, but itself."""

    def hidden(t, q, dq):
        blows = np.random.default_rng(round(1e6 * abs(q[0, 0]))).standard_normal(len(t))
        pole = 0.99 * np.exp(2j * np.pi * 1.8 / planar_arm.RATE)
        sloshes = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], blows)
        return 0.4 * (q[:, 1] - 0.1) + size * sloshes / sloshes.std()

    train = planar_arm.logs(arm, 1, hidden=hidden)
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    whole = Whole(CableSpring(1), np.array([0.1]), np.array([0.4, 0.0]), np.zeros((2, 4)), 1.0, 1.0)
    assert _exhausts(panel, survey_of(model, panel), gap_of(model, panel, 1).problem(panel), whole, 1) == exhausted


def passed(log, order, hertz):
    """The log with its currents through Butterworth's filter."""
    passes = butter(order, hertz, fs=planar_arm.RATE)
    settled = lfilter_zi(*passes)[:, None] * log.current[0]
    return replace(log, current=lfilter(*passes, log.current, axis=0, zi=settled)[0])


def test_all_of_the_current_comes_late_where_that_explains_nearly_as_much(arm):
    # A filter of fourth order, as the catalogue has none: a longer delay of less of the current is a little nearer.
    train = [passed(planar_arm.record(arm, seed), 4, 18.0) for seed in (1, 2, 3)]
    (late,) = find_gap(baseline_model(arm, train), train).findings
    assert (late.effect, late.joints) == ("delay", ())
    assert late.parameters["seconds"] == pytest.approx(late.parameters["span"], rel=0.1)


def test_a_filter_of_second_order_is_no_delay(arm):
    train = [passed(planar_arm.record(arm, seed), 2, 12.0) for seed in (1, 2, 3)]
    (late,) = find_gap(baseline_model(arm, train), train).findings
    assert (late.effect, late.joints) == ("filter-lag", ())
    assert late.parameters["hertz"] == pytest.approx(12.0, rel=0.05)
    assert late.parameters["share"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("helped", "is_rival"), [([0, 1], True), ([0, 1, 2], False)])
def test_what_a_joint_has_that_a_cause_of_all_does_not_help_is_its_own(helped, is_rival):
    likelihoods, singles = np.array([90.0, 9.0, 1.0]), np.array([50.0, 9.0, 400.0])
    affected = np.array([True, False, True])
    assert _rivals(likelihoods, singles, affected, np.array(helped)) is is_rival


def test_joints_that_bear_a_cause_of_all_out_must_not_each_have_a_better_one_of_their_own():
    # Friction that turns late on every joint looks like one delay, which helps one joint by enough to be asked.
    likelihoods = np.array([671.0, 190.0, 245.0, 275.0, 319.0])
    affected = np.array([True, True, False, True, True])
    own = np.array([771.0, 688.0, 249.0, 671.0, 876.0])
    assert not _rivals(likelihoods, own, affected, np.array([0]))
    assert _rivals(likelihoods, np.minimum(own, 1.1 * likelihoods), affected, np.array([0]))
