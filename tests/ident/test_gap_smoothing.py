"""How sharply the baseline's sign of velocity turns, beside friction that the baseline has not."""

import numpy as np
import planar_arm
import pytest
from planar_arm import logs

from ident.effects.friction import Coulomb
from ident.gap import baseline_model


def turning(arm, hidden):
    model = baseline_model(arm, logs(arm, 1, hidden=lambda t, q, dq: hidden(dq[:, 1])))
    return next(t.effect.smoothing for t in model.terms if isinstance(t.effect, Coulomb) and t.effect.joint == 1)


def test_friction_that_grows_with_the_speed_does_not_slow_the_sign(arm):
    assert turning(arm, lambda v: 2.0 * v / np.hypot(v, 0.08)) < 4e-3


def test_the_sign_of_a_joint_that_creeps_turns_as_sharply_as_its_friction(arm, monkeypatch):
    moved = planar_arm.motion

    def creeps(seed):
        t, *motion = moved(seed)
        return t, *(part * [1.0, 2e-3] for part in motion)

    monkeypatch.setattr(planar_arm, "motion", creeps)
    # By millimetres a second, as the quills of some SCARAs.
    assert turning(arm, lambda v: 0.8 * (np.tanh(v / 1e-5) - np.tanh(v / 2e-3))) < 5e-5


def test_a_sign_that_turns_slowly_is_told_from_a_sharp_one_beside_such_friction(arm):
    assert turning(arm, lambda v: 0.8 * (np.tanh(v / 0.02) - np.tanh(v / 2e-3))) == pytest.approx(0.02, rel=0.4)
