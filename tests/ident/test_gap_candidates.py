"""Effects tried on a joint: which of their columns are admissible."""

from types import SimpleNamespace

import numpy as np
import pytest
from planar_arm import logs

from ident.effects.friction_curve import Stribeck
from ident.gap import baseline_model
from ident.gap.candidates import TAIL, Trial, admissible, force_of, fuller_trial
from ident.gap.joint_gap import gate_of
from ident.gap.rows import gap_of, panel_of


@pytest.fixture
def fast(arm):
    """A panel, and its rows in which the second joint, with Stribeck friction over .06 rad/s, moves fast."""
    train = logs(arm, 1, hidden=lambda t, q, dq: 6.0 * np.tanh(dq[:, 1] / 2e-3) * np.exp(-np.abs(dq[:, 1]) / 0.06))
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    return panel, gap_of(model, panel, 1).without(np.abs(panel.velocity[:, 1]) < 0.12).problem(panel)


LAW, SLOW, QUICK = Stribeck(1, power=None), np.array([0.06, 1.0]), np.array([0.08, 1.0])


def test_a_law_of_which_rows_show_the_tail_alone_is_not_told_by_them(fast):
    panel, problem = fast
    assert np.exp(-0.12 / 0.06) < TAIL < np.exp(-0.12 / 0.08)
    assert admissible(panel, problem, LAW, SLOW, 1).shape[1] == 0
    assert admissible(panel, problem, LAW, QUICK, 1).shape[1] == 1
    # What other rows have told is asked of all of them.
    assert np.abs(force_of(panel, problem, Trial(LAW, SLOW, 0.0), 1)).max() > 0.1


def test_a_fuller_form_is_tried_from_shapes_of_which_some_show(fast):
    panel, problem = fast
    (fuller,) = LAW.fuller(SimpleNamespace())
    shapes = QUICK, 0.5 * SLOW
    shown = [admissible(panel, problem, fuller, np.append(shape, 0.05), 1).shape[1] for shape in shapes]
    assert shown == [1, 0]
    plain = [Trial(LAW, shape, 0.0) for shape in shapes]
    assert fuller_trial(panel, gate_of(panel, problem, 1), fuller, plain, 1).drop > 0.0
