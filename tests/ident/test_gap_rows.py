"""Rows that the workflow looks at: which of them are held out together."""

from dataclasses import replace

import numpy as np
from planar_arm import logs, record

from ident.effects.attached import Payload
from ident.gap import baseline_model
from ident.gap.rows import FOLDS, held_of, panel_of


def folds_of_logs(model, train):
    panel = panel_of(model, train)
    own = np.repeat(
        [[log.name for log in train].index(block.log.name) for block in panel.blocks],
        [len(rows) for rows in panel.rows],
    )
    return [set(panel.fold[own == k].tolist()) for k in range(len(train))]


def test_a_log_that_is_much_faster_than_all_others_is_in_every_fold(arm):
    train = [*logs(arm, 1), record(arm, 4)]
    model = baseline_model(arm, train)
    assert folds_of_logs(model, train) == [{0}, {1}, {2}, {3}]
    fast = [*train[:3], replace(train[3], q=3.0 * train[3].q)]
    assert folds_of_logs(model, fast) == [{0}, {1}, {2}, set(range(FOLDS))]
    again = [*fast, replace(fast[3], name="again")]  # in another fold: each is predicted from the other
    assert folds_of_logs(model, again) == [{0}, {1}, {2}, {3}, {0}]


def test_a_force_that_is_known_but_for_a_factor_is_taken_away_as_much_as_there_is_of_it(arm):
    train = logs(arm, 1)
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    force = panel.columns(Payload(None), np.zeros(0), 1)[:, 1]
    gap = replace(held_of(model, panel, 1), target=0.9 * force)
    for scale, share in (((1.0, 1.0), -0.1), ((0.7, 0.7), 0.0)):
        left = gap.knowing(panel, Payload(None, scale), force).target
        assert np.linalg.norm(left - share * force) < 1e-6 * np.linalg.norm(force)
