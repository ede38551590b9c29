"""The stiff position loop of a prescribed motion: commands in, the motion the joints really make out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled


@compiled
def _follow(
    reference: FloatArray,
    substeps: int,
    dt: float,
    bandwidth: FloatArray,
    damping: FloatArray,
    feedforward: FloatArray,
    knots: FloatArray,
    error: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    rows, n = reference.shape
    q = np.empty((rows * substeps, n))
    dq = np.empty((rows * substeps, n))
    ddq = np.empty((rows * substeps, n))
    period = dt * substeps
    for j in range(n):
        w, z = bandwidth[j], damping[j]
        wd = w * math.sqrt(1.0 - z * z)
        decay, cosine, sine = math.exp(-z * w * dt), math.cos(wd * dt), math.sin(wd * dt) / wd
        p0, p1, p2, p3 = knots[0, j], knots[1, j], knots[2, j], knots[3, j]
        e, de = error[0, j], error[1, j]
        for k in range(rows):
            p0, p1, p2, p3 = p1, p2, p3, reference[k, j]
            for s in range(substeps):
                u = (s + 1) / substeps
                v = 1.0 - u
                r = (v**3 * p0 + (3 * u**3 - 6 * u**2 + 4) * p1 + (3 * v**3 - 6 * v**2 + 4) * p2 + u**3 * p3) / 6
                dr = (-(v**2) * p0 + (3 * u**2 - 4 * u) * p1 + (4 * v - 3 * v**2) * p2 + u**2 * p3) / (2 * period)
                ddr = (v * p0 + (3 * u - 2) * p1 + (3 * v - 2) * p2 + u * p3) / period**2
                push = -(1.0 - feedforward[j]) * ddr
                rest = push / (w * w)
                offset = e - rest
                slope = de
                e = rest + decay * (offset * cosine + (slope + z * w * offset) * sine)
                de = decay * (slope * cosine - (z * w * slope + w * w * offset) * sine)
                row = k * substeps + s
                q[row, j] = r + e
                dq[row, j] = dr + de
                ddq[row, j] = ddr + push - w * w * e - 2.0 * z * w * de
        knots[0, j], knots[1, j], knots[2, j], knots[3, j] = p0, p1, p2, p3
        error[0, j], error[1, j] = e, de
    return q, dq, ddq


@dataclass
class PositionLoop:
    """A position servo whose tracking error is a lightly damped second-order answer to acceleration.

    The commands are joined by a uniform cubic B-spline (twice differentiable, one sample late, as a controller's own
    interpolation is). The error ``e`` of the joint behind it obeys ``e'' + 2 z w e' + w^2 e = -(1 - f) r''`` with
    bandwidth ``w`` [rad/s], damping ratio ``z < 1`` and acceleration feed-forward ``f``, solved exactly step by step:
    the joint lags while it accelerates, and its velocity rings when it stops.
    """

    bandwidth: FloatArray
    damping: FloatArray
    feedforward: FloatArray
    substeps: int
    dt: float

    def reset(self, q: FloatArray) -> None:
        """Stand still at ``q`` (n,)."""
        self._knots = np.tile(q, (4, 1))
        self._error = np.zeros((2, len(q)))

    def follow(self, reference: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position, velocity and acceleration, each (N * substeps, n), for commands ``reference`` (N, n)."""
        commands = np.ascontiguousarray(reference, dtype=np.float64)
        return _follow(
            commands, self.substeps, self.dt, self.bandwidth, self.damping, self.feedforward, self._knots, self._error
        )
