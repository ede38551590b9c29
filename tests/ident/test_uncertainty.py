"""Standard deviations under autocorrelated residuals: they cover the truth where those of independent noise do not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.design import Design
from ident.effects.base import initial_term
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.friction_curve import Stribeck
from ident.fit import Drives, settle, with_coefficients
from ident.least_squares import factorise, solve
from ident.log import JointLog
from ident.signals import Motion
from ident.uncertainty import autocovariance, bandwidth, correlation_time, covariance, independent_errors, parzen
from ident.walk import Block

ROWS, DRAWS = 3000, 200
TRUTH = {"offset": 1.0, "coulomb": 4.0, "viscous": 2.0}


def coloured(rng, shape, pole):
    return lfilter([np.sqrt(1 - pole**2)], [1, -pole], rng.normal(size=(shape[0] + 300, shape[1])), axis=0)[300:]


def one_joint(n=6):
    """Slow motion of every joint: the columns vary over seconds, as the noise does."""
    t = np.arange(ROWS) / 100
    rates = np.linspace(0.8, 2.3, n)
    q, dq = np.sin(rates * t[:, None]), rates * np.cos(rates * t[:, None])
    return Motion(t, q, dq, -(rates**2) * q)


def draw(robot, motion, noise, effects, blocks=1):
    """Fit rows with noise, and return the errors and standard deviations of all parameters."""
    current = TRUTH["offset"] + TRUTH["coulomb"] * np.tanh(motion.dq / 5e-3) + TRUTH["viscous"] * motion.dq + noise
    log = JointLog(motion.t, motion.q, current)
    cuts = np.array_split(np.arange(ROWS), blocks)
    held = [Block(log[c[0] : c[-1] + 1], motion[c[0] : c[-1] + 1], True, np.ones(len(c), dtype=bool)) for c in cuts]
    design = Design(robot, tuple(initial_term(e) for e in effects), np.ones(6))
    solution = solve(design, factorise(design, design.rows(held)))
    terms = with_coefficients(design, solution.parameters)
    spread = covariance(terms, design, solution, held)
    iid = np.sqrt(np.diag(solution.bread))
    return solution.parameters, np.sqrt(np.diag(spread)), iid


@pytest.mark.parametrize("blocks", [1, 3])
def test_intervals_cover_under_autocorrelation_where_those_of_independent_noise_fail(vs060, blocks):
    rng = np.random.default_rng(11)
    motion = one_joint()
    effects = [e for j in range(6) for e in (CurrentOffset(j), Coulomb(j), Viscous(j))]
    truth = np.tile(list(TRUTH.values()), 6)
    inside = np.zeros((2, len(truth)))
    draws = DRAWS // 6  # six joints are six regressions a draw
    for _ in range(draws + 1):
        estimate, std, iid = draw(vs060, motion, coloured(rng, motion.q.shape, 0.97), effects, blocks)
        for k, s in enumerate((std, iid)):
            inside[k] += np.abs(estimate - truth) < 1.96 * s
    share = inside.reshape(2, 6, 3).sum(axis=1) / (6 * (draws + 1))  # by kind of parameter
    # Of 46 independent samples' worth of noise an offset takes one along, which its interval does not see.
    assert np.all(share[0] > 0.84)
    assert 0.90 < share[0].mean() <= 0.98
    assert share[1].mean() < 0.70


def test_white_noise_gives_what_independent_formulas_give(vs060):
    motion = one_joint()
    effects = [e for j in range(6) for e in (CurrentOffset(j), Coulomb(j), Viscous(j))]
    noise = np.random.default_rng(3).normal(size=motion.q.shape)
    _, std, iid = draw(vs060, motion, noise, effects)
    np.testing.assert_allclose(std, iid, rtol=0.25)


def test_shape_parameters_have_honest_intervals_too(vs060):
    rng = np.random.default_rng(2)
    motion = one_joint()
    effects = [e for j in range(6) for e in (Coulomb(j), Stribeck(j))]
    inside, count = 0, 0
    for _ in range(8):
        current = 4.0 * np.tanh(motion.dq / 5e-3) * (1 + np.exp(-((motion.dq / 0.1) ** 2)))
        current += 0.5 * coloured(rng, motion.q.shape, 0.9)
        held = [Block(JointLog(motion.t, motion.q, current), motion, True, np.ones(ROWS, dtype=bool))]
        design = Design(vs060, tuple(initial_term(e) for e in effects), np.ones(6))
        design = settle(design, held, Drives(np.ones(6), "A"), 10.0, 100.0)
        solution = solve(design, factorise(design, design.rows(held)))
        spread = covariance(with_coefficients(design, solution.parameters), design, solution, held)
        assert spread.shape == (12 + 6, 12 + 6)
        speeds = np.array([t.shape[0] for t in design.terms if t.effect.shapes])
        std = np.sqrt(np.diag(spread))[12:]
        inside += int(np.sum(np.abs(speeds - 0.1) < 1.96 * std))
        count += 6
    assert inside >= 0.85 * count  # 95 % are expected
    assert np.all(std < 0.1)


def test_what_is_not_determined_has_no_variance(vs060):
    motion = one_joint()
    effects = [CurrentOffset(0), CurrentOffset(0), Viscous(0)]
    _, std, _ = draw(vs060, motion, np.random.default_rng(3).normal(size=motion.q.shape), effects)
    assert std[1] == 0.0
    assert np.all(std[[0, 2]] > 0.0)


@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9, 0.97])
def test_correlation_time_of_a_first_order_process(rng, pole):
    expected = (1 + pole) / (1 - pole)
    times = [correlation_time(coloured(rng, (20_000, 1), pole)[:, 0]) for _ in range(5)]
    assert np.mean(times) == pytest.approx(expected, rel=0.2)


def test_autocovariance_is_the_sum_of_products(rng):
    a, b = rng.normal(size=50), rng.normal(size=20)
    gamma = autocovariance([a, b], lags=10)
    for k in range(10):
        products = a[: 50 - k] @ a[k:] + b[: 20 - k] @ b[k:]
        assert gamma[k] == pytest.approx(products / (70 - 2 * k))
    assert len(autocovariance([a, b])) == 25


def test_windows_taper_to_nought():
    window = parzen(40, 20)
    assert window[0] == 1.0
    assert np.all(np.diff(window[:20]) < 0)
    assert np.all(window[20:] == 0)
    assert bandwidth(np.zeros(10)) == 1
    assert correlation_time(np.zeros(30)) == 1.0


def test_independent_errors_add_up_to_the_covariance():
    rng = np.random.default_rng(6)
    size = np.array([1e-4, 1.0, 1e3, 0.0])  # the last one is not determined
    root = size[:, None] * rng.standard_normal((4, 5))
    scatter = root @ root.T
    errors = independent_errors(scatter)
    assert errors.shape == (4, 3)
    scale = np.outer(size, size) + 1e-300
    np.testing.assert_allclose(errors @ errors.T / scale, scatter / scale, atol=1e-9)
    assert independent_errors(np.full((4, 4), np.nan)).shape == (4, 0)
