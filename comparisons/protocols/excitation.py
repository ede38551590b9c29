"""Motion that excites all joints at once: sinusoids and finite Fourier series, from rest to rest within the limits."""

from __future__ import annotations

import numpy as np

from comparisons.virtual_robot.figures import reach
from comparisons.virtual_robot.motion import Protocol, in_blocks
from ident.arrays import FloatArray
from ident.robot import Robot

SPEED = 2.5  # [rad/s] where a robot names no limit
ACCELERATION = 10.0  # [rad/s^2]
REST = 1.0  # [s] standing still before and after
RAMP = 2.0  # [s] over which a motion swells and ebbs


def limits(robot: Robot, share: float = 0.8) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return middle and half-range of the positions, speed and acceleration to stay within, (n,) each.

    ``share`` of every limit is used; where the robot names none, half a turn, 2.5 rad/s and 10 rad/s^2 are taken.

    Args:
        robot: whose limits they are.
        share: of every limit, 0 to 1.
    """
    lower, upper = reach(robot)
    velocity = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, SPEED)
    acceleration = np.where(np.isfinite(robot.limits.acceleration), robot.limits.acceleration, ACCELERATION)
    return 0.5 * (lower + upper), 0.5 * share * (upper - lower), share * velocity, share * acceleration


def sinusoid(robot: Robot, seconds: float = 60.0, seed: int = 0, rate: float = 100.0, share: float = 0.5) -> Protocol:
    """One sine a joint, each with its own period and phase, swelling from rest and ebbing to rest.

    Args:
        robot: whose limits to keep.
        seconds: length, rest at both ends included.
        seed: draws periods (3 to 9 s) and phases.
        rate: sampling rate [Hz].
        share: of the position, velocity and acceleration limits to use.
    """
    rng = np.random.default_rng(seed)
    frequency = 2.0 * np.pi / rng.uniform(3.0, 9.0, robot.n)
    phase = rng.uniform(0.0, 2.0 * np.pi, robot.n)
    t, envelope = _time(seconds, rate)
    shape = np.sin(frequency * t[:, None] + phase)
    return _within(robot, "sinusoid", shape * envelope[:, None], rate, share)


def fourier(
    robot: Robot,
    seconds: float = 30.0,
    seed: int = 0,
    rate: float = 100.0,
    share: float = 0.8,
    harmonics: int = 5,
    base: float = 0.1,
) -> Protocol:
    """A random finite Fourier series of ``harmonics`` over the ``base`` frequency [Hz] in every joint, rest to rest.

    Swevers et al. 1997; the amplitudes fall with the harmonic so that each adds about the same speed.
    ``seconds``, ``seed``, ``rate`` and ``share`` as for `sinusoid`.

    Args:
        robot: whose limits are kept.
        seconds: length.
        seed: draws amplitudes and phases.
        rate: samples a second [Hz].
        share: of the limits to use.
        harmonics: of the series.
        base: its lowest frequency [Hz].
    """
    rng = np.random.default_rng(seed)
    t, envelope = _time(seconds, rate)
    order = np.arange(1, harmonics + 1)
    angle = 2.0 * np.pi * base * np.outer(t, order)
    sine, cosine = rng.standard_normal((2, harmonics, robot.n)) / order[:, None]
    shape = np.sin(angle) @ sine + np.cos(angle) @ cosine
    return _within(robot, "fourier", shape * envelope[:, None], rate, share)


def _time(seconds: float, rate: float) -> tuple[FloatArray, FloatArray]:
    """Return the times and an envelope that is zero while the robot rests at both ends."""
    t = np.arange(round(seconds * rate)) / rate
    end = t[-1] if len(t) else 0.0
    ramp = np.clip((np.minimum(t, end - t) - REST) / RAMP, 0.0, 1.0)
    return t, ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)


def _within(robot: Robot, name: str, shape: FloatArray, rate: float, share: float) -> Protocol:
    """Scale and centre each joint's shape (N, n), zero at both ends, so that it fills its tightest limit."""
    middle, half, velocity, acceleration = limits(robot, share)
    speed = np.abs(np.diff(shape, axis=0)).max(axis=0) * rate
    jolt = np.abs(np.diff(shape, 2, axis=0)).max(axis=0) * rate**2
    size = np.minimum(half / np.abs(shape).max(axis=0), np.minimum(velocity / speed, acceleration / jolt))
    q = middle + size * shape
    return Protocol(name, rate, len(q), lambda: in_blocks(q))
