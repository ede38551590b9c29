"""What all observers on an identified model share: momentum and the force that drives it, sample by sample."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.causal import FORGOTTEN, CausalDerivatives
from ident.effects.rigid_body import Links, RotorInertia
from ident.errors import InputError
from ident.log import JointLog, Sample
from ident.model import NEWTON_METRE, CurrentModel
from ident.signals import Motion
from observers.drive import OneSampleDrive
from observers.residual import UNUSABLE, Flag, Residual, hold, joint_torque
from observers.stamps import Stamps, usable

SETTLED = 1.5
"""Periods of the cut-off after which the causal filter has forgotten that it started at rest."""

LONGEST_GAP = 10.0
"""Nominal periods without a sample after which an observer of unfiltered motion starts anew."""

ROWS = 65536
"""Rows taken at once, which bound the memory of a run."""


class Signals(NamedTuple):
    """What momentum observers live on, at N usable samples, in force units (current units where gains are unknown).

    Attributes:
        step: time since the sample before [s], (N,); 0 where an observer starts, negative before it may.
        momentum: generalised momentum of links and rotors, (N, n).
        drive: what the model says its rate of change is where nothing touches the robot:
            motor force - friction + C^T dq - gravity, (N, n).
        q: joint positions [rad or m], (N, n).
    """

    step: FloatArray
    momentum: FloatArray
    drive: FloatArray
    q: FloatArray


class ModelBasedObserver(ABC):
    """An observer of the external force f in d(momentum)/dt = drive + f (De Luca and Mattone 2003).

    Everything is linear in the inertial parameters of each joint's own row, so it runs in current units where drive
    gains are unknown, and in N m where they are known. Friction comes from the model, with its memory. Motion and
    current pass the same causal low pass, so that they stay in step; the observer starts once that has settled.

    Args:
        model: identified model.
        filtered: low-pass motion and current at the model's cut-off; without, samples must carry ``dq``.
        rate: nominal samples a second [Hz]; by default the model's.

    Raises:
        InputError: the model's cut-off is not below half the rate.
    """

    state_rows: ClassVar[int] = 3
    """Rows of the observer's own state, one column a joint."""

    def __init__(self, model: CurrentModel, filtered: bool = True, rate: float | None = None) -> None:
        self.model, self.rate = model, rate or model.rate
        forget = FORGOTTEN / model.cutoff if filtered else LONGEST_GAP / self.rate
        self._stamps = Stamps(self.rate, forget, SETTLED / model.cutoff if filtered else 0.0)
        # positions and currents side by side, so that one filter keeps them in step
        self._filter = CausalDerivatives(self.rate, model.cutoff, 2 * model.n) if filtered else None
        self._link_parameters, self._rotor_inertia = model.link_parameters, model.rotor_inertia
        # the model's other effects are asked only where there are any
        self._slips = any(not isinstance(term.effect, (Links, RotorInertia)) for term in model.terms)
        self._online = OneSampleDrive(model, self._stamps, self._filter)
        self._one = Signals(self._online.step, self._online.momentum, self._online.drive, self._online.q)
        self._shape, self._drive_gain = (model.n,), model.gain
        self._flag = 0
        self.reset()

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.n

    @property
    def unit(self) -> str:
        """Unit of the residual current."""
        return self.model.unit

    @property
    def flag(self) -> Flag:
        """What was the matter with the last sample."""
        return Flag(self._flag)

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""
        self._stamps.reset()
        if self._filter is not None:
            self._filter.reset()
        self._memories = self.model.start()
        self._state = np.zeros((self.state_rows, self.n))
        self._last = np.zeros(self.n)

    def step(self, sample: Sample) -> FloatArray:
        """Take one sample and return the residual current (n,).

        Raises:
            InputError: the sample has another number of joints, or no ``dq`` where the observer does not filter.
        """
        dq = sample.dq
        if sample.q.shape != self._shape or sample.current.shape != self._shape:
            what = f"positions of shape {sample.q.shape} and currents of shape {sample.current.shape}"
            raise InputError(what, "sample", f"give {self.n} values, one a joint")
        if dq is None:
            if self._filter is None:
                raise _no_velocity()
        elif dq.shape != self._shape:
            raise InputError(f"velocities of shape {dq.shape}", "sample", f"give {self.n} values, one a joint")
        if self.model.robot.coupling is None:
            self._flag = self._online.take(sample, self._memories)
            if not self._flag & UNUSABLE:
                self._last = self._advance(self._one)[0]
        else:
            # the compiled call knows the joints' forces only
            one = (np.array([sample.t]), sample.q[None], sample.current[None], None if dq is None else dq[None])
            self._flag = int(self._rows(*one)[1][0])
        current: FloatArray = self._last / self._drive_gain
        return current

    def run(self, log: JointLog) -> Residual:
        """Return the residual of a whole log, beginning anew at each of its segments; bounded memory beside it.

        Raises:
            InputError: the observer does not filter and the log has no ``dq``, or has another number of joints.
        """
        if log.n != self.n:
            what = f"{log.n} joints where the model has {self.n}"
            raise InputError(what, f"log {log.name}", "give a log of the model's robot")
        force, flags = np.empty(log.q.shape), np.empty(len(log), dtype=np.int64)
        for segment in log.segments():
            self.reset()
            for first in range(segment.start, segment.stop, ROWS):
                rows = slice(first, min(first + ROWS, segment.stop))
                dq = None if log.dq is None else log.dq[rows]
                force[rows], flags[rows] = self._rows(log.t[rows], log.q[rows], log.current[rows], dq)
        current, gain = force / self.model.gain, known_gain(self.model)
        torque = joint_torque(current, gain, self.model.robot.coupling)
        return Residual(log.t, current, torque, flags, log.segment, self.unit)

    @abstractmethod
    def _advance(self, signals: Signals) -> FloatArray:
        """Go on over rows and return the external force (N, n) in force units; nought where ``step`` is not above 0."""

    def _rows(
        self, t: FloatArray, q: FloatArray, current: FloatArray, dq: FloatArray | None
    ) -> tuple[FloatArray, IntArray]:
        flags, step = self._stamps.scan(t, q, current) if dq is None else self._stamps.scan(t, q, current, dq)
        good = usable(flags)
        if not good.all():
            t, q, current, step = t[good], q[good], current[good], step[good]
            dq = None if dq is None else dq[good]
        if len(t):
            force = self._advance(self._signals(t, q, current, dq, step))
            force = force if len(force) == len(flags) else hold(force, good, self._last)
        else:
            force = np.tile(self._last, (len(flags), 1))
        self._last = force[-1].copy()
        return force, flags

    def _signals(
        self, t: FloatArray, q: FloatArray, current: FloatArray, dq: FloatArray | None, step: FloatArray
    ) -> Signals:
        n = self.n
        ddq = np.zeros_like(q)
        if self._filter is not None:
            both = None if dq is None else np.concatenate([dq, np.zeros_like(dq)], axis=1)
            x, v, a = self._filter.run(t, np.concatenate([q, current], axis=1), both)
            # contiguous, as the compiled loops want them
            q, current, dq, ddq = x[:, :n].copy(), x[:, n:], v[:, :n].copy(), a[:, :n].copy()
        elif dq is None:
            raise _no_velocity()
        terms = self.model.robot.rigid_body.momentum_terms(q, dq, self._link_parameters)
        drive = self.model.gain * current + terms.coriolis_transpose - terms.gravity
        motion = Motion(t, q, dq, ddq)
        if self._slips:
            drive -= self.model.friction(motion, self._memories)
        rotors = self._rotor_inertia * self.model.robot.motors(motion).dq
        return Signals(step, terms.momentum + rotors, drive, q)


def _no_velocity() -> InputError:
    what = "an observer without filters needs measured velocities"
    return InputError(what, "observer", "give logs with dq, or filtered=True")


def known_gain(model: CurrentModel) -> FloatArray | None:
    """Return the drive gains (n,) that a model was identified with or else its robot's card gives; None if unknown.

    Args:
        model: identified model.
    """
    return model.gain if model.force_unit == NEWTON_METRE else model.robot.gain


def per_joint(value: float | FloatArray, n: int, what: str) -> FloatArray:
    """Return one positive value a joint.

    Args:
        value: one for all joints, or one each (n,).
        n: joints.
        what: the value is, with its unit, for the message.

    Raises:
        InputError: there are not n values, or one is not above 0.
    """
    values = np.asarray(value, dtype=np.float64)
    if values.shape not in ((), (n,)) or not np.all(values > 0.0) or not np.all(np.isfinite(values)):
        raise InputError(f"{what} of {value}", "observer", f"give one positive number, or {n} of them")
    return np.broadcast_to(values, (n,)).copy()
