"""Filtering, differentiation and decimation of logged signals."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import scipy.interpolate
import scipy.signal
from numpy.polynomial.legendre import legvander

from ident.arrays import BoolArray, FloatArray
from ident.causal import CausalButterworth, CausalDerivatives, check_cutoff
from ident.cutoff import CutoffChoice, choose_cutoff
from ident.errors import InputError
from ident.log import JointLog

__all__ = [
    "CausalButterworth",
    "CausalDerivatives",
    "CutoffChoice",
    "Motion",
    "choose_cutoff",
    "decimate",
    "derivative_noise",
    "derive",
    "differentiate",
    "late",
    "zero_phase",
    "zero_phase_gain",
]

NEGLIGIBLE_JITTER = 1e-6
"""Deviation from a uniform grid, as a share of the step, below which it is rounding: differentiated twice along stamps
that jitter by half a hundredth, what was filtered as if uniform shook accelerations by 1 rad/s^2."""
LATE_ROWS, CATCHES_UP = 3, 1.5
"""Rows one after the other at most that may be late, and times the step before that the step after them then is."""
DECIMATION_ORDER = 8
DECIMATION_BAND = 0.35
"""Cut-off of the anti-aliasing filter as a share of the new rate; the new Nyquist frequency is at 0.5."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Filtered motion of n joints at N instants: ``t`` [s] (N,), ``q``, ``dq``, ``ddq`` [rad or m, s] (N, n).

    Rows for which there is too little history hold NaN in ``dq`` and ``ddq``.
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, rows: slice | BoolArray) -> Motion:
        """Return some of the rows: those of a slice (views, no copies), or those that are marked."""
        return replace(self, t=self.t[rows], q=self.q[rows], dq=self.dq[rows], ddq=self.ddq[rows])


def zero_phase(x: FloatArray, rate: float, cutoff: float, order: int = 3) -> FloatArray:
    """Filter forward and backward with a Butterworth low pass: no lag, -3 dB at the cut-off after both passes.

    Each pass has its own cut-off raised, on the warped frequency axis of the bilinear transform, by
    (sqrt(2) - 1)^(-1 / (2 order)), so that |H|^2 of one pass is -3 dB where the causal filter of this cut-off has it.

    Args:
        x: (N,) or (N, k), uniformly sampled.
        rate: samples a second [Hz].
        cutoff: frequency [Hz] of the -3 dB point; the normalised frequency is 2 cutoff / rate.
        order: of each pass.

    Returns:
        Filtered x, same shape; all NaN where there are fewer rows than ``shortest`` says.

    Raises:
        InputError: the cut-off is not below half the rate.
    """
    check_cutoff(rate, cutoff)
    if len(x) < shortest(rate, cutoff, order):
        return np.full(x.shape, np.nan)
    sections = scipy.signal.butter(order, 2.0 / np.pi * np.arctan(_warped(rate, cutoff, order)), output="sos")
    period = max(2 * (order + 1), _period(rate, cutoff))
    before, after = _continuation(x[::-1], period)[::-1], _continuation(x, period)
    padded = np.concatenate([before, x, after])
    filtered: FloatArray = scipy.signal.sosfiltfilt(sections, padded, axis=0, padlen=period)
    return filtered[period:-period]


def _continuation(x: FloatArray, rows: int) -> FloatArray:
    """Continue a signal by some rows, by the quintic that fits twice as many best, the cubic where there are fewer.

    A joint that moves at a log's end has an acceleration there; the usual reflection at the end would make it nought.
    """
    ends, degree = (2 * rows, 5) if len(x) >= 2 * rows else (rows, 3)
    powers = legvander(np.linspace(-1.0, 1.0 + 2.0 * rows / (ends - 1), ends + rows), degree)
    coefficients = np.linalg.lstsq(powers[:ends], x[-ends:].reshape(ends, -1))[0]
    continued: FloatArray = powers[ends:] @ coefficients
    return continued.reshape(rows, *x.shape[1:])


def zero_phase_gain(hertz: FloatArray, rate: float, cutoff: float, order: int = 3) -> FloatArray:
    """Return what `zero_phase` leaves of frequencies, in amplitude, (k,).

    Args:
        hertz: frequencies (k,), below half the rate.
        rate: samples a second [Hz].
        cutoff: of the filter [Hz].
        order: of each pass.
    """
    return np.asarray(1.0 / (1.0 + (np.tan(np.pi * hertz / rate) / _warped(rate, cutoff, order)) ** (2 * order)))


