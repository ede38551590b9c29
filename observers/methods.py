"""The model-based observers by name, with what they need to know taken from the logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.errors import InputError
from ident.log import JointLog
from ident.model import CurrentModel
from observers.direct import DirectEstimator
from observers.disturbance import DisturbanceObserver
from observers.filtered_dynamics import FilteredDynamicsObserver
from observers.kalman import KalmanObserver
from observers.model_based import known_gain
from observers.momentum import MomentumObserver
from observers.noise import measure_noise
from observers.residual import ResidualEstimator
from observers.sliding_mode import SlidingModeObserver

METHODS = {
    "direct": "predicted minus measured current",
    "gmo": "generalised momentum observer",
    "kalman": "Kalman momentum observer",
    "disturbance": "nonlinear disturbance observer",
    "sliding-mode": "super-twisting momentum observer",
    "filtered-dynamics": "filtered equation of motion",
}
"""Names of the methods and what they are."""

SLIDING_NOISE = 5.0
"""A sliding-mode observer follows forces that change by this many deviations of the noise in 1/(2 pi bandwidth)."""


def make_estimator(
    method: str, model: CurrentModel, logs: Sequence[JointLog], bandwidth: float = 5.0
) -> ResidualEstimator:
    """Make an estimator by name.

    Args:
        method: one of `METHODS`.
        model: identified model.
        logs: of the robot, from which its rate and its noise are taken; contact does no harm.
        bandwidth: of the residual [Hz]; ``direct`` has that of the model's filter.

    Raises:
        InputError: no such method, or a bandwidth or rate that cannot be.
    """
    rate = logs[0].rate
    if method == "direct":
        return DirectEstimator(model, rate, model.cutoff, known_gain(model), model.robot.coupling)
    if method == "gmo":
        return MomentumObserver(model, bandwidth, rate=rate)
    if method == "disturbance":
        return DisturbanceObserver(model, bandwidth, rate=rate)
    if method == "filtered-dynamics":
        return FilteredDynamicsObserver(model, bandwidth, rate=rate)
    if method == "kalman":
        return KalmanObserver(model, measure_noise(model, logs), bandwidth, rate=rate)
    if method == "sliding-mode":
        noise = measure_noise(model, logs)
        return SlidingModeObserver(model, 2.0 * np.pi * bandwidth * SLIDING_NOISE * noise.force, rate=rate)
    raise InputError(f"no method {method!r}", "--method", f"give one of {', '.join(METHODS)}")
