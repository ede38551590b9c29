"""Effects tried on a joint: which of their columns are admissible."""

import numpy as np
from planar_arm import logs

from ident.effects.friction import Stribeck
from ident.gap import baseline_model
from ident.gap.candidates import TAIL, Trial, admissible, force_of
from ident.gap.rows import gap_of, panel_of


def test_a_law_of_which_rows_show_the_tail_alone_is_not_told_by_them(arm):
    train = logs(arm, 1, hidden=lambda t, q, dq: 6.0 * np.tanh(dq[:, 1] / 2e-3) * np.exp(-np.abs(dq[:, 1]) / 0.06))
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    fast = gap_of(model, panel, 1).without(np.abs(panel.velocity[:, 1]) < 0.12).problem(panel)
    slow, quick = np.array([0.06, 1.0]), np.array([0.08, 1.0])
    assert np.exp(-0.12 / 0.06) < TAIL < np.exp(-0.12 / 0.08)
    law = Stribeck(1, power=None)
    assert admissible(panel, fast, law, slow, 1).shape[1] == 0
    assert admissible(panel, fast, law, quick, 1).shape[1] == 1
    # What other rows have told is asked of all of them.
    assert np.abs(force_of(panel, fast, Trial(law, slow, 0.0), 1)).max() > 0.1
