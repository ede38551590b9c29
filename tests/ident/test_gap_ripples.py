"""Ripples that are more than a sine of one size."""

import numpy as np
import pytest
from planar_arm import structure
from scipy.signal import butter, lfilter


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


def test_a_ripple_fades_where_it_passes_too_quickly_for_the_position_loop(arm):
    def ripple(t, q, dq):
        return lfilter(*butter(1, 4.0, fs=1.0 / (t[1] - t[0])), 0.8 * np.sin(40.0 * q[:, 1]))

    found = structure(arm, hidden=ripple)
    (one,) = found.findings
    assert (one.effect, one.joints) == ("gear-ripple", (1,))
    expected = {"force": 0.8, "per_turn": 40.0, "hertz": 4.0}
    assert {key: one.parameters[key] for key in expected} == pytest.approx(expected, rel=0.1)
    assert found.unexplained == ()
