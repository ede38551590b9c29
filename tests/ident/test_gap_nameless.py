"""What has no name gets none: a brake that drags is no joint that warms up, a stop no spring."""

import numpy as np
import pytest
from planar_arm import structure


def early(t, q):
    """Whether it is before a moment of each log, which differs from log to log."""
    return t < 6.0 + 10.0 * np.abs(q[0, 1])


def dragging(t, q, dq):
    return 0.5 * np.sign(dq[:, 1]) * early(t, q)


def stopped(t, q, dq):
    return 3.0 * np.maximum(q[:, 1] - 0.3, 0.0) ** 1.5


def warming(t, q, dq):
    return 0.6 * np.exp(-t / 20.0) * np.sign(dq[:, 1])


def jumping(t, q, dq):
    return 0.4 * early(t, q)


def drifting(t, q, dq):
    return 0.6 * t / 60.0


@pytest.mark.parametrize(
    ("hidden", "name"),
    [(dragging, None), (jumping, None), (stopped, None), (warming, "thermal-friction"), (drifting, "sensor-drift")],
)
def test_stops_and_jumps_have_no_name_and_what_changes_slowly_has(arm, hidden, name):
    found = structure(arm, hidden=hidden)
    assert [(one.effect, one.joints) for one in found.findings] == ([] if name is None else [(name, (1,))])
    if name is None:
        assert [one.joints for one in found.unexplained] == [(1,)]
