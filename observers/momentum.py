"""The generalised momentum observer."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.model import CurrentModel
from observers.model_based import ModelBasedObserver, Signals, per_joint


class MomentumObserver(ModelBasedObserver):
    """Generalised momentum observer (De Luca and Mattone 2003), each joint a first-order low pass of its force.

    In continuous time r = K (p - p0 - int(drive + r) dt), so dr/dt = K (f - r). Over a time step h that solves to
    r <- exp(-K h) r + (1 - exp(-K h)) ((p - p_before)/h - mean drive), which is stable for every K h and integrates
    nothing that could drift. The mean drive is the trapezoid's. It starts at r = 0.

    Args:
        model: identified model.
        bandwidth: of the residual [Hz], one or (n,); the gain K is 2 pi times it [1/s].
        filtered, rate: see `ModelBasedObserver`.

    Raises:
        InputError: a bandwidth is not positive.
    """

    def __init__(
        self,
        model: CurrentModel,
        bandwidth: float | FloatArray = 5.0,
        filtered: bool = True,
        rate: float | None = None,
    ) -> None:
        self._gain = 2.0 * np.pi * per_joint(bandwidth, model.n, "bandwidth [Hz]")
        super().__init__(model, filtered, rate)

    def _advance(self, signals: Signals) -> FloatArray:
        out = np.empty_like(signals.momentum)
        momentum_scan(signals.step, signals.momentum, signals.drive, self._gain, self._state, out)
        return out


@compiled
def momentum_scan(
    step: FloatArray, momentum: FloatArray, drive: FloatArray, gain: FloatArray, state: FloatArray, out: FloatArray
) -> None:
    """Go on over rows; ``state`` (3, n) is the residual, and momentum and drive of the row before.

    Args:
        step: time since the row before [s], (N,); where it is not above 0 the residual begins anew.
        momentum: generalised momentum, (N, n).
        drive: what the model says its rate of change is, (N, n).
        gain: K of each joint [1/s], (n,).
        state: carried from row to row, changed in place.
        out: takes the residual, (N, n).
    """
    for k in range(len(step)):
        for j in range(momentum.shape[1]):
            if step[k] > 0.0:
                leaves = -np.expm1(-gain[j] * step[k])
                force = (momentum[k, j] - state[1, j]) / step[k] - 0.5 * (drive[k, j] + state[2, j])
                state[0, j] += leaves * (force - state[0, j])
            else:
                state[0, j] = 0.0
            state[1, j], state[2, j] = momentum[k, j], drive[k, j]
            out[k, j] = state[0, j]
