"""Rows that the workflow looks at, and what is known of them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planar_arm import logs, record

from ident.coupling import Coupling
from ident.effects.attached import Payload
from ident.effects.base import Term
from ident.effects.friction import Viscous
from ident.effects.friction_curve import Sigmoid
from ident.errors import InputError
from ident.gap import baseline_model, find_gap
from ident.gap.counts import encoder_counts
from ident.gap.panel import Panel
from ident.gap.rows import held_of, panel_of, survey_of
from ident.model import NEWTON_METRE, CurrentModel


def test_a_force_that_is_known_but_for_a_factor_is_taken_away_as_much_as_there_is_of_it(arm):
    train = logs(arm, 1)
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    force = panel.columns(Payload(None), np.zeros(0), 1)[:, 1]
    gap = replace(held_of(model, panel, 1), target=0.9 * force)
    for scale, share in (((1.0, 1.0), -0.1), ((0.7, 0.7), 0.0)):
        left = gap.knowing(panel, Payload(None, scale), force).target
        assert np.linalg.norm(left - share * force) < 1e-6 * np.linalg.norm(force)


def test_of_logs_sampled_faster_fewer_rows_are_looked_at(arm):
    fast, *slow = logs(arm, 1)
    mixed = [fast, *(log[::4] for log in slow)]
    model = baseline_model(arm, mixed)
    assert model.rate == pytest.approx(25.0)
    assert model.cutoff < 12.5
    panel = panel_of(model, mixed)
    steps = [np.diff(b.motion.t[rows]) for b, rows in zip(panel.blocks, panel.rows, strict=True)]
    np.testing.assert_allclose(np.concatenate(steps), 0.04, atol=1e-9)
    assert not find_gap(model, mixed).findings


def test_logs_too_short_for_a_model_that_is_held_fixed_are_refused(arm):
    model = baseline_model(arm, logs(arm, 1))
    with pytest.raises(InputError, match="no row to learn from"):
        find_gap(model, [logs(arm, 4)[0][:8]], refit=False)


def test_dry_friction_that_is_a_sigmoid_turns_over_its_width(arm):
    terms = (
        Term(Viscous(0, smoothing=5e-4), np.zeros(0), np.ones(1)),
        Term(Sigmoid(1), np.array([0.02, 0.0]), np.array([1.0])),
    )
    model = CurrentModel(arm, terms, 5.0, 100.0, np.ones(2), "N*m")
    np.testing.assert_allclose(survey_of(model, panel_of(model, [record(arm, 1)])).smoothing, [5e-4, 0.04])


def test_relative_gains_are_not_taken_for_known_ones(arm):
    train = logs(arm, 1)
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    known, relative = (
        survey_of(replace(model, force_unit=unit), panel).per_newton_metre
        for unit in (NEWTON_METRE, f"relative {NEWTON_METRE}")
    )
    np.testing.assert_array_equal(known, 1.0)
    assert np.all(relative != 1.0)


def test_rows_within_two_counts_of_a_turn_are_those_of_coarse_encoders_alone(arm):
    (log, *_) = logs(arm, 1)
    model = baseline_model(arm, [log])
    fine, coarse = 1e-5, 1.5e-3
    seen = replace(
        log, q=np.column_stack([np.round(log.q[:, 0] / fine) * fine, np.round(log.q[:, 1] / coarse) * coarse])
    )
    panel = panel_of(model, [seen])
    np.testing.assert_allclose(panel.counts, [fine, coarse], rtol=1e-6)
    np.testing.assert_allclose(panel.least_seen, [0.0, 2.0 * coarse], rtol=1e-6)
    turned, after = np.sign(panel.velocity[1:, 1]) != np.sign(panel.velocity[:-1, 1]), panel.unseen
    assert not after[:, 0].any()
    assert after[1:, 1][turned].all()
    assert after[:, 1].mean() < 0.2


def test_counts_are_those_of_the_coarsest_log_whatever_their_zeros(arm):
    count = 1.5e-3
    (log, *_) = logs(arm, 1)
    model = baseline_model(arm, [log])

    def counted(zero, count=count):
        return replace(log, q=np.round(log.q / count) * count + zero, name=f"{zero} {count}")

    for train in ([counted(0.0), counted(3.7e-4)], [counted(0.0), counted(0.0, 1e-5)]):
        np.testing.assert_allclose(panel_of(model, train).counts, [count, count], rtol=1e-6)
    assert not encoder_counts(np.random.default_rng(1).uniform(size=(40, 2))).any()
    assert not encoder_counts(np.ones((40, 2))).any()


def test_counts_of_coupled_motors_are_the_motors():
    coupling = Coupling(np.array([[1.0, 0.0], [0.31, 1.0]]))
    motors = 1.5e-3 * np.random.default_rng(1).integers(0, 99, (300, 2))
    block = SimpleNamespace(log=SimpleNamespace(q=motors @ np.linalg.inv(coupling.matrix).T))
    model = SimpleNamespace(robot=SimpleNamespace(coupling=coupling))
    np.testing.assert_allclose(Panel(model, [block], [], [], np.zeros(0, dtype=int)).counts, 1.5e-3)
