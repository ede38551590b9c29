"""How robots are moved and logged: kinds of motion, rates, noise of the encoders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comparisons.protocols import named
from ident.arrays import FloatArray
from ident.robot import Robot

MOTOR_SIDE = 2.0 * np.pi / (8192.0 * 100.0)
"""Counts [rad] of an encoder on a motor's shaft, before a gear of a hundred."""


@dataclass(frozen=True)
class Style:
    """How a robot is moved and logged.

    Attributes:
        pieces: what every log consists of: kind of motion and seconds.
        rate: sampling rate [Hz].
        count: of the encoders [rad].
        position_noise: standard deviation of the logged positions beyond their counts [rad].
        velocity_noise: that of logged velocities [rad/s]; None logs none.
        jitter: standard deviation of the time stamps, as a share of the sampling period.
        holds: whether dry friction holds any current while a joint stands, as it does under a position loop.
        yields: displacement [rad] over which dry friction builds up as a joint turns round, the shortest and longest.
    """

    pieces: tuple[tuple[str, float], ...] = (("fourier", 40.0), ("slow", 25.0), ("stop_and_go", 25.0))
    rate: float = 100.0
    count: float = MOTOR_SIDE
    position_noise: float = 0.0
    velocity_noise: float | None = None
    jitter: float = 0.0
    holds: bool = False
    yields: tuple[float, float] | None = None


STYLES = {
    "usual": Style(),
    "500Hz": Style((("fourier", 30.0), ("slow", 15.0), ("stop_and_go", 15.0)), rate=500.0, velocity_noise=1e-3),
    "50Hz": Style(rate=50.0, jitter=0.02),
    "fourier": Style((("fourier", 60.0),)),
    "sinusoid": Style((("sinusoid", 60.0),), velocity_noise=2e-3),
    "short": Style((("fourier", 15.0), ("slow", 10.0))),
    "stop-and-go": Style((("stop_and_go", 90.0),), rate=125.0),
    "noisy": Style(rate=200.0, position_noise=5e-5, velocity_noise=5e-3),
    "sticks": Style((("stop_and_go", 45.0), ("fourier", 30.0)), rate=125.0, holds=True),
    "servos": Style((("stop_and_go", 30.0), ("fourier", 30.0)), rate=50.0, count=2.0 * np.pi / 4096.0, holds=True),
    "yields": Style(
        (("fourier", 40.0), ("slow", 20.0), ("stop_and_go", 20.0)), position_noise=3e-6, yields=(4e-5, 3e-4)
    ),
}
"""What others' logs are like."""

ALL = tuple(name for name, style in STYLES.items() if not style.holds and style.yields is None)
"""Those that ``all`` stands for: dry friction does what a sign of velocity says."""

POOR = {
    "creep": Style((("slow", 60.0),)),
    "one-speed": Style((("narrow", 40.0),)),
}
"""Logs too poor to tell some effects from others: of slow motion alone, and of one small oscillation of every joint."""


def reference(robot: Robot, kind: str, seconds: float, seed: int, rate: float) -> FloatArray:
    """Commanded positions (N, n) of a kind of motion: ``slow``, ``narrow``, or a protocol's name."""
    own = {"slow": _slow, "narrow": _narrow}
    if kind in own:
        return own[kind](robot, seconds, seed, rate)
    protocol = named(kind)(robot, seconds=seconds, seed=seed, rate=rate)
    return np.concatenate([block.q for block in protocol.blocks()])


def _slow(robot: Robot, seconds: float, seed: int, rate: float) -> FloatArray:
    """Slow wandering of all joints with many reversals, at up to 0.1 rad/s, from rest to rest."""
    rng = np.random.default_rng(seed)
    middle = _somewhere(robot, rng)
    t = np.arange(round(seconds * rate)) / rate
    waves = np.zeros((len(t), robot.n))
    for period in (3.1, 7.3, 16.0):
        waves += 0.03 * period / (2 * np.pi) * np.sin(2 * np.pi * t[:, None] / period + rng.uniform(0, 6, robot.n))
    return middle + _from_rest_to_rest(t, waves)


def _narrow(robot: Robot, seconds: float, seed: int, rate: float) -> FloatArray:
    """One oscillation of every joint by 0.1 to 0.2 rad, in 2 to 5 s, from rest to rest."""
    rng = np.random.default_rng(seed)
    middle = _somewhere(robot, rng)
    t = np.arange(round(seconds * rate)) / rate
    periods, sizes = rng.uniform(2.0, 5.0, robot.n), rng.uniform(0.1, 0.2, robot.n)
    return middle + _from_rest_to_rest(t, sizes * np.sin(2 * np.pi * t[:, None] / periods))


def _somewhere(robot: Robot, rng: np.random.Generator) -> FloatArray:
    """Positions (n,) about the middle of the joints' ranges."""
    lower, upper = np.maximum(robot.limits.lower, -2.5), np.minimum(robot.limits.upper, 2.5)
    middle: FloatArray = 0.5 * (lower + upper) + 0.2 * (upper - lower) * rng.uniform(-1, 1, robot.n)
    return middle


def _from_rest_to_rest(t: FloatArray, waves: FloatArray) -> FloatArray:
    """Waves (N, n) that rise and fade within 1.5 s."""
    fade = np.clip(np.minimum(t, t[-1] - t), 0.0, 1.5) / 1.5
    path: FloatArray = waves * (fade * fade * (3 - 2 * fade))[:, None]
    return path
