"""A wrong torque constant is told by how well all joints agree with it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ident.gap import torque_constant


def wrong_gain(monkeypatch, rms, excess=0.1):
    """The wrong gain among three joints' whose RMS is as given, by the last term that a model has: effect and joint."""

    def left(tried, panel):
        last = tried.terms[-1].effect if tried.terms else None
        key = None if last is None else (last.name, last.joint)
        return np.ones((9, 3)) * rms.get(key, rms[None])

    monkeypatch.setattr(torque_constant, "left_by", left)
    bare = SimpleNamespace(problem=lambda panel: SimpleNamespace(residual=np.ones(9)))
    gaps = [SimpleNamespace(bare=lambda: bare, keep=np.arange(9), joint=j) for j in range(3)]
    turning = SimpleNamespace(multibody=SimpleNamespace(prismatic=np.zeros(3, dtype=bool)))
    model = SimpleNamespace(force_unit="N m", n=3, terms=(), robot=turning)
    panel = SimpleNamespace(seen_by=lambda tried: None)
    survey = SimpleNamespace(largest=np.ones(3))

    def fitted(model, terms):
        found = (replace(term, coefficients=np.array([excess])) for term in terms)
        return SimpleNamespace(terms=(*model.terms, *found))

    subject = SimpleNamespace(model=model, panel=panel, survey=survey, gaps=gaps, fitted=fitted)
    gain = torque_constant.wrong_gain(subject)
    return None if gain is None else gain.effect.joint


@pytest.mark.parametrize("what", ["torque-saturation", "cable-spring", "gravity-balancer"])
@pytest.mark.parametrize(("rest", "found"), [(1.0, None), (1.55, 1)])
def test_a_joint_whose_iron_saturates_or_that_has_a_spring_makes_no_other_gain_wrong(monkeypatch, what, rest, found):
    # RMS that is left on three joints, the third with that: shared links pass it on to the second.
    rms = {None: (1.0, 1.2, 1.9), ("drive-gain", 1): (1.0, 1.0, 1.5), (what, 2): (1.0, 1.05, rest)}
    assert wrong_gain(monkeypatch, rms) == found


@pytest.mark.parametrize(("second", "found"), [((1.02, 1.03, 1.03), 2), ((1.02, 1.0, 1.005), None)])
def test_the_wrong_gain_is_the_one_with_which_all_joints_agree(monkeypatch, second, found):
    # The links that the third joint's wrong gain bends are those that the second carries: it contradicts more.
    rms = {None: (1.02, 1.2, 1.03), ("drive-gain", 1): second, ("drive-gain", 2): (1.02, 1.0, 1.0)}
    assert wrong_gain(monkeypatch, rms) == found


@pytest.mark.parametrize(("excess", "found"), [(-0.04, 2), (0.02, None)])
def test_a_gain_is_not_called_wrong_by_less_than_models_are(monkeypatch, excess, found):
    rms = {None: (1.0, 1.0, 1.3), ("drive-gain", 2): (1.0, 1.0, 1.0)}
    assert wrong_gain(monkeypatch, rms, excess) == found
