"""The Kalman momentum observer."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.errors import InputError
from ident.model import CurrentModel
from observers.model_based import ModelBasedObserver, Signals, per_joint
from observers.noise import MomentumNoise

SMALLEST_RATIO = 1e-8
"""Measurement variance as a share of the momentum's own wandering in a step, below which it makes no difference."""


class KalmanObserver(ModelBasedObserver):
    """Kalman filter of the state [p; f] (Wahrburg et al. 2018): p' = drive + f, f' = -decay f, momentum measured.

    Noise on the motor force makes p wander with density q_p = force_noise^2 h, the noise of the momentum is its
    measurement noise R, and the external force wanders with density q_f = w^2 q_p + w^4 R h, w = 2 pi bandwidth: the
    filter then follows forces with that bandwidth, whichever of the two noises is the greater. Discretised after Van
    Loan (1978), on the true time steps.

    Args:
        model: identified model.
        noise: of motor force and momentum, as `measure_noise` gives it.
        bandwidth: of the residual [Hz], one or (n,).
        decay: rate at which an external force is expected to fade [1/s].
        gain: ``steady`` takes the gain that the filter ends up with at the nominal rate, which makes a step some
            operations a joint; ``full`` runs filterpy's filter with its covariance.
        filtered, rate: see `ModelBasedObserver`.

    Raises:
        InputError: a bandwidth is not positive, or the decay is negative.
    """

    def __init__(
        self,
        model: CurrentModel,
        noise: MomentumNoise,
        bandwidth: float | FloatArray = 5.0,
        decay: float = 0.0,
        gain: Literal["steady", "full"] = "steady",
        filtered: bool = True,
        rate: float | None = None,
    ) -> None:
        if not decay >= 0.0:
            raise InputError(f"decay of {decay}", "Kalman observer", "give one of at least 0 [1/s]")
        n, h = model.n, 1.0 / (rate or model.rate)
        pole = 2.0 * np.pi * per_joint(bandwidth, n, "bandwidth [Hz]")
        wander = noise.force**2 * h
        self._measured = np.maximum(noise.momentum**2, SMALLEST_RATIO * wander * h)
        self._density = np.stack([wander, pole**2 * wander + pole**4 * self._measured * h])
        self._decay = decay
        self.steady = np.array([_steady(self._density[:, j], self._measured[j], decay, h) for j in range(n)])
        self._full = gain == "full"
        super().__init__(model, filtered, rate)

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""
        super().reset()
        self._filter_full: Any = None

    def _advance(self, signals: Signals) -> FloatArray:
        out = np.empty_like(signals.momentum)
        if self._full:
            self._run_full(signals, out)
        else:
            gain = np.ascontiguousarray(self.steady[:, :, 0])
            _scan(signals.step, signals.momentum, signals.drive, self._decay, gain, self._state, out)
        return out

    def _run_full(self, signals: Signals, out: FloatArray) -> None:
        """Run filterpy's filter row by row."""
        n = self.n
        for k, h in enumerate(signals.step):
            if h > 0.0:
                force = 0.5 * (signals.drive[k] + self._state[2])
                blocks = [_discrete(self._density[:, j], self._decay, h) for j in range(n)]
                transition, noise = (_spread([b[i] for b in blocks]) for i in (0, 1))
                self._filter_full.predict(u=h * force, F=transition, Q=noise)
                self._filter_full.update(signals.momentum[k])
                out[k] = self._filter_full.x[n:]
            else:
                self._filter_full = self._new_filter(signals.momentum[k])
                out[k] = 0.0
            self._state[2] = signals.drive[k]

    def _new_filter(self, momentum: FloatArray) -> Any:
        """Return filterpy's filter at the steady covariance: then a start needs no time to trust the momentum."""
        from filterpy.kalman import KalmanFilter

        n = self.n
        kalman = KalmanFilter(dim_x=2 * n, dim_z=n, dim_u=n)
        kalman.x = np.concatenate([momentum, np.zeros(n)])
        kalman.H = np.eye(n, 2 * n)
        kalman.B = np.eye(2 * n, n)
        kalman.R = np.diag(self._measured)
        kalman.P = _spread([self.steady[j][:, 1:] for j in range(n)])
        return kalman


def _discrete(density: FloatArray, decay: float, h: float) -> tuple[FloatArray, FloatArray]:
    """Transition and process noise of one joint's [p; f] over a step, each (2, 2), after Van Loan (1978)."""
    from filterpy.common import van_loan_discretization

    a = np.array([[0.0, 1.0], [0.0, -decay]])
    transition, noise = van_loan_discretization(a, np.diag(np.sqrt(density)), h)
    return np.asarray(transition), np.asarray(noise)


def _steady(density: FloatArray, measured: float, decay: float, h: float) -> FloatArray:
    """Return [gain | covariance after an update] (2, 3) that the filter of one joint ends up with."""
    import scipy.linalg

    transition, noise = _discrete(density, decay, h)
    h_row = np.array([[1.0, 0.0]])
    # in units of the force's noise and of seconds, or the equation is too badly scaled to be solved
    scale = np.diag([1.0 / np.sqrt(measured), 1.0 / np.sqrt(density[1] * h)])
    back = np.linalg.inv(scale)
    ahead = scipy.linalg.solve_discrete_are(
        (scale @ transition @ back).T, (h_row @ back / np.sqrt(measured)).T, scale @ noise @ scale, np.eye(1)
    )
    ahead = back @ ahead @ back
    gain = ahead @ h_row.T / (ahead[0, 0] + measured)
    return np.hstack([gain, (np.eye(2) - gain @ h_row) @ ahead])


def _spread(blocks: list[FloatArray]) -> FloatArray:
    """Arrange (2, 2) blocks, one a joint, as a matrix of the state [p; f], (2 n, 2 n)."""
    joint: FloatArray = np.array(blocks)
    return np.block([[np.diag(joint[:, a, b]) for b in range(2)] for a in range(2)])


@compiled
def _scan(
    step: FloatArray,
    momentum: FloatArray,
    drive: FloatArray,
    decay: float,
    gain: FloatArray,
    state: FloatArray,
    out: FloatArray,
) -> None:
    """Go on over rows; ``gain`` (n, 2), ``state`` (3, n): momentum, force, and drive of the row before."""
    for k in range(len(step)):
        h = step[k]
        if h > 0.0:
            keeps = np.exp(-decay * h)
            carries = -np.expm1(-decay * h) / decay if decay > 0.0 else h
        for j in range(momentum.shape[1]):
            if h > 0.0:
                ahead = state[0, j] + carries * state[1, j] + h * 0.5 * (drive[k, j] + state[2, j])
                surprise = momentum[k, j] - ahead
                state[0, j] = ahead + gain[j, 0] * surprise
                state[1, j] = keeps * state[1, j] + gain[j, 1] * surprise
            else:
                state[0, j], state[1, j] = momentum[k, j], 0.0
            state[2, j] = drive[k, j]
            out[k, j] = state[1, j]
