"""Compiled loops over motion samples: what ``rigid_body`` offers, each written into ``out``.

Shapes: q, dq, ddq (N, n); gravity (3,); parameters (n, 10 n), row j for joint j. Change ``link_motion`` and this
file's compiled cache is stale: numba looks only at the file it compiled, so touch this one too.
"""

from __future__ import annotations

from ident.arrays import FloatArray, IntArray
from ident.compiled import compiled
from ident.link_motion import (
    Chain,
    Work,
    accelerations,
    at_rest,
    bias,
    carry,
    force_row,
    momentum_row,
    place,
    room,
    unit_twist,
    value,
    velocities,
    weight_row,
)


@compiled
def _move(chain: Chain, q: FloatArray, dq: FloatArray, ddq: FloatArray, gravity: FloatArray, work: Work) -> None:
    place(chain, q, work)
    velocities(chain, dq, work)
    accelerations(chain, dq, ddq, gravity, work)


@compiled
def regressor_rows(
    chain: Chain, gravity: FloatArray, q: FloatArray, dq: FloatArray, ddq: FloatArray, out: FloatArray
) -> None:
    """Regressor Y with torque = Y @ parameters; ``out`` (N, n, 10 n) must hold zeros."""
    n = q.shape[1]
    work = room(n)
    for t in range(len(q)):
        _move(chain, q[t], dq[t], ddq[t], gravity, work)
        for j in range(n):
            unit_twist(chain, j, work.twist)
            for k in chain.order:
                if chain.supports[j, k]:
                    if k != j:
                        carry(chain, k, work, work.twist)
                    force_row(k, work, out[t, j, 10 * k : 10 * k + 10])


@compiled
def inverse_dynamics_rows(
    chain: Chain,
    gravity: FloatArray,
    parameters: FloatArray,
    joints: IntArray,
    q: FloatArray,
    dq: FloatArray,
    ddq: FloatArray,
    out: FloatArray,
) -> None:
    """Torques of some joints, ``out`` (N, n)."""
    n = q.shape[1]
    work = room(n)
    for t in range(len(q)):
        _move(chain, q[t], dq[t], ddq[t], gravity, work)
        for j in joints:
            unit_twist(chain, j, work.twist)
            total = 0.0
            for k in chain.order:
                if chain.supports[j, k]:
                    if k != j:
                        carry(chain, k, work, work.twist)
                    force_row(k, work, work.row)
                    total += value(work.row, parameters, j, k, 10)
            out[t, j] = total


@compiled
def momentum_rows(
    chain: Chain, gravity: FloatArray, parameters: FloatArray, q: FloatArray, dq: FloatArray, out: FloatArray
) -> None:
    """Generalised momentum M dq, C^T dq and gravity torque, ``out`` (N, 3, n)."""
    n = q.shape[1]
    work = room(n)
    row = work.row
    for t in range(len(q)):
        place(chain, q[t], work)
        velocities(chain, dq[t], work)
        at_rest(chain, gravity, work)
        for j in range(n):
            unit_twist(chain, j, work.twist)
            bias(j, work)
            momentum, coriolis, weight = 0.0, 0.0, 0.0
            for k in chain.order:
                if chain.supports[j, k]:
                    if k != j:
                        carry(chain, k, work, work.twist)
                        carry(chain, k, work, work.bias)
                    momentum_row(work.twist, k, work, row)
                    momentum += value(row, parameters, j, k, 10)
                    momentum_row(work.bias, k, work, row)
                    coriolis += value(row, parameters, j, k, 10)
                    weight_row(k, work, row)
                    weight += value(row, parameters, j, k, 4)
            out[t, 0, j], out[t, 1, j], out[t, 2, j] = momentum, coriolis, weight


@compiled
def mass_matrix_rows(chain: Chain, parameters: FloatArray, q: FloatArray, out: FloatArray) -> None:
    """Joint-space inertia matrix, row j from row j of the parameters; ``out`` (N, n, n) must hold zeros."""
    n = q.shape[1]
    work = room(n)
    for t in range(len(q)):
        place(chain, q[t], work)
        for j in range(n):
            # every link moves as if joint j alone turned at unit speed; only the links it carries do move
            unit_twist(chain, j, work.twist)
            for k in chain.order:
                if chain.supports[j, k]:
                    if k != j:
                        carry(chain, k, work, work.twist)
                    for c in range(3):
                        work.omega[k, c], work.velocity[k, c] = work.twist[k, c], work.twist[k, 3 + c]
            for i in range(n):
                unit_twist(chain, i, work.bias)
                for k in chain.order:
                    if chain.supports[i, k]:
                        if k != i:
                            carry(chain, k, work, work.bias)
                        if chain.supports[j, k]:
                            momentum_row(work.bias, k, work, work.row)
                            out[t, i, j] += value(work.row, parameters, i, k, 10)