def _warped(rate: float, cutoff: float, order: int) -> float:
    """Cut-off of each of two passes, on the bilinear transform's scale."""
    return float(np.tan(np.pi * cutoff / rate) * (np.sqrt(2.0) - 1.0) ** (-0.5 / order))


def shortest(rate: float, cutoff: float, order: int = 3) -> int:
    """Fewest rows that ``zero_phase`` filters: a period of the cut-off, and enough to pad the ends.

    Args:
        rate: samples a second [Hz].
        cutoff: of the filter [Hz].
        order: of the filter.
    """
    return max(3 * (order + 1) + 1, _period(rate, cutoff))


def _period(rate: float, cutoff: float) -> int:
    """Rows in a period of the cut-off; the same for all pieces of a log, whose rates differ by rounding and jitter."""
    return int(np.ceil(rate / cutoff - 0.01))


def differentiate(t: FloatArray, x: FloatArray) -> FloatArray:
    """Differentiate on true time stamps: the slope of the cubic spline through the samples.

    At a tenth of the sampling rate its gain is 0.999, where that of a central difference is 0.94.

    Args:
        t: time [s], (N,), strictly increasing.
        x: (N,) or (N, k), free of noise that the caller does not want differentiated.

    Returns:
        dx/dt, same shape as x; NaN for a single row.
    """
    if len(t) < 2:
        return np.full(x.shape, np.nan)
    spline = scipy.interpolate.CubicSpline(t, x, axis=0)
    slope: FloatArray = np.concatenate([spline.c[2], spline(t[-1:], 1)])
    return slope


def derivative_noise(noise: FloatArray, cutoff: float, rate: float) -> FloatArray:
    """Return the standard deviation (n,) of the derivative, below the cut-off, of white noise of deviation (n,).

    The derivative's spectral density is (2 pi f)^2 times the noise's, 2 noise^2 / rate, up to the cut-off.

    Args:
        noise: standard deviation (n,) of the signal's noise.
        cutoff: of the low pass [Hz].
        rate: samples a second [Hz].
    """
    return np.asarray(noise * np.sqrt(8.0 * np.pi**2 * cutoff**3 / (3.0 * rate)))


def decimate(x: FloatArray, t: FloatArray, factor: int) -> tuple[FloatArray, FloatArray]:
    """Keep every ``factor``-th row after a zero-phase low pass that keeps higher frequencies from folding back.

    Args:
        x: (N,) or (N, k).
        t: time [s], (N,), strictly increasing; need not be uniform.
        factor: rows in for one row out.

    Returns:
        x, t: of every ``factor``-th row, the first included.

    Raises:
        InputError: the factor is not a whole number above 0, or the signal is too short to be filtered.
    """
    if factor < 1 or factor != int(factor):
        raise InputError(f"decimation by {factor}", "decimate", "give a whole number above 0")
    if factor == 1:
        return x.copy(), t.copy()
    rate = 1.0 / float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    cutoff = DECIMATION_BAND * rate / factor
    if len(t) < shortest(rate, cutoff, DECIMATION_ORDER):
        raise InputError(f"{len(t)} rows are too few to decimate by {factor}", "decimate", "give a longer signal")
    grid = _grid(t)
    if grid is None:
        return zero_phase(x, rate, cutoff, DECIMATION_ORDER)[::factor], t[::factor].copy()
    filtered = zero_phase(_at(t, x, grid), _rate(grid), cutoff, DECIMATION_ORDER)
    return _at(grid, filtered, t[::factor]), t[::factor].copy()


