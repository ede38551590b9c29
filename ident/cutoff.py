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
NEGLIGIBLE = 0.02
"""Error of the acceleration, as a share of it, that is not worth a lower cut-off."""
WINDOW = 4.0
"""Length [s] of the pieces whose spectra are averaged."""
FEWEST_ROWS = 64
OCTAVES = 2.0
"""The spectrum of motion falls steeply over this many octaves, that of noise does not."""
ABOVE_NOISE = 4.0
"""Least fall of the position's power spectrum, to its median over the next OCTAVES, that is taken for motion."""


@dataclass(frozen=True)
class CutoffChoice:
    """A cut-off ``hertz`` and, in one sentence, the ``reason`` for it."""

    hertz: float
    reason: str


def choose_cutoff(log: JointLog) -> CutoffChoice:
    """Choose the low-pass cut-off for a log's accelerations from the spectrum of its positions.

    Motion is where the spectrum of a joint's position still falls steeply; from where it has become flat there is only
    noise, and as much of it is taken to lie below. For every cut-off of the zero-phase filter the error of the
    acceleration follows: motion that is cut away plus noise that is let through, related to each joint's acceleration.
    The cut-off is the highest at which the joints that move have, on average, the least error above that of each one's
    best (Wiener's balance), or one that is NEGLIGIBLE, but no more than SPAN times the band that holds 90 % of the
    acceleration, or AMPLE. It lies between LOWEST and the smaller of HIGHEST and HIGHEST_SHARE of the rate.

    Args:
        log: of at least one segment with FEWEST_ROWS rows; else AMPLE is chosen.
    """
    rate = log.rate
    highest = min(HIGHEST, HIGHEST_SHARE * rate)
    lowest = min(LOWEST, highest)
    spectra = _acceleration_spectra(log, rate)
    if spectra is None:
        hertz = min(AMPLE, highest)
        return CutoffChoice(hertz, f"{hertz:g} Hz: the segments are too short for a spectrum of the motion")
    frequency, spectrum = spectra
    motion, noise = _separate(frequency, spectrum, rate)
    moving = motion.sum(axis=0) > 0.0
    if not moving.any():
        hertz = min(AMPLE, highest)
        return CutoffChoice(hertz, f"{hertz:g} Hz: no joint moves")
    motion, noise = motion[:, moving], noise[:, moving]
    candidates = np.geomspace(lowest, highest, 100)
    errors = np.array([_errors(cutoff, frequency, motion, noise) for cutoff in candidates])
    excess = np.mean(errors - errors.min(axis=0), axis=1)
    balanced = float(candidates[excess <= max(float(excess.min()), NEGLIGIBLE**2)].max())
    band = _band(frequency, motion)
    ample = max(SPAN * band, AMPLE)
    hertz = float(f"{min(ample, balanced):.3g}")
    if ample < balanced:
        reason = f"there is little noise, and this is well above the {band:.2g} Hz that hold 90 % of the acceleration"
    elif balanced > 0.99 * highest:
        reason = "there is little noise, and no higher one is of use for an arm at this rate"
    else:
        reason = "above it the positions hold more noise than motion"
    return CutoffChoice(hertz, f"{hertz:.3g} Hz: {reason}")


def _separate(frequency: FloatArray, spectrum: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Part acceleration spectra (frequencies, n) into motion and noise."""
    # A second difference multiplies a position's spectrum by this.
    gain = ((2.0 * rate * np.sin(np.pi * frequency / rate)) ** 4)[:, None]
    position = spectrum / gain
    level = np.array([_median_above(frequency, position, f) for f in frequency])
    clear = (position > ABOVE_NOISE * level) & (frequency < HIGHEST)[:, None]
    last = len(frequency) - 1 - np.argmax(clear[::-1], axis=0)
    last[~clear.any(axis=0)] = 0
    floor = level[last, np.arange(level.shape[1])] * gain
    motion = np.where(clear, np.maximum(spectrum - floor, 0.0), 0.0)
    return motion, spectrum - motion


def _median_above(frequency: FloatArray, position: FloatArray, start: float) -> FloatArray:
    """Median of spectra over the OCTAVES above a frequency."""
    above = (frequency >= start) & (frequency <= start * 2.0**OCTAVES)
    median: FloatArray = np.median(position[above], axis=0)
    return median


def _errors(cutoff: float, frequency: FloatArray, motion: FloatArray, noise: FloatArray) -> FloatArray:
    """Squared error of the acceleration per squared acceleration, motion lost plus noise passed, of each joint.

    The response is that of ``zero_phase`` of order 3.
    """
    response = 1.0 / (1.0 + (np.sqrt(2.0) - 1.0) * (frequency / cutoff) ** 6)[:, None] ** 2
    error = ((1.0 - response) ** 2 * motion + response**2 * noise).sum(axis=0)
    related: FloatArray = error / motion.sum(axis=0)
    return related


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
    total, weight = np.zeros((window // 2 + 1, log.n)), 0
    frequency = np.zeros(0)
    for block in log.blocks(int(16 * WINDOW * rate)):
        grid = np.linspace(block.t[0], block.t[-1], round((block.t[-1] - block.t[0]) * rate) + 1)
        if len(block) < window + 4 or len(grid) < window + 2:
            continue
        q = scipy.interpolate.CubicSpline(block.t, block.q, axis=0)(grid)
        ddq = np.diff(q, 2, axis=0) * rate**2
        frequency, spectrum = scipy.signal.welch(ddq, rate, nperseg=window, detrend=False, axis=0)
        total, weight = total + spectrum * len(block), weight + len(block)
    return None if weight == 0 else (frequency[1:], total[1:] / weight)
