import numpy as np

from ident.log import JointLog
from ident.signals import Motion
from learned.motion_discriminator import DiscriminatorSpec
from learned.wrong_latches import count_latches, wrong_latches

RATE = 100.0


def stop_and_go(ring):
    """Ten strokes up and down with a stop after each; the velocity of joint 1 rings back at every stop."""
    speed = []
    for stroke in range(10):
        direction = 1.0 if stroke % 3 else -1.0
        tail = np.zeros(200)
        tail[1] = -ring * direction
        speed.append(np.r_[np.full(100, 0.3 * direction), tail])
    dq = np.stack([np.concatenate(speed), np.zeros(3000)], axis=1)
    dq = np.vstack([np.zeros((100, 2)), dq])
    q = np.cumsum(dq, axis=0) / RATE
    return Motion(np.arange(len(q)) / RATE, q, dq, np.gradient(dq, axis=0) * RATE)


def test_ringing_turns_the_sign_at_every_stop_above_the_threshold():
    motion = stop_and_go(ring=0.015)
    rows = [slice(0, len(motion.t))]
    report = count_latches(motion, rows, DiscriminatorSpec((0.01, 0.02)), RATE)
    np.testing.assert_array_equal(report.stops, [10, 0])
    np.testing.assert_array_equal(report.wrong[:, 0], [10, 0])
    np.testing.assert_allclose(report.share[:, 0], [1.0, 0.0])
    assert np.isnan(report.share[:, 1]).all()


def test_median_and_play_operators_are_ring_proof():
    motion = stop_and_go(ring=0.1)
    rows = [slice(0, len(motion.t))]
    for spec in (DiscriminatorSpec((0.002, 0.01), "median-velocity"), DiscriminatorSpec((0.003, 0.01), "displacement")):
        assert count_latches(motion, rows, spec, RATE).wrong.sum() == 0


def test_a_threshold_that_was_never_reached_is_silent():
    motion = stop_and_go(ring=0.0)
    report = count_latches(motion, [slice(0, len(motion.t))], DiscriminatorSpec((0.5,)), RATE)
    np.testing.assert_array_equal(report.silent[0], [10, 0])
    assert report.wrong.sum() == 0


def test_a_log_is_judged_by_its_causal_motion():
    motion = stop_and_go(ring=0.1)
    log = JointLog(motion.t, motion.q, motion.q * 0.0, dq=motion.dq)
    report = wrong_latches(log, DiscriminatorSpec((0.002, 0.05)), cutoff=40.0)
    np.testing.assert_array_equal(report.stops, [10, 0])
    assert (report.share[:, 0] > 0.5).all()
    assert wrong_latches(log, DiscriminatorSpec((0.003,), "displacement"), cutoff=40.0).wrong.sum() == 0
