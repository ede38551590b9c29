"""Disturbances that follow the clock and not the motion: lines in the spectrum of what is left."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import welch

from ident.arrays import FloatArray, IntArray

SECONDS = 8.0
"""Length of the stretches whose spectra are averaged."""

HEIGHT, SHARE = 5.0, 0.02
"""A line stands this many times above its surroundings, and holds this share of the residual's square."""


def spectral_line(residual: FloatArray, starts: IntArray, step: float) -> tuple[float, float] | None:
    """Return frequency [Hz] and share of the strongest line in a residual (N,), None where there is none.

    Args:
        residual: sampled every ``step`` seconds within each stretch.
        starts: rows with which stretches begin.
        step: seconds between rows.
    """
    length = round(SECONDS / step)
    edges = np.append(starts, len(residual))
    spectra = [
        welch(residual[a:b], 1.0 / step, "hann", length)
        for a, b in itertools.pairwise(edges.tolist())
        if b - a >= 2 * length
    ]
    if not spectra or length < 64:
        return None
    hertz, power = spectra[0][0], np.mean([p for _, p in spectra], axis=0)
    if not np.any(power > 0.0):
        return None
    around = median_filter(power, size=31, mode="nearest")
    ratio = power / np.maximum(around, 1e-300)
    ratio[:4] = 0.0
    peak = int(np.argmax(ratio))
    band = slice(max(0, peak - 2), peak + 3)
    share = float(np.sum(np.maximum(power[band] - around[band], 0.0)) / np.sum(power))
    return (float(hertz[peak]), share) if ratio[peak] > HEIGHT and share > SHARE else None