def derive(log: JointLog, cutoff: float, causal: bool = False) -> Motion:
    """Filter a log's positions and find its velocities and accelerations, segment by segment.

    Velocity and acceleration the robot reports are filtered alike; what it does not report is the derivative of the
    filtered quantity below. Without ``causal`` the result has no lag, and stamps that jitter are resampled to a uniform
    grid for filtering and the result taken back to the true stamps. A gap of more than half a period of the cut-off
    parts a segment; parts too short to filter hold NaN in dq and ddq; rows that are ``late`` say nothing. With
    ``causal`` it is what CausalDerivatives
    gives step by step, reset at each segment.

    Args:
        log: positions and time stamps.
        cutoff: of the low pass [Hz].
        causal: use the filter that runs online.

    Raises:
        InputError: the cut-off is not below half the rate.
    """
    rate = log.rate
    q, dq, ddq = np.empty((3, *log.q.shape))
    scan = CausalDerivatives(rate, cutoff, log.n)
    for rows in log.segments():
        part = log[rows]
        if causal:
            scan.reset()
            q[rows], dq[rows], ddq[rows] = scan.run(part.t, part.q, part.dq, part.ddq)
            continue
        gap = max(0.5 / cutoff, 4.5 / rate)
        edges = [0, *(np.flatnonzero(np.diff(part.t) > gap) + 1).tolist(), len(part)]
        for a, b in itertools.pairwise(edges):
            stretch = slice(rows.start + a, rows.start + b)
            q[stretch], dq[stretch], ddq[stretch] = _derive_stretch(part[a:b], rate, cutoff)
    return Motion(log.t, q, dq, ddq)


def late(log: JointLog) -> BoolArray:
    """Rows (N,) that only repeat all positions and currents of the row before while the robot moves on.

    A sample that a controller or a network delivers too late is logged so. Few rows in a row are taken for that, and
    only where the next one makes up for them; a joint that stands, or creeps from count to count, does not.

    Args:
        log: positions and currents.
    """
    found = np.zeros(len(log), dtype=bool)
    moved = np.diff(log.q, axis=0)
    same = ~moved.any(axis=1) & ~np.diff(log.current, axis=0).any(axis=1) & (np.diff(log.segment) == 0)
    edges = np.flatnonzero(np.diff(same, prepend=False, append=False)).reshape(-1, 2)
    for first, end in edges[(edges[:, 0] > 0) & (edges[:, 1] < len(moved)) & (np.ptp(edges, axis=1) <= LATE_ROWS)]:
        step, next_step = moved[first - 1], moved[end]
        along = int(np.argmax(np.abs(next_step)))
        if next_step[along] * step[along] > 0 and abs(next_step[along]) > CATCHES_UP * abs(step[along]):
            found[first + 1 : end + 1] = True
    return found


def _derive_stretch(log: JointLog, rate: float, cutoff: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Zero-phase q, dq, ddq of rows without a gap."""
    unknown = np.full(log.q.shape, np.nan)
    prompt = log[~late(log)]
    if len(prompt) < shortest(rate, cutoff):
        return np.array(log.q), unknown, unknown
    grid = _grid(prompt.t)
    stamps = prompt.t if grid is None else grid
    if len(stamps) < shortest(_rate(stamps), cutoff):
        return np.array(log.q), unknown, unknown

    def smooth(x: FloatArray) -> FloatArray:
        return zero_phase(x if grid is None else _at(prompt.t, x, grid), _rate(stamps), cutoff)

    q = smooth(prompt.q)
    dq = differentiate(stamps, q) if prompt.dq is None else smooth(prompt.dq)
    ddq = differentiate(stamps, dq) if prompt.ddq is None else smooth(prompt.ddq)
    if grid is None:
        return q, dq, ddq
    return _at(grid, q, log.t), _at(grid, dq, log.t), _at(grid, ddq, log.t)


def _grid(t: FloatArray) -> FloatArray | None:
    """Return a uniform grid at the median step over the span of t, None where t is uniform already."""
    step = float(np.median(np.diff(t)))
    rows = round((t[-1] - t[0]) / step) + 1
    grid = np.linspace(t[0], t[-1], rows)
    if rows == len(t) and np.abs(np.diff(t) - step).max() < NEGLIGIBLE_JITTER * step:
        return None
    return grid


def _rate(t: FloatArray) -> float:
    """Mean sampling rate [Hz]."""
    return float((len(t) - 1) / (t[-1] - t[0]))


def _at(t: FloatArray, x: FloatArray, when: FloatArray) -> FloatArray:
    """Interpolate x (N,) or (N, k), sampled at t, by a cubic spline."""
    value: FloatArray = scipy.interpolate.CubicSpline(t, x, axis=0)(when)
    return value
