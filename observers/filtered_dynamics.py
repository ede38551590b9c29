"""External force by filtering the equation of motion."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.model import CurrentModel
from observers.model_based import ModelBasedObserver, Signals, per_joint

DAMPING = np.sqrt(0.5)
"""Damping ratio of the low pass: Butterworth's."""


class FilteredDynamicsObserver(ModelBasedObserver):
    """The equation of motion under a second-order low pass F, which spares the acceleration (Van Damme et al. 2011).

    F[f] = F[dp/dt] - F[drive], where F[dp/dt] is a proper filter of the momentum itself. Both are one linear system
    for y = F[f] and w = dy/dt - w0^2 p, integrated by the trapezoidal rule over each true time step.

    Args:
        model: identified model.
        bandwidth: cut-off of the low pass [Hz], one or (n,).
        filtered, rate: see `ModelBasedObserver`.

    Raises:
        InputError: a bandwidth is not positive.
    """

    state_rows = 4

    def __init__(
        self,
        model: CurrentModel,
        bandwidth: float | FloatArray = 5.0,
        filtered: bool = True,
        rate: float | None = None,
    ) -> None:
        self._pole = 2.0 * np.pi * per_joint(bandwidth, model.n, "bandwidth [Hz]")
        super().__init__(model, filtered, rate)

    def _advance(self, signals: Signals) -> FloatArray:
        out = np.empty_like(signals.momentum)
        _scan(signals.step, signals.momentum, signals.drive, self._pole, DAMPING, self._state, out)
        return out


@compiled
def _scan(
    step: FloatArray,
    momentum: FloatArray,
    drive: FloatArray,
    pole: FloatArray,
    damping: float,
    state: FloatArray,
    out: FloatArray,
) -> None:
    """Trapezoidal steps of y' = w + w0^2 p, w' = -w0^2 y - c y' - w0^2 drive; ``state`` (4, n): y, w, p, drive."""
    for k in range(len(step)):
        h = 0.5 * step[k]
        for j in range(momentum.shape[1]):
            square, c = pole[j] * pole[j], 2.0 * damping * pole[j]
            p, u = momentum[k, j], drive[k, j]
            if h > 0.0:
                y, w, p0, u0 = state[0, j], state[1, j], state[2, j], state[3, j]
                slope = w + square * p0
                known_y = y + h * slope + h * square * p
                known_w = w - h * (square * (y + u0) + c * slope) - h * square * (u + c * p)
                w = (known_w - h * square * known_y) / (1.0 + h * c + h * h * square)
                state[0, j], state[1, j] = known_y + h * w, w
            else:
                state[0, j], state[1, j] = 0.0, -square * p
            state[2, j], state[3, j] = p, u
            out[k, j] = state[0, j]
