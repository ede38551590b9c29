"""How noisy a robot's signals are, as far as its observers feel it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.causal import CausalDerivatives
from ident.log import JointLog
from ident.model import CurrentModel

TRIAL = 20_000
"""Samples of unit noise that show how a filter passes it."""


@dataclass(frozen=True, eq=False)
class MomentumNoise:
    """Standard deviations of what a momentum observer is given, each (n,), above 0.

    Attributes:
        force: of the motor force at a sample [force unit].
        momentum: of the generalised momentum at a sample [force unit s].
    """

    force: FloatArray
    momentum: FloatArray


def measure_noise(model: CurrentModel, logs: Iterable[JointLog], filtered: bool = True) -> MomentumNoise:
    """Measure the noise of current and position, and map it through the model.

    Noise is what third differences show, which smooth motion leaves alone. The current's becomes force by the gain;
    the position's (or the reported velocity's) becomes velocity by the model's filter and momentum by the mass
    matrix at the middle of the first log.

    Args:
        model: identified model.
        logs: what the robot reports; contact does no harm.
        filtered: whether the observer will filter motion.
    """
    squares = np.zeros((3, model.n))
    rows, middle, rate = 0, None, model.rate
    for log in logs:
        if middle is None:
            middle, rate = log.q[len(log) // 2], log.rate
        for segment in log.segments():
            part = log[segment]
            kept = np.isfinite(part.q).all(axis=1) & np.isfinite(part.current).all(axis=1)
            signals = (part.current, part.q, part.q if part.dq is None else part.dq)
            third = [np.diff(s[kept], 3, axis=0) ** 2 / 20.0 for s in signals]
            squares += np.array([d.sum(axis=0) for d in third])
            rows += len(third[0])
        reported = log.dq is not None
    deviation = np.sqrt(squares / max(rows, 1))
    if middle is None:
        middle, reported = np.zeros(model.n), False
    velocity = deviation[2] if reported else deviation[1]
    if filtered:
        velocity = velocity * _passed(model.cutoff, rate, reported)
    inertia = model.robot.rigid_body.mass_matrix(middle, model.link_parameters)
    inertia = model.robot.by_joints(inertia + np.diag(model.rotor_inertia))
    force, momentum = model.gain * deviation[0], np.sqrt(inertia**2 @ velocity**2)
    # a noise-free log still needs some trust in both, or the filter has no gain
    return MomentumNoise(_above_nought(force), _above_nought(momentum))


def _passed(cutoff: float, rate: float, reported: bool) -> float:
    """Deviation of filtered velocity for white noise of unit deviation in position, or in reported velocity."""
    noise = np.random.default_rng(0).standard_normal((TRIAL, 1))
    t = np.arange(TRIAL) / rate
    _, dq, _ = CausalDerivatives(rate, cutoff, 1).run(t, noise, noise if reported else None)
    return float(np.std(dq))


def _above_nought(values: FloatArray) -> FloatArray:
    floor = 1e-6 * float(values.max()) if values.max() > 0.0 else 1e-9
    return np.maximum(values, floor)
