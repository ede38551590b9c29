"""The residual of any predictor of the motor current."""

from __future__ import annotations

import dataclasses

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.causal import FORGOTTEN, CausalDerivatives
from ident.coupling import Coupling
from ident.errors import InputError
from ident.log import JointLog, Sample
from ident.predictor import CurrentPredictor
from observers.model_based import SETTLED
from observers.residual import Flag, Residual, hold, joint_torque
from observers.stamps import Stamps, usable


class DirectEstimator:
    """Predicted minus measured current: what the motors need not carry because the world does, positive along +q.

    Args:
        predictor: an identified model, a network, or anything else that predicts the current.
        rate: nominal samples a second [Hz].
        cutoff: low pass on the measured current [Hz], to keep it in step with a predictor that filters motion: for
            a CurrentModel its ``cutoff``; None takes the current as it comes, as networks learn it.
        gain: torque per unit of current (n,) on the joint's side, where known.
        coupling: of the motors, if gears couple joints.

    Raises:
        InputError: the cut-off is not below half the rate.
    """

    def __init__(
        self,
        predictor: CurrentPredictor,
        rate: float,
        cutoff: float | None = None,
        gain: FloatArray | None = None,
        coupling: Coupling | None = None,
    ) -> None:
        self.predictor, self.gain, self.coupling = predictor, gain, coupling
        settle = (np.inf, 0.0) if cutoff is None else (FORGOTTEN / cutoff, SETTLED / cutoff)
        self._stamps = Stamps(rate, *settle)
        self._filter = None if cutoff is None else CausalDerivatives(rate, cutoff, predictor.n)
        self.flag = Flag.GOOD
        self.reset()

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.predictor.n

    @property
    def unit(self) -> str:
        """Unit of the residual current."""
        return self.predictor.unit

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""
        self._stamps.reset()
        self.predictor.reset()
        if self._filter is not None:
            self._filter.reset()
        self._last = np.zeros(self.n)

    def step(self, sample: Sample) -> FloatArray:
        """Take one sample and return the residual current (n,)."""
        values = [x[None] for x in (sample.q, sample.current, sample.dq) if x is not None]
        flags, _ = self._stamps.scan(np.array([sample.t]), *values)
        self.flag = Flag(int(flags[0]))
        if not usable(flags)[0]:
            return self._last.copy()
        current = sample.current
        if self._filter is not None:
            current = self._filter.step(sample.t, current)[0]
        residual = self.predictor.step(sample) - current
        if self.flag & Flag.SETTLING:
            self._last = np.zeros(self.n)
        elif np.isfinite(residual).all():
            self._last = residual
        else:
            self.flag |= Flag.SETTLING
        return self._last.copy()

    def run(self, log: JointLog) -> Residual:
        """Return the residual of a whole log, beginning anew at each of its segments.

        Raises:
            InputError: the log has another number of joints.
        """
        if log.n != self.n:
            what = f"{log.n} joints where the predictor has {self.n}"
            raise InputError(what, f"log {log.name}", "give a log of the predictor's robot")
        flags = np.empty(len(log), dtype=np.int64)
        for segment in log.segments():
            self.reset()
            values = [x[segment] for x in (log.q, log.current, log.dq) if x is not None]
            flags[segment], _ = self._stamps.scan(log.t[segment], *values)
        kept = usable(flags)
        clean = _rows(log, kept)
        residual = self.predictor.predict(clean, causal=True) - self._smooth(clean)
        residual[(flags[kept] & int(Flag.SETTLING)) != 0] = 0.0
        own = np.flatnonzero(kept)
        known = np.isfinite(residual).all(axis=1)
        flags[own[~known]] |= int(Flag.SETTLING)
        kept[own[~known]] = False
        spread = np.zeros(log.q.shape)
        spread[kept] = residual[known]
        current = np.empty(log.q.shape)
        for segment in log.segments():
            rows = kept[segment]
            current[segment] = hold(spread[segment][rows], rows, np.zeros(self.n))
        torque = joint_torque(current, self.gain, self.coupling)
        return Residual(log.t, current, torque, flags, log.segment, self.unit)

    def _smooth(self, log: JointLog) -> FloatArray:
        if self._filter is None:
            return log.current
        current = np.empty(log.current.shape)
        for segment in log.segments():
            self._filter.reset()
            current[segment] = self._filter.run(log.t[segment], log.current[segment])[0]
        return current


def _rows(log: JointLog, kept: BoolArray) -> JointLog:
    """Return the kept rows of a log."""
    if kept.all():
        return log
    arrays = {f.name: getattr(log, f.name) for f in dataclasses.fields(log)}
    return log.replace(**{k: v[kept] for k, v in arrays.items() if isinstance(v, np.ndarray)})
