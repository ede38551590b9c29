"""A filter cut-off chosen from the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.interpolate
import scipy.signal

from ident.arrays import FloatArray
from ident.log import JointLog

LOWEST = 2.0
"""No lower cut-off is chosen [Hz]."""
HIGHEST = 50.0
"""No higher cut-off is chosen [Hz]: beyond, an arm's structure moves and not its joints."""
HIGHEST_SHARE = 0.4
"""No higher cut-off is chosen, as a share of the sampling rate."""
AMPLE = 5.0
"""Least cut-off [Hz] that is lowered only for noise."""
SPAN = 10.0
"""A filter this many times above the motion leaves its phase and amplitude alone."""
WINDOW = 4.0
"""Length [s] of the pieces whose spectra are averaged."""
FEWEST_ROWS = 64
NOISE_BAND = 0.3
"""Positions hold no motion above this share of the sampling rate, only noise."""
ABOVE_NOISE = 4.0
"""A line of the spectrum counts as motion above this multiple of the noise."""


@dataclass(frozen=True)
class CutoffChoice:
    """A cut-off ``hertz`` and, in one sentence, the ``reason`` for it."""

    hertz: float
    reason: str


def choose_cutoff(log: JointLog) -> CutoffChoice:
    """Choose the low-pass cut-off for a log's accelerations from the spectrum of its positions.

    The noise of each joint's position is read off the top of its spectrum, where a robot does not move, and taken for
    white. For every cut-off of the zero-phase filter the error of the acceleration follows: motion that is cut away
    plus noise that is let through (Wiener's balance). The error is related to each joint's acceleration and summed over
    the joints that move. Where there is next to no noise the cut-off is SPAN times the band that holds 90 % of the
    acceleration. It lies between LOWEST and the smaller of HIGHEST and HIGHEST_SHARE of the rate.

    Args:
        log: of at least one segment with FEWEST_ROWS rows; else AMPLE is chosen.
    """
    rate = log.rate
    highest = min(HIGHEST, HIGHEST_SHARE * rate)
    spectra = _acceleration_spectra(log, rate)
    if spectra is None:
        hertz = min(AMPLE, highest)
        return CutoffChoice(hertz, f"{hertz:g} Hz: the segments are too short for a spectrum of the motion")
    frequency, spectrum = spectra
    # A second difference multiplies white position noise by this.
    gain = (2.0 * rate * np.sin(np.pi * frequency / rate)) ** 4
    noise = np.median((spectrum / gain[:, None])[frequency > NOISE_BAND * rate], axis=0) * gain[:, None]
    clear = (spectrum > ABOVE_NOISE * noise) & (frequency < HIGHEST)[:, None]
    motion = np.where(clear, spectrum - noise, 0.0)
    moving = motion.sum(axis=0) > 0.0
    if not moving.any():
        hertz = min(AMPLE, highest)
        return CutoffChoice(hertz, f"{hertz:g} Hz: no joint moves")
    motion, noise = motion[:, moving], noise[:, moving]
    candidates = np.geomspace(LOWEST, max(highest, LOWEST), 100)
    balanced = float(candidates[np.argmin([_error(cutoff, frequency, motion, noise) for cutoff in candidates])])
    band = _band(frequency, motion)
    hertz = float(np.clip(max(SPAN * band, AMPLE), LOWEST, balanced))
    if hertz < balanced:
        return CutoffChoice(
            hertz, f"{hertz:.3g} Hz: the noise would allow more, but 90 % of the acceleration lies below {band:.2g} Hz"
        )
    return CutoffChoice(
        hertz, f"{hertz:.3g} Hz: above it the noise of the positions outweighs the motion it lets through"
    )


def _error(cutoff: float, frequency: FloatArray, motion: FloatArray, noise: FloatArray) -> float:
    """Mean over joints of the squared error of the acceleration, motion lost and noise passed, per squared acceleration.

    The response is that of ``zero_phase`` of order 3.
    """
    response = 1.0 / (1.0 + (np.sqrt(2.0) - 1.0) * (frequency / cutoff) ** 6)[:, None] ** 2
    error = ((1.0 - response) ** 2 * motion + response**2 * noise).sum(axis=0)
    return float(np.mean(error / motion.sum(axis=0)))


def _band(frequency: FloatArray, motion: FloatArray) -> float:
    """Frequency [Hz] below which the joint that moves fastest has 90 % of its squared acceleration."""
    share = np.cumsum(motion, axis=0) / motion.sum(axis=0)
    return float(frequency[np.argmax(share >= 0.9, axis=0)].max())


def _acceleration_spectra(log: JointLog, rate: float) -> tuple[FloatArray, FloatArray] | None:
    """Welch spectra (frequencies, n) of the second differences of the positions, averaged over segments.

    Differencing before the transform keeps the leakage of slow, large motion from hiding the noise.
    """
    longest = max(part.stop - part.start for part in log.segments())
    window = min(int(WINDOW * rate), longest - 4)
    if window < FEWEST_ROWS:
        return None
    total, weight = 0.0, 0
    frequency = np.zeros(0)
    for block in log.blocks(int(16 * WINDOW * rate)):
        grid = np.linspace(block.t[0], block.t[-1], round((block.t[-1] - block.t[0]) * rate) + 1)
        if len(block) < window + 4 or len(grid) < window + 2:
            continue
        q = scipy.interpolate.CubicSpline(block.t, block.q, axis=0)(grid)
        ddq = np.diff(q, 2, axis=0) * rate**2
        frequency, spectrum = scipy.signal.welch(ddq, rate, nperseg=window, detrend=False, axis=0)
        total, weight = total + spectrum * len(block), weight + len(block)
    return None if weight == 0 else (frequency[1:], np.asarray(total[1:] / weight))
