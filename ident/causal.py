"""The filters that run online: one sample in, one sample out."""

from __future__ import annotations

import numpy as np
import scipy.signal
from numba import njit

from ident.arrays import FloatArray
from ident.errors import InputError

FORGOTTEN = 3.0
"""Gaps longer than this many periods of the cut-off start the filter anew: nothing of the past is left in it."""


class CausalButterworth:
    """Causal Butterworth low pass at a fixed rate, -3 dB at the cut-off.

    It starts at rest at the first sample. A row with NaN gives NaN and leaves the filter as it was.

    Args:
        rate: samples a second [Hz].
        cutoff: frequency [Hz] of the -3 dB point; the normalised frequency is 2 cutoff / rate.
        order: of the filter.
        channels: columns filtered side by side.

    Raises:
        InputError: the cut-off is not below half the rate.
    """

    def __init__(self, rate: float, cutoff: float, order: int = 3, channels: int = 1) -> None:
        check_cutoff(rate, cutoff)
        self._sections: FloatArray = scipy.signal.butter(order, 2.0 * cutoff / rate, output="sos")
        self._at_rest: FloatArray = scipy.signal.sosfilt_zi(self._sections)
        self._state = np.zeros((len(self._sections), 2, channels))
        self.reset()

    def reset(self) -> None:
        """Forget the past, as at the start of a segment."""
        self._started = False

    def step(self, x: FloatArray) -> FloatArray:
        """Filter one row (channels,)."""
        y: FloatArray = self.run(x[None])[0]
        return y

    def run(self, x: FloatArray) -> FloatArray:
        """Filter rows (N, channels) one after another, going on from the rows before."""
        y = np.empty(x.shape)
        self._started = _run_sections(
            np.array(x, dtype=np.float64), self._sections, self._at_rest, self._state, self._started, y
        )
        return y


