"""From motor torque to the current the drive reports: gain, saturation, offset, drift, lag and delay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled


@dataclass(frozen=True)
class Drive:
    """The drive of n motors.

    Attributes:
        gain: torque [N m] per unit of current, (n,).
        saturation: share of the torque lost at the torque ``knee``, (n,).
        knee: torque [N m] at which ``saturation`` holds, (n,).
        offset: current reported for no torque, in current units, (n,).
        drift: growth of the offset in an hour, in current units, (n,).
    """

    gain: FloatArray
    saturation: FloatArray
    knee: FloatArray
    offset: FloatArray
    drift: FloatArray

    def current(self, torque: FloatArray, t: FloatArray) -> FloatArray:
        """Return the current (N, n) for motor torques (N, n) at the times ``t`` (N,) since switching on [s].

        Iron saturates softly: with ``x = torque / knee`` the current exceeds ``torque / gain`` by the factor
        ``1 + s' 2 x^2 / (1 + x^2)``; ``s' = s / (1 - s)``, so that a share ``s`` of the torque is lost at the knee.
        """
        square = (torque / self.knee) ** 2
        excess = self.saturation / (1.0 - self.saturation) * 2.0 * square / (1.0 + square)
        sensed: FloatArray = torque / self.gain * (1.0 + excess) + self.offset + t[:, None] / 3600.0 * self.drift
        return sensed


@compiled
def _low_pass(x: FloatArray, pole: FloatArray, stages: int, state: FloatArray) -> FloatArray:
    y = np.empty_like(x)
    for j in range(x.shape[1]):
        for row in range(len(x)):
            value = x[row, j]
            for stage in range(stages):
                state[stage, j] += pole[j] * (value - state[stage, j])
                value = state[stage, j]
            y[row, j] = value
    return y


class LowPass:
    """A cascade of equal first-order low-passes, -3 dB at ``hertz`` (n,) in all; inf lets everything through."""

    def __init__(self, hertz: FloatArray, stages: int, dt: float) -> None:
        corner = hertz / np.sqrt(2.0 ** (1.0 / stages) - 1.0)
        self._pole = 1.0 - np.exp(-2.0 * np.pi * np.minimum(corner, 1e9) * dt)
        self._stages = stages

    def reset(self, value: FloatArray) -> None:
        """Settle at a constant input ``value`` (n,)."""
        self._state = np.tile(value, (self._stages, 1))

    def filter(self, x: FloatArray) -> FloatArray:
        """Return the filtered signal (N, n)."""
        return _low_pass(x, self._pole, self._stages, self._state)


class DelayLine:
    """A delay of ``seconds`` (n,), linear between samples ``dt`` apart."""

    def __init__(self, seconds: FloatArray, dt: float) -> None:
        self._shift = seconds / dt
        self._keep = int(np.ceil(np.max(self._shift))) + 1

    def reset(self, value: FloatArray) -> None:
        """Fill the line with a constant ``value`` (n,)."""
        self._past = np.tile(value, (self._keep, 1))

    def filter(self, x: FloatArray) -> FloatArray:
        """Return the delayed signal (N, n)."""
        line = np.concatenate([self._past, x])
        self._past = line[-self._keep :]
        whole = np.floor(self._shift).astype(np.int64)
        rest = self._shift - whole
        out = np.empty_like(x)
        for j in range(x.shape[1]):
            start = self._keep - whole[j]
            out[:, j] = (1.0 - rest[j]) * line[start : start + len(x), j]
            if rest[j] > 0.0:
                out[:, j] += rest[j] * line[start - 1 : start - 1 + len(x), j]
        return out
