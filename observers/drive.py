"""Momentum and what drives it at one sample, in one compiled call: the online path of all observers."""

from __future__ import annotations

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.link_motion import Chain
from ident.rigid_body_kernels import momentum_rows


@compiled
def drive_row(
    chain: Chain,
    gravity: FloatArray,
    parameters: FloatArray,
    rotor_inertia: FloatArray,
    gain: FloatArray,
    q: FloatArray,
    dq: FloatArray,
    current: FloatArray,
    terms: FloatArray,
    momentum: FloatArray,
    drive: FloatArray,
) -> None:
    """Write momentum of links and rotors, and motor force + C^T dq - gravity, each (1, n).

    ``parameters`` (n, 10 n), ``rotor_inertia`` and ``gain`` (n,) are the model's; ``q`` and ``dq`` (1, n), ``current``
    (n,) the sample's; ``terms`` (1, 3, n) is room to work in.
    """
    momentum_rows(chain, gravity, parameters, q, dq, terms)
    for j in range(q.shape[1]):
        momentum[0, j] = terms[0, 0, j] + rotor_inertia[j] * dq[0, j]
        drive[0, j] = gain[j] * current[j] + terms[0, 1, j] - terms[0, 2, j]
