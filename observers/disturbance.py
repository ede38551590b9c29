"""The nonlinear disturbance observer."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.errors import InputError
from ident.model import CurrentModel
from observers.model_based import ModelBasedObserver, Signals, per_joint


class DisturbanceObserver(ModelBasedObserver):
    """Nonlinear disturbance observer (Mohammadi et al. 2013): df_est/dt = L(q) (f - f_est), L = X^-1 M(q)^-1.

    X^-1 is 2 pi bandwidth times the diagonal of the mass matrix at the start, so that L is near 2 pi bandwidth and
    light configurations, where a force shows sooner, are followed sooner. A step h solves
    (M X + h) f_est <- M X f_est + h f, which needs no inverse and is stable for every step. f is the momentum's
    rate at the step's end, by the parabola through its last three values, less the drive.

    Args:
        model: identified model; its mass matrix must have a positive diagonal.
        bandwidth: of the residual where the arm is as heavy as at the start [Hz], one or (n,).
        filtered, rate: see `ModelBasedObserver`.

    Raises:
        InputError: a bandwidth is not positive. ``run`` and ``step`` raise it too, where the model gives a joint no
            positive inertia.
    """

    def __init__(
        self,
        model: CurrentModel,
        bandwidth: float | FloatArray = 5.0,
        filtered: bool = True,
        rate: float | None = None,
    ) -> None:
        self._gain = 2.0 * np.pi * per_joint(bandwidth, model.n, "bandwidth [Hz]")
        self._state = np.zeros((4, model.n))
        super().__init__(model, filtered, rate)

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""
        super().reset()
        self._state[:] = 0.0
        self._usual: FloatArray | None = None

    def _advance(self, signals: Signals) -> FloatArray:
        mass = self.model.robot.rigid_body.mass_matrix(signals.q, self._link_parameters)
        mass[:, range(self.n), range(self.n)] += self._rotor_inertia
        if self._usual is None:
            self._usual = np.diag(mass[0]).copy()
            wrong = np.flatnonzero(~(self._usual > 0.0)) + 1
            if len(wrong):
                what = f"no positive inertia at joint {', '.join(map(str, wrong))}"
                raise InputError(what, "disturbance observer", "identify feasible parameters, or take gmo")
        out = np.empty_like(signals.momentum)
        relative = mass / (self._gain * self._usual)
        _scan(signals.step, signals.momentum, signals.drive, relative, self._state, out)
        return out


@compiled
def _scan(
    step: FloatArray, momentum: FloatArray, drive: FloatArray, mass: FloatArray, state: FloatArray, out: FloatArray
) -> None:
    """``mass`` (N, n, n) is M X; ``state`` (4, n): force, momentum and its mean slope before, that step."""
    n = momentum.shape[1]
    for k in range(len(step)):
        h = step[k]
        if h > 0.0:
            right = np.zeros(n)
            for j in range(n):
                slope = (momentum[k, j] - state[1, j]) / h
                before = state[3, j]
                rate = slope + h / (h + before) * (slope - state[2, j]) if before > 0.0 else slope
                right[j] = h * (rate - drive[k, j])
                for i in range(n):
                    right[j] += mass[k, j, i] * state[0, i]
                state[2, j], state[3, j] = slope, h
            left = mass[k].copy()
            for j in range(n):
                left[j, j] += h
            state[0] = np.linalg.solve(left, right)
        else:
            state[0], state[2], state[3] = 0.0, 0.0, 0.0
        state[1] = momentum[k]
        out[k] = state[0]
