"""Rows of logs: which of them are held out together."""

from dataclasses import replace

import numpy as np
from planar_arm import logs, record

from ident.effects.base import Coefficient, Effect, Shape
from ident.gap import baseline_model
from ident.gap.candidates import Trial
from ident.gap.folds import FOLDS, even_folds, goes_beyond
from ident.gap.joint_gap import nested_errors
from ident.gap.rows import gap_of, panel_of


def folds_of_logs(model, train):
    panel = panel_of(model, train)
    return [set(panel.fold[panel.log == k].tolist()) for k in range(len(train))]


def test_a_log_that_is_much_faster_than_all_others_is_in_every_fold(arm):
    train = [*logs(arm, 1), record(arm, 4)]
    model = baseline_model(arm, train)
    assert folds_of_logs(model, train) == [{0}, {1}, {2}, {3}]
    fast = [*train[:3], replace(train[3], q=3.0 * train[3].q)]
    assert folds_of_logs(model, fast) == [{0}, {1}, {2}, set(range(FOLDS))]
    again = [*fast, replace(fast[3], name="again")]  # in another fold: each is predicted from the other
    assert folds_of_logs(model, again) == [{0}, {1}, {2}, {3}, {0}]


def test_every_log_is_cut_into_a_part_of_each_fold_by_the_rows_that_count():
    log = np.repeat([0, 1], [12, 40])
    keep = np.ones(52, dtype=bool)
    keep[:4] = keep[30:] = False
    fold = even_folds(log, keep)
    for number in (0, 1):
        counted = fold[keep & (log == number)]
        assert np.all(np.diff(counted) >= 0)
        assert np.ptp(np.bincount(counted, minlength=FOLDS)) <= 1


def test_a_joint_that_moves_far_beyond_all_other_folds_in_one_is_dealt_to_folds_of_many_parts(arm):
    train = logs(arm, 1)
    once = 3.0 * np.exp(-(((train[0].t - 12.0) / 6.0) ** 2))
    far = [train[0].replace(q=train[0].q + once[:, None] * [0.0, 1.0]), *train[1:]]
    model = baseline_model(arm, train)
    for taken, parts in ((train, 2), (far, 3 * FOLDS)):
        panel = panel_of(model, taken)
        first, second = (gap_of(model, panel, j).dealt(panel) for j in (0, 1))
        assert first.parts is None
        changes = np.count_nonzero(np.diff(second.fold(panel)[panel.log == 1])) + 1
        assert changes == parts


def test_far_is_other_positions_or_faster():
    fold = np.repeat(np.arange(FOLDS), 1000)
    q = np.tile(np.linspace(-1.0, 1.0, 1000), FOLDS)
    dq = np.ones(len(q))
    assert not goes_beyond(fold, q, dq)
    assert not goes_beyond(fold, np.where(fold == 2, 1.4 * q, q), np.where(fold == 1, 1.8, dq))
    assert goes_beyond(fold, np.where(fold == 2, 1.6 * q, q), dq)
    assert goes_beyond(fold, np.where(fold == 2, q + 1.2, q), dq)
    assert goes_beyond(fold, q, np.where(fold == 1, 2.2, dq))


class Waning(Effect):
    """Dry friction that wanes with the time since the robot was switched on."""

    shapes = (Shape("seconds", "s", 1.0, 500.0, (30.0,)),)

    def coefficients(self, robot):
        return (Coefficient("force", "{current}"),)

    def columns(self, context, shape, memory):
        wanes = np.exp(-context.motion.t / shape[0])
        return (wanes * np.tanh(context.motion.dq[:, self.at] / 2e-3))[:, None]


def test_what_shows_in_one_log_is_told_by_parts_of_it(arm):
    # Two things wane: logs after the first tell of the slower one, and nothing of how the first log began.
    def wanes(seed, begins):
        def hidden(t, q, dq):
            since = t + begins
            return (0.9 * np.exp(-since / 15.0) + 0.2 * np.exp(-since / 60.0)) * np.tanh(dq[:, 1] / 2e-3)

        return record(arm, seed, hidden=hidden).replace(t=record(arm, seed).t + begins)

    train = [wanes(seed, 61.0 * k) for k, seed in enumerate((1, 2, 3, 4))]
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    gap, trial = gap_of(model, panel, 1), Trial(Waning(1), np.array([20.0]), 0.0)
    before, known = (gap.problem(panel, [trial] * k).errors().held_out for k in (0, 1))
    _, nested = nested_errors(panel, gap, [], trial)
    assert nested.sum() < 1.2 * known.sum() < 0.8 * before.sum()
