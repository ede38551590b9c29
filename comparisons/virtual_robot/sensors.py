"""Encoders that count and current sensors that hum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from ident.arrays import FloatArray


@dataclass(frozen=True)
class SensorFigures:
    """Figures of the sensors of n joints.

    Attributes:
        encoder_step: position of one count [rad], (n,); 0 for a perfect encoder.
        encoder_noise: standard deviation of the count [counts], (n,).
        current_step: quantum of the reported current, in its unit, (n,); 0 for none.
        white: standard deviation of the white part of the current noise, (n,).
        coloured: standard deviation of its correlated part, (n,).
        correlation: correlation time of that part [s], (n,).
    """

    encoder_step: FloatArray
    encoder_noise: FloatArray
    current_step: FloatArray
    white: FloatArray
    coloured: FloatArray
    correlation: FloatArray


class Sensors:
    """Reads positions and currents at ``rate`` [Hz]; noise drawn from ``seed``, the same however rows are blocked."""

    def __init__(self, figures: SensorFigures, rate: float, seed: int) -> None:
        self._figures = figures
        self._pole = np.exp(-1.0 / (rate * figures.correlation))
        sequence = np.random.SeedSequence(seed).spawn(3)
        self._encoder, self._white, self._coloured = (np.random.default_rng(s) for s in sequence)
        n = len(figures.white)
        self._state = figures.coloured * self._coloured.standard_normal(n)

    def read(self, q: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the reported positions and currents, (N, n), for the true ones."""
        f = self._figures
        seen = quantised(q + f.encoder_step * f.encoder_noise * self._encoder.standard_normal(q.shape), f.encoder_step)
        noise = f.white * self._white.standard_normal(q.shape)
        drive = f.coloured * np.sqrt(1.0 - self._pole**2) * self._coloured.standard_normal(q.shape)
        for j in range(q.shape[1]):
            pole = self._pole[j]
            hum, _ = lfilter([1.0], [1.0, -pole], drive[:, j], zi=[pole * self._state[j]])
            noise[:, j] += hum
            self._state[j] = hum[-1]
        return seen, quantised(current + noise, f.current_step)


def quantised(value: FloatArray, step: FloatArray) -> FloatArray:
    """Return ``value`` (N, n) rounded to multiples of ``step`` (n,); a step of 0 leaves its column alone."""
    safe = np.where(step > 0.0, step, 1.0)
    rounded: FloatArray = np.where(step > 0.0, np.round(value / safe) * safe, value)
    return rounded
