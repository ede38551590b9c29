"""The logs that estimators are compared on, and what is true of their rows whoever estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.signal

from comparisons.metrics import Regimes, touches
from ident.arrays import BoolArray, FloatArray
from ident.cutoff import choose_cutoff
from ident.errors import InputError
from ident.log import JointLog, LogSource, concatenate
from ident.signals import derive
from learned.motion_discriminator import known_history


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Test logs, in memory, end to end.

    Attributes:
        logs: the logs.
        whole: all of them as one log.
        regimes: what each joint does at each row of ``whole``.
        touched: rows of ``whole`` in which the true external torque tells a touch.
        cutoff: of the filter [Hz] behind the velocities that regimes are told by.
    """

    logs: tuple[JointLog, ...]
    whole: JointLog
    regimes: Regimes
    touched: BoolArray
    cutoff: float

    @staticmethod
    def of(sources: Sequence[LogSource]) -> HeldOut:
        """Read the logs and tell their regimes, from velocities without lag.

        Raises:
            InputError: two logs have the same name, so that their predictions would have, or there is none.
        """
        names = [source.name for source in sources]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"two test logs are named {name}", "--test", "rename one of them")
        logs = tuple(source.read() for source in sources)
        cutoff = choose_cutoff(logs[0]).hertz
        parts = [_judged(log, min(cutoff, 0.4 * log.rate)) for log in logs]
        velocity = np.concatenate([part[0] for part in parts])
        touched, free = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
        whole = concatenate(list(logs))
        known = known_history(whole.q, whole.segments())
        regimes = Regimes.of(whole.t, velocity, whole.segment, known, free)
        return HeldOut(logs, whole, regimes, touched, cutoff)

    @property
    def rows(self) -> list[slice]:
        """Rows of each log in ``whole``."""
        ends = np.cumsum([len(log) for log in self.logs]).tolist()
        return [slice(end - len(log), end) for log, end in zip(self.logs, ends, strict=True)]


def _judged(log: JointLog, cutoff: float) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Velocities (N, n) of a log, and its rows (N,) that are touched and that are free."""
    velocity = derive(log, cutoff).dq
    touched: BoolArray = np.zeros(len(log), dtype=np.bool_)
    free: BoolArray = np.ones(len(log), dtype=np.bool_)
    if log.tau_ext is not None:
        touched, free = touches(log.t, log.tau_ext, log.segment)
    return velocity, touched, free


def low_pass(values: FloatArray, log: JointLog, bandwidth: float) -> FloatArray:
    """Pass values (N, n) through the first-order low pass that a momentum observer is, [Hz]; NaN rows hold it.

    It begins each segment at the first value there.
    """
    leaves = -np.expm1(-2.0 * np.pi * bandwidth / log.rate)
    out = np.full(values.shape, np.nan)
    good: BoolArray = np.asarray(np.isfinite(values).all(axis=1))
    for segment in log.segments():
        rows = segment.start + np.flatnonzero(good[segment])
        if len(rows):
            start = (1.0 - leaves) * values[rows[:1]]
            out[rows] = scipy.signal.lfilter([leaves], [1.0, leaves - 1.0], values[rows], axis=0, zi=start)[0]
    return out
