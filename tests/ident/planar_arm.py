"""Logs of a two-link arm in a plane with dry and viscous friction, and with what a test hides in its second joint."""

import numpy as np
from scipy.interpolate import CubicSpline

from ident.gap import baseline_model, find_gap
from ident.log import JointLog

RATE, NOISE = 100.0, 0.08


def motion(seed, seconds=60.0):
    """Fast and slow stretches one after the other, all joints at once."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    fast = sum(
        rng.uniform(0.2, 0.5, 2) * np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 6, 2)) for f in (0.11, 0.23, 0.41)
    )
    slow = sum(
        rng.uniform(0.02, 0.05, 2) * np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 6, 2)) for f in (0.09, 0.31)
    )
    share = 0.5 + 0.5 * np.tanh(4 * np.sin(2 * np.pi * t / 30.0))[:, None]
    spline = CubicSpline(t, share * fast + (1 - share) * slow + rng.uniform(-0.3, 0.3, 2))
    return t, spline(t), spline(t, 1), spline(t, 2)


def friction(dq):
    """Dry and viscous friction of both joints."""
    return np.array([1.5, 0.8]) * np.tanh(dq / 2e-3) + np.array([1.0, 0.5]) * dq


def record(arm, seed, hidden=None, mass=0.0, inertia=0.0):
    t, q, dq, ddq = motion(seed)
    parameters = arm.multibody.parameters.copy()
    parameters[10:14] += mass * np.array([1.0, 0.4, 0.0, 0.0])
    parameters[16] += inertia  # about the joints' axes
    torque = arm.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(parameters, (2, 1)))
    torque += friction(dq)
    torque += NOISE * np.random.default_rng(seed + 50).standard_normal(q.shape)
    if hidden is not None:
        torque[:, 1] += hidden(t, q, dq)
    return JointLog(t=t, q=q, current=torque, name=f"log{seed}")


def delayed(log, seconds):
    """The log with its currents stamped so many seconds late."""
    return log.replace(current=np.stack([np.interp(log.t - seconds, log.t, x) for x in log.current.T], axis=1))


def logs(arm, first, **options):
    return [record(arm, seed, **options) for seed in range(first, first + 3)]


def structure(arm, **options):
    train = logs(arm, 1, **options)
    return find_gap(baseline_model(arm, train), train, [record(arm, 9, **options)])
