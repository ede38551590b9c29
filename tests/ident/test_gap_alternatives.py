"""Names that logs leave open: laws that are one in slow logs, effects of a joint beside a cause of the whole robot."""

from types import SimpleNamespace

import numpy as np
import pytest
from planar_arm import NOISE, RATE, friction
from scipy.interpolate import CubicSpline

from ident.effects.friction import CoulombAsymmetry, Viscous
from ident.effects.timing import Delay
from ident.gap import baseline_model
from ident.gap.candidates import Trial
from ident.gap.problem import Errors
from ident.gap.rows import gap_of, panel_of, survey_of
from ident.gap.search import search
from ident.gap.settle import alternatives
from ident.gap.whole import _Judge
from ident.log import JointLog


def creep(arm, seed):
    """Both joints at 60 mrad/s and less, over which the second one's friction falls."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / RATE
    waves = (
        rng.uniform(0.02, 0.05, 2) * np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 6, 2))
        for f in (0.05, 0.11, 0.17)
    )
    spline = CubicSpline(t, sum(waves))
    q, dq, ddq = spline(t), spline(t, 1), spline(t, 2)
    torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(arm.multibody.parameters, (2, 1)))
    torque += friction(dq)
    torque[:, 1] += np.tanh(dq[:, 1] / 2e-3) * np.exp(-((dq[:, 1] / 0.1) ** 2))
    return JointLog(t=t, q=q, current=torque + 0.2 * NOISE * rng.standard_normal(q.shape), name=f"creep{seed}")


def test_a_law_that_fits_best_where_it_ends_is_open_if_a_usual_shape_of_it_does_as_well(arm):
    train = [creep(arm, seed) for seed in (1, 2, 3)]
    model = baseline_model(arm, train)
    panel = panel_of(model, train)
    found = search(panel, survey_of(model, panel), gap_of(model, panel, 1))
    name = found.winner(panel)
    open_names = alternatives(panel, found.gap, [name], name)
    assert all(trial.at_bound for trial in found.trials if trial.effect.name == "stribeck")
    assert not open_names["stribeck"].at_bound


def test_all_effects_of_the_joint_on_which_alone_a_cause_shows_may_be_its_alternatives():
    def trial(effect, left, *shape):
        return Trial(effect, np.array(shape), 0.0, errors=Errors(np.array([left])))

    # The last one ended where its law does; the first would be held against the cause even so.
    trials = tuple(trial(*one) for one in ((Viscous(0), 1.0), (CoulombAsymmetry(0), 1.1), (Delay(0), 1.2, 0.1)))
    search = SimpleNamespace(
        trials=trials,
        closest=trials[0],
        before=Errors(np.array([4.0])),
        problem=np.zeros(100),
        explained=lambda one: 4.0 - one.errors.total,
    )
    judge = _Judge(SimpleNamespace(robot=SimpleNamespace(n=2)), None, [search, search], False, None)
    own = judge._own(np.array([0]), np.array([70.0, 0.0]))
    assert [one.effect.name for one, _, _ in own] == ["viscous", "coulomb-asymmetry"]
    assert [gained for _, gained, _ in own] == pytest.approx([50.0 * np.log(4.0), 50.0 * np.log(4.0 / 1.1)])
    assert judge._own(np.array([0, 1]), np.array([70.0, 70.0])) == []
