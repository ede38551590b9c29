"""Dry friction that turns, or builds up, between samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.compiled import compiled
from ident.effects.direction import turned_round

MOST_JOINTS = 32
"""Joints for which the memory has room."""


@dataclass(frozen=True, eq=False)
class Turning:
    """Dry friction that turns, or builds up, between samples: the velocity runs straight from one to the next.

    Attributes:
        velocity: velocities (N, k) seen.
        dry: its force (k,).
        turns: speeds (k,) over which it turns [rad/s or m/s].
        presliding, exponent: displacements (k,) over which it builds up instead [rad or m], or nought, and exponents.
    """

    velocity: FloatArray
    dry: FloatArray
    turns: FloatArray
    presliding: FloatArray
    exponent: FloatArray

    def directions(self, t: FloatArray, known: BoolArray, memory: FloatArray) -> FloatArray:
        """Return its directions (N, k) at the samples, from -1 to 1.

        Args:
            t: stamps (N,) [s].
            known: samples (N,) that count; others are passed over.
            memory: last stamp, velocities and directions, brought up to date; the stamp is not known before the first.
        """
        if not self.dry.any():
            return np.zeros_like(self.velocity)
        return _directions(t, self.velocity, known, self.turns, self.presliding, self.exponent, memory)

    def force_at(self, then: FloatArray, t: FloatArray, directions: FloatArray) -> FloatArray:
        """Return its force (M, k) at any instants.

        Args:
            then: the instants (M,) [s].
            t: stamps (N,) of the samples [s].
            directions: its directions (N, k) there.
        """
        if not self.dry.any():
            return np.zeros((len(then), len(self.dry)))
        laws = self.turns, self.presliding, self.exponent
        return np.where(self.dry > 0.0, self.dry * _directions_at(then, t, self.velocity, directions, *laws), 0.0)


@compiled
def turned(
    before: float, start: float, end: float, first: float, last: float, step: float,
    turns: float, presliding: float, exponent: float,
) -> float:  # fmt: skip
    """Return the direction at a share of the way from one sample to the next, from that at a share before.

    Args:
        before: direction at the start, from -1 to 1.
        start: share of the way there.
        end: share of the way at which it is asked.
        first: velocity at the sample before.
        last: velocity at the sample after.
        step: time between them [s].
        turns: speed over which it turns [rad/s or m/s].
        presliding: displacement over which it builds up instead [rad or m], or nought.
        exponent: with which it does.
    """
    if presliding <= 0.0:
        return float(np.tanh((first + end * (last - first)) / turns))
    begun, ended, time = first + start * (last - first), first + end * (last - first), (end - start) * step
    return turned_round(before, 0.5 * (begun + ended) * time, begun, ended, time, presliding, exponent)


@compiled
def _directions(
    t: FloatArray, velocity: FloatArray, known: BoolArray, turns: FloatArray, presliding: FloatArray,
    exponent: FloatArray, memory: FloatArray,
) -> FloatArray:  # fmt: skip
    """See `Turning.directions`."""
    rows, joints = velocity.shape
    out = np.zeros((rows, joints))
    speeds, states = memory[1:], memory[1 + MOST_JOINTS :]
    for k in range(rows):
        if known[k]:
            step = 0.0 if np.isnan(memory[0]) else t[k] - memory[0]
            for j in range(joints):
                first, now = speeds[j] if step > 0.0 else velocity[k, j], velocity[k, j]
                states[j] = turned(states[j], 0.0, 1.0, first, now, step, turns[j], presliding[j], exponent[j])
                speeds[j] = now
            memory[0] = t[k]
        out[k] = states[:joints]
    return out


@compiled
def _directions_at(
    then: FloatArray, t: FloatArray, velocity: FloatArray, directions: FloatArray,
    turns: FloatArray, presliding: FloatArray, exponent: FloatArray,
) -> FloatArray:  # fmt: skip
    """See `Turning.force_at`; at the ends directions stay as they are."""
    joints = velocity.shape[1]
    out = np.empty((len(then), joints))
    for m, after in enumerate(np.searchsorted(t, then)):
        if after == 0 or after == len(t):
            out[m] = directions[min(after, len(t) - 1)]
            continue
        step = t[after] - t[after - 1]
        way = (then[m] - t[after - 1]) / step
        for j in range(joints):
            first, last, state = velocity[after - 1, j], velocity[after, j], directions[after - 1, j]
            out[m, j] = turned(state, 0.0, way, first, last, step, turns[j], presliding[j], exponent[j])
    return out
