"""The nonlinear disturbance observer."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.model import CurrentModel
from observers.model_based import ModelBasedObserver, Signals, per_joint

LIGHTEST, HEAVIEST = 0.1, 10.0
"""Bounds of a joint's inertia as a share of that at the start: an identified one may be nought or less somewhere."""


class DisturbanceObserver(ModelBasedObserver):
    """Nonlinear disturbance observer (Chen et al. 2000, Mohammadi et al. 2013): df_est/dt = L(q) (f - f_est).

    L is diagonal, 2 pi bandwidth over the joint's inertia at q as a share of that at the start: light poses, in which
    a force shows sooner, are followed sooner. Mohammadi's L = X^-1 M(q)^-1 couples the joints by the inverse of the
    mass matrix; with rows identified apart, in current units, that need not be positive, and was seen to diverge.
    A step h solves (1/L + h) f_est <- f_est/L + h f, which is stable for every step. f is the momentum's rate at the
    step's end, by the parabola through its last three values, less the drive: no other observer is as quick, nor
    as noisy at the same bandwidth.

    Args:
        model: identified model.
        bandwidth: of the residual where the arm is as heavy as at the start [Hz], one or (n,).
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
        self._gain = 2.0 * np.pi * per_joint(bandwidth, model.n, "bandwidth [Hz]")
        super().__init__(model, filtered, rate)

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""
        super().reset()
        self._usual: FloatArray | None = None

    def _advance(self, signals: Signals) -> FloatArray:
        mass = self.model.robot.rigid_body.mass_matrix(signals.q, self._link_parameters)
        inertia = np.diagonal(mass, axis1=1, axis2=2) + self._rotor_inertia
        if self._usual is None:
            self._usual = inertia[0].copy()
        # a joint that the model gives no inertia at the start keeps its bandwidth everywhere
        share = np.where(self._usual > 0.0, inertia / np.where(self._usual > 0.0, self._usual, 1.0), 1.0)
        lag = np.clip(share, LIGHTEST, HEAVIEST) / self._gain
        out = np.empty_like(signals.momentum)
        _scan(signals.step, signals.momentum, signals.drive, lag, self._state, out)
        return out


@compiled
def _scan(
    step: FloatArray, momentum: FloatArray, drive: FloatArray, lag: FloatArray, state: FloatArray, out: FloatArray
) -> None:
    """``lag`` (N, n) is 1/L; ``state`` (4, n): force, momentum and its mean slope before, and that step."""
    for k in range(len(step)):
        h = step[k]
        for j in range(momentum.shape[1]):
            if h > 0.0:
                slope = (momentum[k, j] - state[1, j]) / h
                before = state[3, j]
                rate = slope + h / (h + before) * (slope - state[2, j]) if before > 0.0 else slope
                state[0, j] = (lag[k, j] * state[0, j] + h * (rate - drive[k, j])) / (lag[k, j] + h)
                state[2, j], state[3, j] = slope, h
            else:
                state[0, j], state[2, j], state[3, j] = 0.0, 0.0, 0.0
            state[1, j] = momentum[k, j]
            out[k, j] = state[0, j]
