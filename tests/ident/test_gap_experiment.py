"""The next experiment: a motion on which names that explain the logs alike differ."""

from dataclasses import replace

import numpy as np
from planar_arm import NOISE, RATE, logs, motion

from ident.effects import load_catalogue
from ident.effects.attached import GravityBalancer
from ident.effects.base import Effect
from ident.gap import baseline_model
from ident.gap.candidates import Trial
from ident.gap.experiment import Joined, Question, separating, with_motion
from ident.gap.joint_gap import JointGap
from ident.gap.rows import panel_of
from ident.gap.settle import next_experiment
from ident.log import JointLog


def test_every_effect_has_an_experiment_that_settles_it():
    catalogue = load_catalogue()
    for name, kind in catalogue.items():
        for rival in kind.rivals:
            said = next_experiment(name, {rival: None})
            assert Effect.excitation not in said, f"nothing of their own tells {name} from {rival}"
    assert next_experiment("stribeck", {}) is None


def test_the_next_experiment_is_the_motion_on_which_two_names_differ(arm):
    train = logs(arm, 1, hidden=lambda t, q, dq: 0.3 * np.tanh(dq[:, 1] / 0.06))
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    effects = {name: load_catalogue()[name](1) for name in ("sigmoid", "viscous-nonlinear")}
    sigmoid = Trial(effects["sigmoid"], np.array([0.03, 0.0]), 0.0)
    power = Trial(effects["viscous-nonlinear"], np.array([0.5]), 0.0)

    def moved(speed):
        """Steady travel to and fro at about one speed."""
        t = np.arange(4000) / RATE
        q = speed / (2 * np.pi * 0.2) * np.sin(2 * np.pi * 0.2 * t)[:, None] * np.ones(2)
        return JointLog(t=t, q=q, current=np.zeros_like(q))

    def joined(motion):
        both, added = with_motion(model, panel, motion)
        v = both.velocity[:, 1]
        matrix = np.stack([np.tanh(v / 2e-3), v, np.ones(len(v))], axis=1)
        return Joined(both, JointGap(1, matrix, both.force[:, 1], np.ones(len(v), dtype=bool), ()), added)

    motions = {name: joined(moved(speed)) for name, speed in (("fast", 4.0), ("slow", 0.08))}
    found = separating(Question(sigmoid, power, (), NOISE), motions)
    alone = separating(Question(sigmoid, power, (), NOISE), {"slow": motions["slow"]})
    assert found.motion == "fast"  # a power of speed grows on, a sigmoid does not
    assert found.ratio > 1.2 * alone.ratio
    rows = np.arange(len(motions["fast"].panel)) >= len(motions["fast"].panel) - motions["fast"].added
    unseen = replace(motions["fast"], gap=motions["fast"].gap.without(rows))
    assert separating(Question(sigmoid, power, (), NOISE), {"fast": unseen}).ratio == 0.0
    same = separating(Question(sigmoid, sigmoid, (), NOISE), motions)
    assert same.ratio < 1e-3
    assert not same.settles


def test_the_other_name_is_tried_at_any_shape_on_a_motion(arm):
    train = logs(arm, 1, hidden=lambda t, q, dq: 2.0 * np.sin(q[:, 1] - 0.5))
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    both, added = with_motion(model, panel, train[0])
    matrix = np.stack([np.tanh(both.velocity[:, 1] / 2e-3), np.ones(len(both))], axis=1)
    joined = Joined(both, JointGap(1, matrix, both.force[:, 1], np.ones(len(both), dtype=bool), ()), added)
    balancer = GravityBalancer(1)
    here, far = (Trial(balancer, np.array([0.5, neutral]), 0.0) for neutral in (0.5, -3.25))
    assert separating(Question(here, far, (), NOISE), {"again": joined}).ratio < 0.1


def test_a_motion_may_be_sampled_slower_than_the_logs(arm):
    train = logs(arm, 1)
    model = replace(baseline_model(arm, train), cutoff=20.0)
    t, q, _, _ = motion(4)
    slow = JointLog(t=t[::4], q=q[::4], current=np.zeros_like(q[::4]))
    panel, added = with_motion(model, panel_of(model, train), slow)
    assert 0 < added <= len(slow)
    assert np.isfinite(panel.velocity).all()
