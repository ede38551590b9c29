"""From one sample to momentum and what drives it, in one compiled call: the online path of all observers."""

from __future__ import annotations

import numpy as np

from ident.arrays import BoolArray, FloatArray, IntArray
from ident.causal import CausalDerivatives, scan_rows
from ident.compiled import compiled
from ident.effects.rigid_body import RotorInertia
from ident.link_motion import Chain
from ident.log import Sample
from ident.model import CurrentModel
from ident.online_friction import Memories, OneSample, add_terms
from ident.rigid_body_kernels import inverse_dynamics_rows, momentum_rows
from ident.signals import Motion
from observers.residual import UNUSABLE
from observers.stamps import Stamps, judge

_Q, _DQ, _DDQ, _LOAD, _FRICTION, _MOMENTUM, _DRIVE, _ROWS = range(8)


class OneSampleDrive:
    """Time step, momentum and drive of an observer at one sample after another.

    It shares stamps and filter with the path over whole logs, so that either goes on where the other stopped.

    Args:
        model: identified model.
        stamps: that flag samples and measure time steps.
        filters: low pass of positions and currents side by side, or None for samples as they come.

    Attributes:
        step: time since the sample before [s], (1,); see ``Stamps``.
        q, momentum, drive: of the last usable sample, (1, n), written anew by each; see ``Signals``.
    """

    def __init__(self, model: CurrentModel, stamps: Stamps, filters: CausalDerivatives | None) -> None:
        self._model, n = model, model.n
        # where the compiled loop does not know all terms, the model is asked for all friction
        self._by_columns = bool(model.one_sample.others)
        friction = [term for term in model.terms if not self._by_columns and not isinstance(term.effect, RotorInertia)]
        table = OneSample(friction, model.robot)
        body = model.robot.rigid_body
        rows = np.zeros((_ROWS, n))
        # without a filter its place is taken by arrays of the same kind that nothing reads
        parts = CausalDerivatives(model.rate, model.cutoff, 2 * n).parts if filters is None else filters.parts
        self._fixed = (
            *body.chain,
            body.multibody.gravity,
            model.link_parameters,
            np.stack([model.gain, model.rotor_inertia]),
            *stamps.parts,
            filters is not None,
            *parts,
            *table.table,
            table.asks_load,
            rows,
            np.zeros((6, 1, 2 * n)),
        )
        self.step = np.empty(1)
        self._dq, self._ddq = rows[_DQ : _DQ + 1], rows[_DDQ : _DDQ + 1]
        self.q, self.momentum, self.drive = (rows[k : k + 1] for k in (_Q, _MOMENTUM, _DRIVE))

    def take(self, sample: Sample, memories: Memories) -> int:
        """Take one sample, carrying the memories of friction forward, and return its flags."""
        q, dq = sample.q, sample.dq
        flags, self.step[0] = take_sample(
            *self._fixed, memories.flat, sample.t, q, q if dq is None else dq, dq is not None, sample.current
        )
        if self._by_columns and not flags & UNUSABLE:
            motion = Motion(np.array([sample.t]), self.q, self._dq, self._ddq)
            self.drive -= self._model.friction(motion, memories)
        return flags


@compiled
def take_sample(
    order: IntArray,
    parent: IntArray,
    prismatic: BoolArray,
    axis: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    supports: BoolArray,
    gravity: FloatArray,
    parameters: FloatArray,
    motors: FloatArray,
    limits: FloatArray,
    clock: FloatArray,
    filtered: bool,
    constants: FloatArray,
    filter_clock: FloatArray,
    last: FloatArray,
    state: FloatArray,
    entries: IntArray,
    values: FloatArray,
    asks_load: bool,
    rows: FloatArray,
    signals: FloatArray,
    memory: FloatArray,
    t: float,
    q: FloatArray,
    dq: FloatArray,
    has_dq: bool,
    current: FloatArray,
) -> tuple[int, float]:
    """Judge a sample and, where it can be used, write its motion, momentum and drive into ``rows``.

    The first seven are the fields of ``Chain``: passed one by one they cost a quarter of what they cost together.
    ``motors`` (2, n) is gain and rotor inertia; ``signals`` (6, 1, 2 n) room for the filter's input and output.
    Momentum is that of links and rotors; drive is motor force + C^T dq - gravity - the friction of the table.
    """
    n = len(q)
    flags, step = judge(t, np.isfinite(t) and _finite(q, dq, current), limits, clock)
    if flags & UNUSABLE:
        return flags, step
    _move(t, q, dq, has_dq, current, filtered, constants, filter_clock, last, state, signals, rows)
    chain = Chain(order, parent, prismatic, axis, rotation, translation, supports)
    at, speed, terms = rows[_Q : _Q + 1], rows[_DQ : _DQ + 1], np.empty((1, 3, n))
    momentum_rows(chain, gravity, parameters, at, speed, terms)
    if asks_load:
        acceleration, load = rows[_DDQ : _DDQ + 1], rows[_LOAD : _LOAD + 1]
        inverse_dynamics_rows(chain, gravity, parameters, order, at, speed, acceleration, load)
    rows[_FRICTION] = 0.0
    add_terms(entries, values, t, rows[_Q], rows[_DQ], rows[_DDQ], rows[_LOAD], memory, rows[_FRICTION])
    for j in range(n):
        rows[_MOMENTUM, j] = terms[0, 0, j] + motors[1, j] * rows[_DQ, j]
        rows[_DRIVE, j] = motors[0, j] * rows[_DRIVE, j] + terms[0, 1, j] - terms[0, 2, j] - rows[_FRICTION, j]
    return flags, step


@compiled
def _finite(q: FloatArray, dq: FloatArray, current: FloatArray) -> bool:
    finite = True
    for j in range(len(q)):
        finite &= np.isfinite(q[j]) and np.isfinite(dq[j]) and np.isfinite(current[j])
    return finite


@compiled
def _move(
    t: float,
    q: FloatArray,
    dq: FloatArray,
    has_dq: bool,
    current: FloatArray,
    filtered: bool,
    constants: FloatArray,
    clock: FloatArray,
    last: FloatArray,
    state: FloatArray,
    signals: FloatArray,
    rows: FloatArray,
) -> None:
    """Write position, velocity and acceleration into their rows, and the current into that of the drive."""
    n = len(q)
    if not filtered:
        for j in range(n):
            rows[_Q, j], rows[_DQ, j], rows[_DDQ, j], rows[_DRIVE, j] = q[j], dq[j], 0.0, current[j]
        return
    for j in range(n):
        signals[0, 0, j], signals[0, 0, n + j] = q[j], current[j]
        signals[1, 0, j] = dq[j]
    scan_rows(np.full(1, t), signals[:3], has_dq, False, constants, clock, last, state, signals[3:])
    for j in range(n):
        rows[_Q, j], rows[_DQ, j], rows[_DDQ, j] = signals[3, 0, j], signals[4, 0, j], signals[5, 0, j]
        rows[_DRIVE, j] = signals[3, 0, n + j]
