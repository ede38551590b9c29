"""Rows in which a joint stands, as far as derivatives that are filtered tell."""

import numpy as np

from ident.gap.standing import stands
from ident.log import JointLog
from ident.signals import Motion
from ident.walk import Block

RATE = 100.0


def test_a_turn_too_quick_for_a_slow_sample_is_no_motion_either():
    t = np.arange(400) / RATE
    dq = np.stack([np.sin(2.0 * t + 0.013), np.sin(2.0 * t + 0.013)], axis=1)
    log = JointLog(t=t, q=dq, current=dq)
    block = Block(log, Motion(t, dq, dq, dq), True, np.ones(400, dtype=bool))
    turn = int(np.argmin(np.abs(dq[100:200, 0]))) + 100
    speed = np.array([5e-3, 0.0])
    assert np.abs(dq[:, 0]).min() > speed[0]
    found = stands(block, speed, 0.05)
    assert found[turn - 4 : turn + 5, 0].all()
    assert not found[turn + 20, 0]
    assert not found[:, 1].any()


def test_a_stop_that_the_filter_smears_is_no_motion():
    t = np.arange(400) / RATE
    stops = 0.4 * np.abs(np.sin(2 * np.pi * 0.5 * t)) + 0.012
    creeps = 0.012 + 1e-4 * np.sin(40.0 * t)
    dq = np.column_stack([stops, creeps])
    block = Block(JointLog(t, dq, dq), Motion(t, dq, dq, dq), True, np.ones(len(t), dtype=bool))
    found = stands(block, np.full(2, 5e-3), 0.1)
    assert found[[100, 200, 300], 0].all()
    assert not found[[50, 150, 250, 350], 0].any()
    assert not found[:, 1].any()
