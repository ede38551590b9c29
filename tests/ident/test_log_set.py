"""Logs held against one another: dead channels, units, jitter, logs that are given twice, test logs that misfit."""

import numpy as np
import planar_arm
import pytest

from ident.cautions import misfit_warnings
from ident.errors import InputError
from ident.gap import baseline_model, find_gap
from ident.identification import identify
from ident.log_set import check_together, set_warnings


@pytest.fixture(scope="module")
def logs(arm):
    return planar_arm.logs(arm, 1)


def scaled(log, factor):
    return log.replace(current=log.current * factor, name="odd")


def test_logs_of_one_robot_in_one_unit_pass_without_a_word(logs):
    check_together(logs)
    assert set_warnings(logs[:2], logs[2:]) == []


def test_a_current_that_never_changes_as_its_joint_moves_is_refused(arm, logs):
    dead = [log.replace(current=log.current * np.array([1.0, 0.0])) for log in logs]
    for learn in (identify, baseline_model):
        with pytest.raises(InputError, match="i2 never changes, though joint 2 moves"):
            learn(arm, dead)


def test_a_current_that_changes_in_one_of_the_logs_is_none(logs):
    check_together([logs[0].replace(current=np.zeros_like(logs[0].current)), *logs[1:]])


def test_a_joint_that_stands_needs_no_current(logs):
    still = logs[0].replace(q=logs[0].q * np.array([1.0, 0.0]), current=logs[0].current * np.array([1.0, 0.0]))
    check_together([still])


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_logs_in_two_units_are_refused(arm, logs, factor):
    with pytest.raises(InputError, match=r"currents are .* times those of log1, odd, give all logs in one unit"):
        identify(arm, [*logs[:2], scaled(logs[2], factor)])


def test_a_quiet_log_is_no_other_unit(logs):
    check_together([*logs[:2], scaled(logs[2], 0.05)])


def test_stamps_that_jitter_are_warned_of(logs):
    rng = np.random.default_rng(0)
    early = logs[0].replace(t=np.sort(logs[0].t + 0.008 * rng.standard_normal(len(logs[0].t))), name="jitters")
    (said,) = set_warnings([early], [])
    assert "jitters" in said
    assert "time steps" in said


def test_a_log_that_is_given_twice_is_warned_of(logs):
    copy = logs[0].replace(t=logs[0].t + 60.0, name="copy")
    assert set_warnings(logs[:1], [copy]) == ["copy is the same log as log1: its errors say nothing of other logs."]
    assert set_warnings([logs[0], copy], []) == ["copy is the same log as log1: what it says counts twice."]


def test_test_logs_that_a_model_misses_by_far_are_warned_of(arm, logs):
    model = baseline_model(arm, logs[:2])
    flipped = logs[2].replace(current=-logs[2].current)
    assert any("errs" in said for said in find_gap(model, logs[:2], [flipped]).warnings)
    assert not any("errs" in said for said in find_gap(model, logs[:2], logs[2:]).warnings)
    assert misfit_warnings(arm, np.array([1.0, 1.0]), np.array([2.9, 3.1])) == [
        "Joint 2 (b) errs 3 times as much on the test logs as on the train logs: they hold what those do not "
        "show, as quicker motion, another load, a touch or a flipped sign."
    ]
    (said,) = misfit_warnings(arm, np.array([1.0, 1.0]), np.array([2.9, 3.1]), touched=True)
    assert "contact was cut out of those alone, or they hold" in said
