"""What the user is told to look at: logs that go further or faster than those for training."""

import numpy as np

from ident.cautions import reach_warnings
from ident.log import JointLog


def swing(size, rate, name):
    t = np.arange(3000) / 100.0
    q = size * np.sin(2 * np.pi * rate * t[:, None] + np.array([0.0, 1.0]))
    return JointLog(t=t, q=q, current=np.zeros_like(q), name=name)


def test_logs_that_stay_within_the_train_logs_are_not_remarked_on(arm):
    train = [swing(np.array([0.5, 0.6]), 0.2, "a"), swing(np.array([0.3, 0.2]), 0.3, "b")]
    assert reach_warnings(arm, train, [swing(np.array([0.5, 0.6]), 0.2, "c")], 5.0) == []
    assert reach_warnings(arm, train, [], 5.0) == []


def test_further_and_faster_are_told_joint_by_joint(arm):
    train = [swing(np.array([0.5, 0.6]), 0.2, "a")]
    (further,) = reach_warnings(arm, train, [swing(np.array([0.5, 1.2]), 0.2, "b")], 5.0)
    assert f"joint 2 ({arm.joints[1]}) beyond -0.599 to 0.599 rad" in further
    assert "and faster than 0.75" in further
    assert "joint 1" not in further
    (faster,) = reach_warnings(arm, train, [swing(np.array([0.5, 0.6]), 0.4, "c")], 5.0)
    assert "beyond" not in faster
    assert f"joint 1 ({arm.joints[0]}) faster than 0.62" in faster
    assert "and with more than 0.78" in faster
