"""Which hidden effects could be told from their rivals at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comparisons.hidden_effects.cases import Case, Hidden, make
from comparisons.hidden_effects.identifiability import ALL, SURE, _Nearest, _stretches, _Whitening, told
from comparisons.hidden_effects.scoring import MAIN
from ident.gap import baseline_model
from ident.gap.rows import panel_of


def asked_of(hidden, style="short", changed=False, robot="vs060"):
    case = Case(robot, (hidden,), 7, style=style, changed=changed)
    made = make(case)
    return told(baseline_model(made.robot, made.clean if changed else made.train), not changed, case, made, 0), made


def asked(*args, **how):
    return asked_of(*args, **how)[0].margin


def sprung():
    case = Case("vs060", (Hidden("cable-spring", 1, 1.0),), 7, style="short")
    made = make(case)
    return case, made, baseline_model(made.robot, made.train)


def test_stribeck_is_told_from_what_it_is_taken_for():
    assert asked(Hidden("stribeck", 1, 1.0)) > 10 * SURE


def test_filter_is_not_told_from_delay_in_one_sinusoid_and_is_in_other_logs():
    weak, lag = (Hidden("filter-lag", None, severity) for severity in (0.4, 1.0))
    assert asked(weak, style="one-speed") < SURE < asked(lag)
    assert asked(Hidden("filter-lag", None, 5.0)) > SURE


def test_noise_decides_what_logs_tell():
    case, made, model = sprung()
    quiet = replace(made, noise=0.5 * made.noise)
    assert told(model, True, case, quiet, 0).margin == pytest.approx(2.0 * told(model, True, case, made, 0).margin)


def test_a_law_is_ahead_by_what_noise_gives_to_the_difference():
    # Of log-likelihoods of two laws, over noise drawn anew, neither of which is what is hidden.
    rng = np.random.default_rng(5)
    hidden, own, rival = rng.standard_normal((3, 400)) * np.array([[0.3], [0.05], [0.2]])
    own, rival = hidden + own, hidden + rival
    near, far = (
        _Nearest(None, np.zeros(0), np.zeros(0), law, 0.5 * np.sum((hidden - law) ** 2)) for law in (own, rival)
    )
    seen = hidden + rng.standard_normal((4000, 400))
    drawn = 0.5 * (np.sum((seen - rival) ** 2, axis=1) - np.sum((seen - own) ** 2, axis=1))
    assert near.ahead_of(far) == pytest.approx(drawn.mean() / drawn.std(), abs=0.06)


def test_whitened_noise_is_white():
    case = Case("vs060", (), 7, style="short")
    made, quiet = make(case), make(replace(case, noise=0.0))
    model = baseline_model(made.robot, made.train)
    pairs = zip(made.train, quiet.train, strict=True)
    noise = [replace(log, current=(log.current - other.current) / made.noise) for log, other in pairs]
    panel = _stretches(panel_of(model, noise, ALL))
    white = _Whitening.of(panel).applied(panel.force / model.gain)
    assert np.std(white) == pytest.approx(1.0, abs=0.05)
    assert abs(np.mean(white[1:] * white[:-1])) < 0.03
    assert np.mean(panel.force[1:] * panel.force[:-1] / model.gain**2) > 0.2


def test_own_law_of_an_elasticity_is_that_of_all_rows():
    found, made = asked_of(Hidden("elasticity", 2, 0.5), style="500Hz", robot="ur10")
    assert found.margin > SURE
    assert found.nearest["stiffness"] == pytest.approx(made.parameters[0]["stiffness"], rel=0.05)


def test_change_is_held_against_model_from_before():
    assert asked(Hidden("payload", None, 1.0), changed=True) > 3 * SURE


def test_effects_without_rivals_and_outside_the_catalogue_have_no_margin():
    assert asked(Hidden("coulomb-asymmetry", 1, 1.0)) is None
    assert asked(Hidden("friction-step", 1, 1.0)) is None


@pytest.mark.parametrize("effect", ["rotor-inertia", "coulomb-asymmetry", "current-offset"])
def test_nearest_of_laws_that_are_the_catalogues_are_their_own_figures(effect):
    found, made = asked_of(Hidden(effect, 1, 1.0), changed=effect != "coulomb-asymmetry")
    key = MAIN[effect]
    assert found.nearest[key] == pytest.approx(made.parameters[0][key], rel=0.02)


def test_nearest_ripple_is_larger_where_the_one_that_hides_grows_with_load():
    found, made = asked_of(Hidden("gear-ripple", 1, 1.0))
    assert 1.02 < found.nearest["force"] / made.parameters[0]["force"] < 1.2


def test_noise_of_the_logs_and_other_effects_play_no_part():
    case, made, model = sprung()
    rng = np.random.default_rng(0)
    shaken = [rng.normal(0.0, 3.0 * made.noise, log.current.shape) for log in made.train]
    alone, plain = (
        [replace(log, current=log.current + more) for log, more in zip(logs, shaken, strict=False)]
        for logs in (made.alone[0], made.plain)
    )
    noisier = told(model, True, case, replace(made, alone=[alone], plain=plain, train=[]), 0).margin
    assert noisier == pytest.approx(told(model, True, case, made, 0).margin, rel=1e-6)


@pytest.mark.parametrize("style", ["short", "50Hz"])
def test_correlation_is_that_of_the_noise(style):
    noisy, quiet = (make(Case("vs060", (), 7, style=style, noise=noise)) for noise in (0.02, 0.0))
    pairs = zip(noisy.train, quiet.train, strict=True)
    noise = np.concatenate([(one.current - other.current) / noisy.noise for one, other in pairs])
    # Means of so many samples vary as those of fewer independent ones do.
    long = 4 * round(quiet.train[0].rate)
    means = noise[: len(noise) // long * long].reshape(-1, long, 6).mean(axis=1)
    assert long * np.mean(means**2) == pytest.approx(noisy.correlation, rel=0.2)
