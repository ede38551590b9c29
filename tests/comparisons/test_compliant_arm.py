"""A compliant arm: it follows who leads, its figures are those of its motion, and nobody's push goes unjudged."""

import numpy as np
import pytest

from comparisons.experiments.compliant import READY, STIR, JointFollower, Ride, ride, ride_figures
from comparisons.protocols import named
from comparisons.report.compliance_figures import joint_compliance, task_compliance
from comparisons.virtual_robot import VirtualRobot
from comparisons.virtual_robot.contact import Push
from ident.identification import identify
from ident.log import JointLog
from ident.robot import load_robot
from observers.compliance import JointAdmittance
from observers.deadzone import VS060_CURRENT, Deadzone
from observers.momentum import MomentumObserver

FOREARM = Push(link=3, point=(0.0, 0.0, 0.25), force=(60.0, 0.0, 0.0), start=2.5, duration=1.0, rise=0.3)


@pytest.fixture(scope="module")
def virtual():
    return VirtualRobot(load_robot("vs060"))


@pytest.fixture(scope="module")
def rode(virtual):
    """A push on an arm led by the momentum observer, and one that looks on with twice its bandwidth."""
    log = virtual.record(named("stop_and_go")(virtual.robot, seconds=240.0, seed=1), 1)
    effects = ("viscous", "maxwell-slip", "current-offset", "rotor-inertia")
    model = identify(virtual.robot, [log], cutoff=10.0, effects=effects).model
    estimators = {"leads": MomentumObserver(model, 5.0), "looks on": MomentumObserver(model, 10.0)}
    law = JointAdmittance(0.02, Deadzone.of(2.0 * np.array(VS060_CURRENT)), virtual.robot.limits)
    return ride(virtual, JointFollower(estimators, "leads", law), 5.5, [FOREARM])


def test_arm_stirs_rests_yields_and_stops(rode, virtual):
    t, moving = rode.log.t, np.abs(rode.command).max(axis=1) > 0.0
    assert moving[(t > 0.05) & (t < 0.45 * STIR)].all()
    assert not moving[(t >= STIR) & (t < FOREARM.start)].any()
    figures = ride_figures(virtual, rode, [FOREARM])
    (episode,) = figures["episodes"]
    assert episode["links"] == [3]
    assert episode["yielded"][0] > 0.01
    assert 0.0 < episode["force_at_start"] <= 60.0
    assert 0.0 <= episode["stopped_after"] < 0.5
    assert figures["untouched"]["moving_share"] == 0.0
    assert figures["untouched"]["travel"] < 1e-3


def test_rows_near_a_touch_do_not_count_as_untouched(rode):
    t = rode.log.t
    touched = np.abs(rode.log.tau_ext).max(axis=1) > 0.0
    assert not rode.untouched[touched].any()
    assert not rode.untouched[t < READY].any()
    assert not rode.untouched[(t > 3.5) & (t < 4.4)].any()
    assert rode.untouched[t > 4.6].all()


def test_peaks_are_of_each_estimator(rode, virtual):
    peaks = ride_figures(virtual, rode, [FOREARM])["untouched"]["peak"]
    assert list(peaks) == ["leads", "looks on"]
    for name, felt in rode.felt.items():
        np.testing.assert_allclose(peaks[name], np.abs(felt[rode.untouched]).max(axis=0))
    assert np.all(peaks["looks on"] != peaks["leads"])


def test_figures_of_a_motion_written_by_hand(virtual):
    """Two pushes that begin together are one episode; commands after the release are seen until the next push."""
    t = np.arange(0.0, 10.0, 0.01)
    q = np.tile(np.array([0.0, 0.3, 1.0, 0.0, 0.4, 0.0]), (len(t), 1))
    q[:, 0] += 0.1 * np.clip(t - 3.0, 0.0, 1.0)  # joint 1 turns while it is pushed
    command = np.zeros_like(q)
    command[(t >= 3.25) & (t < 4.75), 0] = 0.1
    side = Push(link=3, point=(0.0, 0.0, 0.25), force=(0.0, 40.0, 0.0), start=3.0, duration=1.0, rise=0.5)
    hand = Push(link=6, point=(0.0, 0.0, 0.0), force=(0.0, 20.0, 0.0), start=3.0, duration=1.0, rise=0.5)
    later = Push(link=2, point=(0.0, 0.0, 0.3), force=(10.0, 0.0, 0.0), start=7.0, duration=1.0)
    touched = ((t >= 3.0) & (t < 4.0)) | ((t >= 7.0) & (t < 8.0))
    log = JointLog(t=t, q=q, current=np.zeros_like(q), tau_ext=np.tile(touched[:, None] * 1.0, (1, 6)))
    one = Ride(log, {"x": np.ones_like(q)}, command, (t > 5.0) & (t < 7.0))
    first, second = ride_figures(virtual, one, [later, side, hand])["episodes"]
    assert first["links"] == [3, 6]
    assert first["force_at_start"] == pytest.approx(0.5 * (40.0 + 20.0), rel=0.02)
    assert first["stopped_after"] == pytest.approx(0.74, abs=0.011)
    # about z, at 0.305 sin 0.3 + 0.25 sin 1.3 in front of the axis
    assert first["yielded"][0] == pytest.approx(0.1 * (0.305 * np.sin(0.3) + 0.25 * np.sin(1.3)), rel=0.05)
    assert second["force_at_start"] is None
    assert second["stopped_after"] == 0.0
    assert second["yielded"][0] == pytest.approx(0.0)


def test_pictures_show_all_that_was_felt(rode, virtual):
    figure = joint_compliance(virtual.robot, rode, np.array(VS060_CURRENT), [FOREARM])
    assert {"leads", "looks on", "deadzone", "command"} <= {t.get_text() for t in figure.legends[0].get_texts()}
    log = rode.log.replace(wrench=np.zeros((len(rode.log), 6)))
    task = task_compliance(Ride(log, {"compound": np.ones((len(log), 6))}, rode.command, rode.untouched), np.ones(3))
    assert [axis.get_ylabel() for axis in task.axes[:3]] == ["force x [N]", "force y [N]", "force z [N]"]
