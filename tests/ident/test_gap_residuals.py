"""What the gap workflow tells of residuals alone: significance, lines, memory, wandering, agreement at rest."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.gap.agreement import IN_TIME, Predicted, agrees, agrees_at_any_pace
from ident.gap.bursts import bursts
from ident.gap.counts import counted_acceleration
from ident.gap.gate import Gate, surrogates
from ident.gap.memory import remembered
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.spectrum import spectral_line
from ident.gap.wander import wandering
from ident.log import JointLog
from ident.signals import derive, zero_phase


def test_what_fits_the_rests_alone_does_not_agree():
    rng = np.random.default_rng(0)
    moving = np.arange(4000) % 400 >= 320
    force = np.repeat(rng.standard_normal(40), 100)
    noise = 0.2 * rng.standard_normal(4000)
    problem = JointProblem(np.zeros((4000, 0)), force * ~moving + noise, np.arange(4000) // 1000, np.ones(4000, bool))
    assert not agrees(problem, force[:, None], (moving, ~moving))
    assert agrees(problem, (force * ~moving)[:, None], (moving, ~moving))


def test_what_is_late_at_rest_alone_is_no_delay():
    rng = np.random.default_rng(5)
    pace = np.repeat([0, 1, 2, 3], 1000)
    force, noise = rng.standard_normal((2, 4000))

    def there(*shares, size=1.0):
        return Predicted(size * force, size * np.array(shares)[pace] * force + noise, pace)

    def late(joints):
        return agrees_at_any_pace(joints, 0.7)

    assert late([there(1.0, 1.0, 1.0, 1.0)])
    assert late([there(1.5, 1.2, 0.9, 1.1)])
    assert not late([there(2.0, 1.0, 0.1, 0.1)])
    assert not late([there(1.2, 1.2, 1.0, 0.3)])
    # Where the rows do not tell, or a second joint shows it, it stands.
    assert late([there(2.0, 1.0, 0.1, 0.1, size=0.02)])
    assert late([there(1.0, 1.0, 0.3, 0.3, size=0.3), there(1.0, 1.0, 1.0, 1.0, size=2.0)])
    # Of all joints together less is asked.
    assert agrees_at_any_pace([there(1.2, 1.2, 1.0, 0.5)], IN_TIME)
    assert not agrees_at_any_pace([there(2.0, 1.0, 0.1, 0.1)], IN_TIME)


def test_the_gate_seldom_calls_the_best_of_many_columns_significant_in_coloured_noise():
    rng = np.random.default_rng(3)
    rows, low = 1500, 0
    t = np.arange(rows)
    candidates = [np.sin(2 * np.pi * f * t / rows)[:, None] for f in np.linspace(1, 60, 25)]
    for _ in range(60):
        noise = np.convolve(rng.standard_normal(rows + 40), np.exp(-np.arange(40) / 12.0), "valid")[:rows]
        problem = JointProblem(np.ones((rows, 1)), noise, t * 4 // rows, np.ones(rows, dtype=bool))
        gate = Gate(problem, np.array([0]), np.ones(rows))
        best = max(candidates, key=lambda columns: gate.look([columns])[1][0])
        low += gate.p_value(gate.statistic(best)) < 0.05
    assert low <= 6


def test_surrogates_keep_the_spectrum():
    signal = np.random.default_rng(0).standard_normal(256).cumsum()
    drawn = surrogates(signal, np.array([0]), 3, np.random.default_rng(1))
    for one in drawn.T:
        np.testing.assert_allclose(np.abs(np.fft.rfft(one)), np.abs(np.fft.rfft(signal)), rtol=1e-2, atol=1e-2)


def test_a_line_in_the_spectrum_is_found_and_noise_has_none():
    rng = np.random.default_rng(4)
    t = np.arange(6000) / 100.0
    noise = rng.standard_normal(6000)
    assert spectral_line(noise, np.array([0]), 0.01) is None
    assert spectral_line(np.zeros_like(noise), np.array([0]), 0.01) is None
    hertz, share = spectral_line(noise + np.sin(2 * np.pi * 7.0 * t), np.array([0]), 0.01)
    assert hertz == pytest.approx(7.0, abs=0.2)
    assert share > 0.2


def test_what_a_residual_remembers_is_told_from_noise_of_short_memory():
    rng = np.random.default_rng(4)
    noise, starts = rng.standard_normal(18_000), np.array([0, 6000, 12_000])
    smoothed = lfilter([0.2], [1.0, -0.8], noise)
    lasting = lfilter([np.sqrt(1 - 0.99**2)], [1.0, -0.99], rng.standard_normal(len(noise)))
    assert remembered(noise, starts, 0.01) < 0.01
    assert remembered(smoothed, starts, 0.01) < 0.01
    # A first-order process, guessed from both sides 0.25 s away: 2 rho^2 / (1 + rho^2) of it, halved by the noise.
    assert 0.25 < remembered(noise + lasting, starts, 0.01) < 0.5
    # Stretches shorter than what is held out are told apart, too; rows too far apart, or resting, tell nothing.
    assert 0.25 < remembered(noise + lasting, np.arange(0, 18_000, 350), 0.01) < 0.5
    assert remembered(smoothed[::15], starts // 15, 0.15) < 0.02
    assert remembered(noise + lasting, starts, 1.0) == 0.0
    assert remembered(np.zeros(18_000), starts, 0.01) == 0.0


def test_what_a_slow_filter_smears_is_not_remembered():
    velocity = zero_phase(np.random.default_rng(5).standard_normal((30_000, 1)), 50.0, 0.5)
    friction = np.tanh(velocity / (0.03 * velocity.std()))
    smeared = (friction - zero_phase(friction, 50.0, 4.4))[:, 0]
    assert remembered(smeared, np.array([0]), 0.02) > 0.01
    assert remembered(smeared, np.array([0]), 0.02, 4.4) < 0.004


def test_a_wandering_offset_is_told_from_noise():
    rng = np.random.default_rng(6)
    noise = rng.standard_normal(6000)
    starts = np.array([0, 3000])
    assert wandering(noise, starts, 0.01) < 0.02
    walk = np.cumsum(rng.standard_normal(6000)) / 40.0
    assert wandering(noise + walk, starts, 0.01) > 0.1
    assert wandering(noise[:500], np.array([0]), 0.01) == 0.0


def test_rare_bursts_are_told_from_noise_and_from_motion():
    rng, starts = np.random.default_rng(0), np.array([0, 4000])
    noise = lfilter([1.0], [1.0, -0.7], rng.standard_normal(8000))
    knocks = np.zeros(8000)
    for first in rng.choice(7900, 30, replace=False):
        knocks[first : first + 10] += 30.0 * np.cos(2.0 * np.arange(10)) * np.exp(-0.3 * np.arange(10))
    share = float(np.sum(knocks**2) / np.sum((noise + knocks) ** 2))
    assert bursts(noise**2, starts, 0.01) == 0.0
    assert bursts((noise + knocks) ** 2, starts, 0.01) == pytest.approx(share, abs=0.1)
    moving = np.repeat([1.0, 5.0, 1.0, 5.0], 2000)
    assert bursts((moving * noise) ** 2, starts, 0.01) == 0.0


def test_what_only_the_rows_held_out_tell_of_the_baseline_hides_no_effect():
    rng = np.random.default_rng(7)
    fold = np.arange(4000) // 1000
    effect, noise = rng.standard_normal((2, 4000))
    pose = np.where(fold == 3, rng.standard_normal(4000), 1e-5 * rng.standard_normal(4000))
    problem = JointProblem(pose[:, None], 5.0 * pose + 0.5 * effect + noise, fold, np.ones(4000, dtype=bool))
    before, after = problem.errors(), problem.errors(effect[:, None])
    # Half of the noise's size besides: a quarter of its square.
    np.testing.assert_allclose(before.held_out / 1000, 1.25, rtol=0.1)
    np.testing.assert_allclose(after.held_out / 1000, 1.0, rtol=0.1)
    left = problem.held_out(effect[:, None])
    np.testing.assert_allclose([left[rows] @ left[rows] for rows in problem.folds], after.held_out)
    further = problem.further(effect[:, None])
    np.testing.assert_allclose([further.held_out(k, np.array([0.5])) for k in range(4)], after.held_out, rtol=0.01)


def test_a_fold_none_of_whose_rows_counts_is_one_still():
    rng = np.random.default_rng(8)
    fold = np.arange(4000) // 1000
    column, noise = rng.standard_normal((2, 4000))
    problem = JointProblem(np.ones((4000, 1)), column + noise, fold, fold != 2)
    for errors in (problem.errors(), problem.errors(problem.of(column[:, None]))):
        assert errors.held_out.shape == (4,)
        assert errors.held_out[2] == 0.0
        assert np.all(errors.held_out[[0, 1, 3]] > 500.0)


@pytest.mark.parametrize("share", [0.02, 0.98])
def test_counts_feign_an_acceleration_of_that_size_at_constant_speed(share):
    rate, cutoff, count = 250.0, 15.0, 5e-5
    t = np.arange(2000) / rate
    counts = np.where(t < 1.0, 0.3 * rate * t, (11.0 + share) * rate * (t - 1.0) + 75.0)
    q = np.floor(counts)[:, None] * count
    log = JointLog(t=t, q=q, current=np.zeros_like(q))
    feigned = np.abs(derive(log, cutoff).ddq[600:-400]).max()
    model, survey = SimpleNamespace(robot=SimpleNamespace(coupling=None)), SimpleNamespace(cutoff=cutoff)
    panel = Panel(model, [SimpleNamespace(log=log)], [], [], np.zeros(0, dtype=int))
    assert feigned < counted_acceleration(panel, survey, 0) < 10.0 * feigned


def test_what_is_rounding_where_rows_count_is_no_force_elsewhere():
    rng = np.random.default_rng(0)
    rows = np.arange(400)
    other = np.where(rows < 200, 1e-14 * rng.standard_normal(400), np.sin(0.1 * rows))
    target = np.cos(0.05 * rows) + 0.1 * rng.standard_normal(400)
    matrix = np.column_stack([np.cos(0.05 * rows), other])
    found = JointProblem(matrix, target, rows // 100, rows < 200).fit()
    assert found == pytest.approx([1.0, 0.0], abs=0.05)
