"""A current that comes late by too little to show on one joint: all joints together tell of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from comparisons.hidden_effects.cases import Case, Hidden, make
from ident.effects.attached import Payload
from ident.effects.timing import Delay
from ident.gap import baseline_model, borne_out
from ident.gap.borne_out import chance_in_all, late_on_all
from ident.gap.on_all import Whole
from ident.gap.problem import JointProblem, gain
from ident.gap.search import GAIN, LEVEL
from ident.gap.subject import Subject


def seen(*hidden: Hidden, style: str = "noisy", held: bool = False):
    made = make(Case("vs060", hidden, 12, style=style))
    subject = Subject(baseline_model(made.robot, made.train), made.train, True)
    subject.look()
    gaps = subject.sure_gaps()
    found = late_on_all(subject.panel, replace(subject.survey, held=held), gaps, ())
    return found, [gap.problem(subject.panel) for gap in gaps]


def test_a_filter_that_explains_little_of_most_joints_is_told_by_all():
    found, problems = seen(Hidden("filter-lag", None, 0.7))
    before = np.array([p.errors().total for p in problems])
    gains = [gain(b, a) for b, a in zip(before, found.held_out.sum(axis=1), strict=True)]
    assert found.effect.name in ("filter-lag", "delay")
    assert found.p_value <= LEVEL
    assert np.median(gains) < GAIN


def test_joints_are_not_asked_of_a_model_held_fixed_whose_own_logs_may_have_been_as_late():
    found, _ = seen(Hidden("filter-lag", None, 0.7), held=True)
    assert found is None


@pytest.mark.parametrize("hidden", [(), (Hidden("stribeck", 1, 2.0),), (Hidden("load-friction", 2, 2.0),)])
def test_joints_do_not_bear_out_what_is_not_there(hidden):
    found, _ = seen(*hidden)
    assert found is None


@pytest.mark.parametrize(
    ("shares", "errors", "there"),
    [
        ([1.1, 0.8, 1.3, 0.9], 0.1, True),
        ([1.1, 0.8, 1.3, 0.1], 0.1, False),  # one denies it
        ([1.1, 0.8, 1.3, 0.1], (0.1, 0.1, 0.1, 1.0), True),  # one cannot say
        ([1.1, 0.8, 0.1, 0.1], (0.1, 0.1, 1.0, 1.0), False),  # two tell
        ([1.1, 0.8, 1.3, 1.6], 0.1, False),  # one asks for too much
    ],
)
def test_joints_that_tell_ask_for_as_much_as_there_is(monkeypatch, shares, errors, there):
    told = list(zip(shares, np.broadcast_to(errors, 4), strict=True))
    monkeypatch.setattr(borne_out, "_share", lambda panel, problem, whole, joint: told[joint])
    monkeypatch.setattr(borne_out, "at_any_pace", lambda *_: True)
    late, lead = (
        Whole(Delay(None, sample=0.02), np.array([0.01]), np.array([s]), np.zeros((4, 4)), 1.0, 1.0)
        for s in (0.01, -0.01)
    )
    fitted, held = SimpleNamespace(held=False), SimpleNamespace(held=True)
    assert (chance_in_all(None, fitted, [None] * 4, late) <= LEVEL) is there
    assert chance_in_all(None, held, [None] * 4, late) == 1.0
    assert chance_in_all(None, fitted, [None] * 4, lead) == 1.0
    payload = Whole(Payload(None), np.zeros(0), np.ones(4), np.zeros((4, 4)), 1.0, 1.0)
    assert chance_in_all(None, fitted, [None] * 4, payload) == 1.0


def test_rows_that_an_encoder_does_not_show_tell_nothing_of_a_delay(monkeypatch):
    rng = np.random.default_rng(1)
    column, turned = rng.standard_normal(600), np.arange(600) % 5 == 0
    target = np.where(turned, 4.0, 1.0) * column + 0.1 * rng.standard_normal(600)
    problem = JointProblem(np.ones((600, 1)), target, np.arange(600) // 200, np.arange(600) > 2)
    monkeypatch.setattr(borne_out, "columns_of", lambda panel, whole, joint: column)

    def share(unseen):
        return borne_out._share(SimpleNamespace(unseen=unseen[:, None]), problem, None, 0)

    assert share(np.zeros(600, dtype=bool))[0] > 1.3
    assert share(turned) == (pytest.approx(1.0, abs=0.02), pytest.approx(0.0045, rel=0.3))
    assert share(np.ones(600, dtype=bool)) == (0.0, np.inf)
