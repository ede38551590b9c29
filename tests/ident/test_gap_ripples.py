"""Ripples that are more than a sine of one size."""

import numpy as np
import pytest
from planar_arm import structure


def test_a_ripple_that_is_there_only_in_motion_has_one_name_with_its_harmonic(arm):
    def ripple(t, q, dq):
        turns = 30.0 * q[:, 1]
        return np.tanh(np.abs(dq[:, 1]) / 0.05) * (0.5 * np.sin(turns) + 0.25 * np.sin(2.0 * turns))

    found = structure(arm, hidden=ripple)
    (one,) = found.findings
    assert (one.effect, one.joints, one.alternatives) == ("gear-ripple", (1,), ("cogging",))
    expected = {"force": 0.5, "per_turn": 30.0, "second_harmonic": 0.25, "speed": 0.05}
    assert {key: one.parameters[key] for key in expected} == pytest.approx(expected, rel=0.05)
    assert found.unexplained == ()
