"""Moves that start and stop at once: what the cut-off takes of them is no spring."""

from dataclasses import replace

import numpy as np
import pytest
from planar_arm import RATE, friction, logs, motion, record

from ident.gap import baseline_model, find_gap
from ident.gap.candidates import force_of
from ident.gap.rows import gap_of, panel_of, survey_of
from ident.gap.search import search
from ident.log import JointLog
from ident.signals import Motion

NOISE = 5e-3


def moves(seed, seconds=40.0):
    """Trapezoids of the velocity with stops between them; the joints set out together."""
    rng = np.random.default_rng(seed)
    ddq = []
    while sum(map(len, ddq)) < seconds * RATE:
        steep, cruise, rest = (round(rng.uniform(*span) * RATE) for span in ((0.15, 0.4), (0.2, 0.8), (0.2, 0.6)))
        shape = np.concatenate([np.ones(steep), np.zeros(cruise), -np.ones(steep), np.zeros(rest)])
        there = np.outer(shape, rng.uniform(2.0, 5.0, 2))
        ddq += [there, -there]
    a = np.concatenate(ddq)
    v = np.cumsum(a, axis=0) / RATE
    q = (np.cumsum(v, axis=0) - 0.5 * v) / RATE + rng.uniform(-0.3, 0.3, 2)
    return Motion(np.arange(len(a)) / RATE, q, v - 0.5 * a / RATE, a)


def steep_log(arm, seed):
    moved = moves(seed)
    parameters = np.tile(arm.multibody.parameters, (2, 1))
    torque = arm.rigid_body.inverse_dynamics(moved.q, moved.dq, moved.ddq, parameters)
    torque += friction(moved.dq)
    torque += NOISE * np.random.default_rng(seed + 50).standard_normal(torque.shape)
    return JointLog(t=moved.t, q=moved.q, current=torque, name=f"moves{seed}")


@pytest.fixture(scope="module")
def steep(arm):
    return [steep_log(arm, seed) for seed in (1, 2)]


def test_what_is_cut_away_is_a_series_in_what_the_filter_takes_of_its_own_result(arm):
    model = replace(baseline_model(arm, logs(arm, 1)), cutoff=0.7)
    panel = panel_of(model, [record(arm, 1)])
    (block,), (rows,) = panel.blocks, panel.rows
    lacking = (model.load(Motion(*motion(1))) - model.load(block.motion))[rows]
    for j in range(2):
        columns = panel.cut_away[:, j]
        left = lacking[:, j] - columns @ np.linalg.lstsq(columns, lacking[:, j])[0]
        assert np.linalg.norm(left) < 0.3 * np.linalg.norm(lacking[:, j])


def test_what_is_cut_away_is_no_spring(arm, steep):
    model = replace(baseline_model(arm, steep), cutoff=8.0)
    assert [one for one in find_gap(model, steep).findings if one.effect == "elasticity"] == []


def test_a_spring_must_explain_enough_beside_what_is_cut_away(arm, steep):
    model = replace(baseline_model(arm, steep), cutoff=8.0)
    panel = panel_of(model, steep)
    found = search(panel, survey_of(model, panel), gap_of(model, panel, 0))
    springs = [one for one in found.trials if one.effect.name == "elasticity" and found.gains(one)]
    assert springs
    assert not any(found.gains_by(panel, force_of(panel, found.problem, one, 0)) for one in springs)
