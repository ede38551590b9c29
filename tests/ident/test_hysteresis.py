"""Effects that remember: Maxwell elements, and play between motor and link that is held or flown through."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from ident.effects.base import Context, initial_term
from ident.effects.direction import SMOOTHING
from ident.effects.hysteresis import FINE_SPREAD, Backlash, MaxwellSlip
from ident.signals import Motion

DRY = 5.0
"""Dry friction [N m] of the joint, of which some may brake its link."""


def test_maxwell_elements_stick_slip_and_remember(vs060):
    q = np.zeros((5, 6))
    q[:, 2] = [0.0, 5e-4, 2e-3, 1.5e-3, 1.5e-3]
    still = np.zeros_like(q)
    context = Context(vs060, Motion(np.arange(5.0), q, still, still))
    effect = MaxwellSlip(2, spread=(1.0,))
    force = effect.columns(context, np.array([1e-3]), effect.start())[:, 0]
    np.testing.assert_allclose(force, [0.0, 0.5, 1.0, 0.5, 0.5])


def test_maxwell_elements_pass_over_an_unknown_position(vs060):
    q = np.full((4, 6), np.nan)
    q[1:, 0] = [0.0, 5e-4, 2e-3]
    still = np.zeros_like(q)
    context = Context(vs060, Motion(np.arange(4.0), q, still, still))
    effect = MaxwellSlip(0, spread=(1.0,))
    force = effect.columns(context, np.array([1e-3]), effect.start())[:, 0]
    np.testing.assert_allclose(force, [np.nan, 0.0, 0.5, 1.0])


@pytest.mark.parametrize("falls", [True, False])
def test_noise_of_the_position_does_not_open_the_gap(vs060, falls):
    t = np.arange(2000) * 0.005
    q, dq = np.zeros((2, len(t), 6))
    q[:, 1], dq[:, 1] = np.sin(t), np.cos(t)
    effect, noise = Backlash(1, falls), np.random.default_rng(0).normal(0.0, 1e-5, q.shape)
    load = np.ones_like(q)
    missing = [
        effect.columns(Context(vs060, Motion(t, moved, dq, np.zeros_like(q)), load), np.array([2e-3]), effect.start())
        for moved in (q, q + noise)
    ]
    assert 0.001 < -missing[0].mean() < 0.1
    np.testing.assert_allclose(missing[1].mean(), missing[0].mean(), rtol=0.5)


def test_a_link_that_stays_is_not_pressed_against_a_flank_at_rest(vs060):
    q = np.zeros((6, 6))
    q[:, 2] = [0.0, 2e-3, 1e-3, 1e-3, 1e-3, 2e-3]
    dq = np.zeros_like(q)
    dq[[0, 1, 2, 5], 2] = 0.1
    context = Context(vs060, Motion(np.arange(6.0), q, dq, np.zeros_like(q)), np.ones_like(q))
    stays, falls = (Backlash(2, f) for f in (False, True))
    missing = [-e.columns(context, np.array([2e-3]), e.start())[:, 0] for e in (stays, falls)]
    np.testing.assert_allclose(missing[0], [1.0, 0.0, 1.0, 1.0, 1.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(missing[1], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("braked", [0.0, 0.3])
def test_a_link_that_flies_is_two_masses_with_a_dead_zone_between(vs060, braked):
    t, joint, gap, hertz, damping = np.arange(400) * 0.002, 2, 4e-3, 20.0, 0.25
    speed = 2.0 * np.pi * np.linspace(0.9, 1.7, 6)
    phase = speed * t[:, None] + np.arange(6)
    motion = Motion(t, np.sin(phase), speed * np.cos(phase), -(speed**2) * np.sin(phase))
    links = np.tile(vs060.multibody.parameters, (6, 1))
    load = vs060.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, links)
    inertia = vs060.rigid_body.mass_matrix(motion.q, vs060.multibody.parameters)
    # The link's own equation of motion, behind a motor that is known; friction brakes it at its own speed.
    own, needs = (CubicSpline(t, y) for y in (inertia[:, joint, joint], load[:, joint] / inertia[:, joint, joint]))
    motor, turn = CubicSpline(t, motion.dq[:, joint]), 2.0 * np.pi * hertz

    def rub(time: float | np.ndarray, slower: float = 0.0) -> np.ndarray:
        return braked * DRY * np.tanh((motor(time) - slower) / SMOOTHING)

    def lacks(time: float, slower: float) -> float:
        return float(needs(time) + rub(time, slower) / own(time))

    def carried(behind: float, slower: float) -> float:
        wound = behind - np.clip(behind, -0.5 * gap, 0.5 * gap)
        push = turn**2 * wound + 2.0 * damping * turn * slower
        return push if push * wound > 0.0 else 0.0

    first = lacks(0.0, 0.0)
    start = [(0.5 * gap + abs(first) / turn**2) * np.sign(first), 0.0, 0.0]
    found = solve_ivp(
        lambda time, x: [x[1], lacks(time, x[1]) - carried(x[0], x[1]), float(rub(time, x[1]))],
        (0.0, t[-1]),
        start,
        t_eval=t,
        max_step=2e-4,
        rtol=1e-8,
    )
    effect = Backlash(joint, flies=True, everywhere=True, dry=DRY)
    shape = np.array([gap, hertz, damping, braked])
    columns = effect.columns(Context(vs060, motion, load, links), shape, effect.start())
    assert effect.acts_on is None
    # Between samples, as the columns are.
    _, slower, rubbed = np.diff(found.y) / 0.002
    true = -inertia[1:, :, joint] * slower[:, None]
    true[:, joint] += rubbed - rub(t[1:])
    for j in (1, 2, 4):
        assert np.std(columns[1:, j, 0] - true[:, j]) < 0.08 * np.std(true[:, j])
    # While it flies the motor carries none of it, which happens as often as its load changes sides.
    free = np.abs(columns[:, joint, 0] + load[:, joint] + rub(t)) < 0.02 * np.abs(load[:, joint]).max()
    assert 5 < free.sum() < 200


def test_a_link_that_flies_does_not_carry_the_motors_inertia(vs060):
    t, joint, shape = np.arange(500) * 0.004, 2, [4e-3, 20.0, 0.25]
    q, dq, ddq = np.full((3, len(t), 6), 0.4)
    dq[:], ddq[:] = 0.0, 0.0
    q[:, joint], dq[:, joint], ddq[:, joint] = np.sin(5.0 * t), 5.0 * np.cos(5.0 * t), -25.0 * np.sin(5.0 * t)
    motion, links = Motion(t, q, dq, ddq), np.tile(vs060.multibody.parameters, (6, 1))
    motor = 0.6 * float(vs060.rigid_body.mass_matrix(q, links)[:, joint, joint].mean())
    # Fitted from its own row alone, the joint's link has the motor's inertia, too.
    fitted = links.copy()
    fitted[joint, 10 * joint + 4 : 10 * joint + 7] += motor
    columns = []
    for effect, parameters, known in (
        (Backlash(joint, flies=True, everywhere=True), links, shape),
        (Backlash(joint, flies=True, everywhere=True, motor=motor), fitted, [*shape, motor]),
        (Backlash(joint, flies=True, everywhere=True), fitted, shape),
    ):
        load = vs060.rigid_body.inverse_dynamics(q, dq, ddq, parameters)
        columns.append(effect.columns(Context(vs060, motion, load, parameters), np.array(known), effect.start()))
    np.testing.assert_allclose(columns[1], columns[0], atol=1e-6 * np.abs(columns[0]).max())
    assert np.std(columns[2] - columns[0]) > 0.3 * np.std(columns[0])


def test_links_of_no_inertia_leave_nothing_that_flies(vs060):
    rng = np.random.default_rng(0)
    motion = Motion(np.arange(50) * 0.01, *rng.standard_normal((3, 50, 6)))
    context = Context(vs060, motion, rng.standard_normal((50, 6)), np.zeros((6, 60)))
    effect = Backlash(2, flies=True, everywhere=True)
    assert not effect.columns(context, initial_term(effect).shape, effect.start()).any()


def test_elements_that_are_dry_friction_are_no_part_of_the_force_that_remembers(vs060):
    def told(slip, *forces):
        return MaxwellSlip(1, FINE_SPREAD).summary(vs060, np.array([slip]), np.array(forces))

    assert told(1e-3, 2.5, 0.0, 0.0, 1.0, 2.0) == {"force": 3.0, "slip": pytest.approx(23e-3 / 3.0), "dry": 2.5}
    # Without a gap, beyond what gears yield by, or alone they are what is looked for.
    assert told(1e-3, 2.5, 0.5, 0.0, 1.0, 2.0)["force"] == 3.0
    assert told(1e-3, 0.0, 0.5, 1.0, 1.0, 2.0) == {"force": 4.5, "slip": pytest.approx(24.15e-3 / 4.5)}
    assert told(2e-2, 2.5, 0.0, 0.0, 1.0, 2.0)["force"] == 5.5
    assert told(1e-3, 2.5, 0.0, 0.0, 0.0, 0.0)["force"] == 2.5