class CausalDerivatives:
    """Filtered position, velocity and acceleration of n joints, sample by sample, on the true time stamps.

    The third-order Butterworth low pass is kept in the form x''' = w^3 (u - x) - 2 w^2 x' - 2 w x'' and integrated by
    the trapezoidal rule over each true time step. The filter's states then are the filtered position, velocity and
    acceleration, with no lag between them; at a uniform rate x equals the bilinear design of CausalButterworth.
    Position, velocity and acceleration that the robot reports itself pass through the same filter; what it does not
    report is taken from the filter of the quantity below.

    It starts at rest. A row with NaN gives NaN and is passed over; a repeated or backward time stamp gives the last
    result again; over dropped samples the input is taken to run straight.

    Args:
        rate: nominal samples a second [Hz], for which the cut-off is exact.
        cutoff: frequency [Hz] of the -3 dB point.
        n: number of joints.

    Raises:
        InputError: the cut-off is not below half the rate.
    """

    def __init__(self, rate: float, cutoff: float, n: int) -> None:
        check_cutoff(rate, cutoff)
        # The pole frequency that the trapezoidal rule maps onto the cut-off.
        self._constants = np.array([2.0 * rate * np.tan(np.pi * cutoff / rate), 1.0 / rate, FORGOTTEN / cutoff])
        self._state = np.zeros((3, 3, n))
        self._last = np.zeros((3, n))
        self._clock = np.zeros(2)
        self._row = np.zeros((3, 1, n))
        self._out = np.zeros((3, 1, n))
        self._time = np.zeros(1)

    @property
    def parts(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """What ``scan_rows`` works on: constants, clock, last row and state, all but the first changed in place."""
        return self._constants, self._clock, self._last, self._state

    def reset(self) -> None:
        """Forget the past, as at the start of a segment."""
        self._clock[0] = 0.0

    def step(
        self, t: float, q: FloatArray, dq: FloatArray | None = None, ddq: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Take one sample and return the filtered position, velocity and acceleration.

        Args:
            t: time stamp [s].
            q, dq, ddq: measured position and, where the robot reports them, its derivatives, each (n,); whether they
                are given must not change between resets.

        Returns:
            q, dq, ddq: [rad or m, s], each (n,).
        """
        self._time[0] = t
        self._row[0, 0] = q
        if dq is not None:
            self._row[1, 0] = dq
        if ddq is not None:
            self._row[2, 0] = ddq
        self._scan(self._time, self._row, dq is not None, ddq is not None, self._out)
        q_out, dq_out, ddq_out = self._out[:, 0].copy()
        return q_out, dq_out, ddq_out

    def run(
        self, t: FloatArray, q: FloatArray, dq: FloatArray | None = None, ddq: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Take rows (N,), (N, n) one after another; the same as ``step`` on each."""
        signals = np.stack([q, q if dq is None else dq, q if ddq is None else ddq])
        out = np.empty(signals.shape)
        self._scan(np.array(t, dtype=np.float64), signals, dq is not None, ddq is not None, out)
        return out[0], out[1], out[2]

    def _scan(self, t: FloatArray, signals: FloatArray, has_dq: bool, has_ddq: bool, out: FloatArray) -> None:
        scan_rows(t, signals, has_dq, has_ddq, *self.parts, out)


def check_cutoff(rate: float, cutoff: float) -> None:
    """Refuse a cut-off that a log of this rate cannot have.

    Raises:
        InputError: the cut-off is not between 0 and half the rate.
    """
    if not 0.0 < cutoff < 0.5 * rate:
        what = f"cut-off of {cutoff:g} Hz at a sampling rate of {rate:g} Hz"
        raise InputError(what, "filter", f"give one between 0 and {0.5 * rate:g} Hz")


@njit(cache=True)
def _run_sections(
    x: FloatArray, sections: FloatArray, at_rest: FloatArray, state: FloatArray, started: bool, y: FloatArray
) -> bool:
    """Second-order sections in direct form II transposed, row by row."""
    for k in range(x.shape[0]):
        if np.isnan(x[k]).any():
            y[k] = np.nan
            continue
        for c in range(x.shape[1]):
            value = x[k, c]
            for s in range(sections.shape[0]):
                if not started:
                    state[s, 0, c] = at_rest[s, 0] * x[k, c]
                    state[s, 1, c] = at_rest[s, 1] * x[k, c]
                out = sections[s, 0] * value + state[s, 0, c]
                state[s, 0, c] = sections[s, 1] * value - sections[s, 4] * out + state[s, 1, c]
                state[s, 1, c] = sections[s, 2] * value - sections[s, 5] * out
                value = out
            y[k, c] = value
        started = True
    return started


@njit(cache=True)
def scan_rows(
    t: FloatArray,
    signals: FloatArray,
    has_dq: bool,
    has_ddq: bool,
    constants: FloatArray,
    clock: FloatArray,
    last: FloatArray,
    state: FloatArray,
    out: FloatArray,
) -> None:
    """Filter rows of q, dq, ddq; ``clock`` is [started, time of the last row taken], ``state`` (signal, order, n)."""
    pole, nominal, forgotten = constants[0], constants[1], constants[2]
    given = (True, has_dq, has_ddq)
    for k in range(t.shape[0]):
        broken = np.isnan(t[k])
        for signal in range(3):
            broken |= given[signal] and np.isnan(signals[signal, k]).any()
        if broken:
            out[:, k] = np.nan
            continue
        step = t[k] - clock[1]
        fresh = clock[0] == 0.0 or step > forgotten
        if fresh or step > 0.0:
            for signal in range(3):
                if fresh:
                    state[signal, 0], state[signal, 1:] = signals[signal, k], 0.0
                elif given[signal]:
                    _advance(state[signal], last[signal], signals[signal, k], step, nominal, pole)
                last[signal] = signals[signal, k]
            clock[0], clock[1] = 1.0, t[k]
        out[0, k] = state[0, 0]
        out[1, k] = state[1, 0] if has_dq else state[0, 1]
        out[2, k] = state[2, 0] if has_ddq else state[1, 1] if has_dq else state[0, 2]


@njit(cache=True)
def _advance(state: FloatArray, last: FloatArray, now: FloatArray, step: float, nominal: float, w: float) -> None:
    """Trapezoidal step of x''' = w^3 (u - x) - 2 w^2 x' - 2 w x'', input straight from ``last`` to ``now``."""
    pieces = max(1, int(np.round(step / nominal)))
    h = 0.5 * step / pieces
    shrink = 1.0 / (1.0 + 2.0 * w * h + 2.0 * w * w * h * h + w * w * w * h * h * h)
    for j in range(state.shape[1]):
        x, v, a = state[0, j], state[1, j], state[2, j]
        for piece in range(pieces):
            u0 = last[j] + (now[j] - last[j]) * piece / pieces
            u1 = last[j] + (now[j] - last[j]) * (piece + 1) / pieces
            jerk = w * w * w * (u0 - x) - 2.0 * w * w * v - 2.0 * w * a
            v_known = v + h * a
            x_known = x + h * v + h * v_known
            pull = w * w * w * (u1 - x_known) - 2.0 * w * w * v_known
            a1 = shrink * (a + h * jerk + h * pull)
            x, v, a = x_known + h * h * a1, v_known + h * a1, a1
        state[0, j], state[1, j], state[2, j] = x, v, a
