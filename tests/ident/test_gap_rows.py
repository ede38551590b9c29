"""Rows that the workflow looks at, and what is known of them."""

from dataclasses import replace

import numpy as np
from planar_arm import logs

from ident.effects.attached import Payload
from ident.gap import baseline_model
from ident.gap.rows import held_of, panel_of


def test_a_force_that_is_known_but_for_a_factor_is_taken_away_as_much_as_there_is_of_it(arm):
    train = logs(arm, 1)
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    force = panel.columns(Payload(None), np.zeros(0), 1)[:, 1]
    gap = replace(held_of(model, panel, 1), target=0.9 * force)
    for scale, share in (((1.0, 1.0), -0.1), ((0.7, 0.7), 0.0)):
        left = gap.knowing(panel, Payload(None, scale), force).target
        assert np.linalg.norm(left - share * force) < 1e-6 * np.linalg.norm(force)
