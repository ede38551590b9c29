"""Which hidden effects could be told from their rivals at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comparisons.hidden_effects.cases import Case, Hidden, make
from comparisons.hidden_effects.identifiability import SURE, margin
from ident.gap import baseline_model


def asked(hidden, style="short", changed=False, **more):
    made = make(Case("vs060", (hidden,), 7, style=style, changed=changed, **more))
    return margin(baseline_model(made.robot, made.clean if changed else made.train), not changed, made, hidden)


def test_stribeck_is_told_from_what_it_is_taken_for():
    assert asked(Hidden("stribeck", 1, 1.0)) > 10 * SURE


def test_quick_filter_is_not_told_from_delay_and_slow_one_is():
    assert asked(Hidden("filter-lag", None, 1.0)) < SURE < asked(Hidden("filter-lag", None, 5.0))


def test_noise_decides_what_logs_tell():
    hidden = Hidden("cable-spring", 1, 1.0)
    made = make(Case("vs060", (hidden,), 7, style="short"))
    model = baseline_model(made.robot, made.train)
    quiet = replace(made, noise=0.5 * made.noise)
    assert margin(model, True, quiet, hidden) == pytest.approx(4.0 * margin(model, True, made, hidden))


def test_change_is_held_against_model_from_before():
    assert asked(Hidden("payload", None, 1.0), changed=True) > 10 * SURE


def test_effects_without_rivals_and_outside_the_catalogue_have_no_margin():
    assert asked(Hidden("coulomb-asymmetry", 1, 1.0)) is None
    assert asked(Hidden("friction-step", 1, 1.0)) is None


def test_noise_of_the_logs_plays_no_part():
    hidden = Hidden("load-friction", 1, 1.0)
    made = make(Case("vs060", (hidden,), 7, style="short"))
    rng = np.random.default_rng(0)
    shaken = [rng.normal(0.0, 3.0 * made.noise, log.current.shape) for log in made.train]
    train, plain = (
        [replace(log, current=log.current + more) for log, more in zip(logs, shaken, strict=False)]
        for logs in (made.train, made.plain)
    )
    model = baseline_model(made.robot, made.train)
    noisier = margin(model, True, replace(made, train=train, plain=plain), hidden)
    assert noisier == pytest.approx(margin(model, True, made, hidden), rel=1e-6)
