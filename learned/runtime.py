"""Networks at run time: compiled, without torch, microseconds a sample.

All weights lie in one float32 block and are read once a sample, layer by layer, row by row; rows whose input is zero
(half of what a ReLU leaves) are skipped. Whole logs go through the very same loops, so that step by step and whole log
give the same bits: the sums are formed in the same order, in float32, and only the sum over hierarchies is float64.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled, over_rows
from learned.alignment import aligned
from learned.model_file import TrainedModel
from learned.motion_discriminator import MEDIAN_SAMPLES, MotionDiscriminator, scan
from learned.window import Frames, complete, pad


@compiled
def add_product(x: Any, y: Any, weights: Any, first: int, used: Any) -> None:
    """Add ``x @ W`` to ``y``, W (len(x), len(y)) lying in ``weights`` from ``first``; ``used`` is room for indices.

    Each sum is formed in the order of x, eight rows of W at a time; rows that meet a zero are left out.
    """
    columns = len(y)
    n = 0
    for k in range(len(x)):
        used[n] = k
        n += x[k] != 0.0
    whole = n - n % 8
    for c in range(0, whole, 8):
        k0, k1, k2, k3 = used[c], used[c + 1], used[c + 2], used[c + 3]
        k4, k5, k6, k7 = used[c + 4], used[c + 5], used[c + 6], used[c + 7]
        x0, x1, x2, x3, x4, x5, x6, x7 = x[k0], x[k1], x[k2], x[k3], x[k4], x[k5], x[k6], x[k7]
        w0, w1 = weights[first + k0 * columns :], weights[first + k1 * columns :]
        w2, w3 = weights[first + k2 * columns :], weights[first + k3 * columns :]
        w4, w5 = weights[first + k4 * columns :], weights[first + k5 * columns :]
        w6, w7 = weights[first + k6 * columns :], weights[first + k7 * columns :]
        for j in range(columns):
            early = y[j] + x0 * w0[j] + x1 * w1[j] + x2 * w2[j] + x3 * w3[j]
            y[j] = early + x4 * w4[j] + x5 * w5[j] + x6 * w6[j] + x7 * w7[j]
    for c in range(whole, n):
        value = x[used[c]]
        row = weights[first + used[c] * columns :]
        for j in range(columns):
            y[j] += value * row[j]


@compiled
def evaluate(program: Any, weights: Any, work: Any, used: Any) -> None:
    """Fill the work vector layer by layer; the rows of ``program`` are those of ``Graph.program``."""
    zero = np.float32(0.0)
    for layer in range(len(program)):
        row = program[layer]
        a, a_size, b, b_size, start, size = row[0], row[1], row[2], row[3], row[4], row[5]
        first, bias, relu, skip = row[6], row[7], row[8], row[9]
        y = work[start : start + size]
        if bias >= 0:
            y[:] = weights[bias : bias + size]
        else:
            y[:] = zero
        if skip >= 0:
            y += work[skip : skip + size]
        add_product(work[a : a + a_size], y, weights, first, used)
        if b_size > 0:
            add_product(work[b : b + b_size], y, weights, first + a_size * size, used)
        if relu > 0:
            for j in range(size):
                y[j] = max(y[j], zero)


@compiled
def collect(work: Any, outputs: Any, gain: Any, offset: Any, out: Any) -> None:
    """Add up the hierarchies' results in the unit of the current."""
    for joint in range(len(out)):
        total = offset[joint]
        for h in range(len(outputs)):
            total += gain[h, joint] * work[outputs[h] + joint]
        out[joint] = total


@compiled
def _evaluate_rows(
    program: Any,
    weights: Any,
    width: int,
    outputs: Any,
    gain: Any,
    offset: Any,
    frames: Any,
    starts: Any,
    held: Any,
    out: Any,
) -> None:
    """Evaluate rows whose windows start at ``starts`` in the flat ``frames`` and whose discriminator is ``held``."""
    work = np.zeros(width, dtype=np.float32)
    used = np.zeros(width, dtype=np.int64)
    window = program[0, 1]
    for k in range(len(starts)):
        work[:window] = frames[starts[k] : starts[k] + window]
        work[window : window + held.shape[1]] = held[k]
        evaluate(program, weights, work, used)
        collect(work, outputs, gain, offset, out[k])


@compiled
def _step(
    motion: Any,
    thresholds: Any,
    mode: Any,
    state: Any,
    ring: Any,
    row: Any,
    scales: Any,
    program: Any,
    weights: Any,
    work: Any,
    used: Any,
    counters: Any,
    outputs: Any,
    gain: Any,
    offset: Any,
    out: Any,
) -> None:
    """Take one sample of motion (3, 1, n): discriminator, window, scaling, layers, sum.

    ``counters`` holds whether a frame has been seen, and for how many samples the window holds an unknown one.
    """
    n = motion.shape[2]
    frame = 3 * n
    window = program[0, 1]
    scan(motion[0], motion[1], thresholds, mode, state, ring, row)
    known = True
    for c in range(3):
        for joint in range(n):
            known = known and np.isfinite(motion[c, 0, joint])
    if not known:
        counters[1] = window // frame
    if counters[0] > 0:
        for k in range(window - frame):
            work[k] = work[k + frame]
    for c in range(3):
        for joint in range(n):
            k = c * n + joint
            work[window - frame + k] = np.float32((motion[c, 0, joint] - scales[0, k]) * scales[1, k])
    if counters[0] == 0 and known:
        counters[0] = 1
        counters[1] = 0
        for k in range(window - frame):
            work[k] = work[window - frame + k % frame]
    place = window
    for i in range(row.shape[1]):
        for joint in range(n):
            k = frame + i * n + joint
            work[place] = np.float32((row[0, i, joint] - scales[0, k]) * scales[1, k])
            place += 1
    if counters[1] > 0:
        counters[1] -= 1
        out[:] = np.nan
        return
    evaluate(program, weights, work, used)
    collect(work, outputs, gain, offset, out)


class DenseRuntime:
    """Evaluates the dense networks of a trained model on causal motion at the model's rate."""

    def __init__(self, trained: TrainedModel) -> None:
        self._trained = trained
        self._memory = trained.architecture.memory
        graph = trained.architecture.stacked()
        self._program, self._weights, self._work, self._outputs = aligned(graph, trained.weights)
        self._gain, self._offset = trained.output_gain.copy(), trained.output_offset.copy()
        n = trained.architecture.frame // 3
        self._discriminator = MotionDiscriminator(trained.discriminator, n)
        scalings = (trained.frame_scaling, trained.held_scaling)
        self._scales = np.stack(
            [np.concatenate([s.mean for s in scalings]), np.concatenate([s.gain for s in scalings])]
        )
        self._used = np.zeros(len(self._work), dtype=np.int64)
        self._counters = np.zeros(2, dtype=np.int64)
        self._row = np.zeros((1, trained.discriminator.rows(n), n))
        self._ring = np.zeros((MEDIAN_SAMPLES, n))
        self._motion = np.zeros((3, 1, n))
        self._out = np.zeros(trained.architecture.n)

    def reset(self) -> None:
        """Forget all memory, as at the start of a segment."""
        self._discriminator.reset()
        self._counters[:] = 0

    def step(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """Predict the current (n,) from one sample of filtered motion; NaN while an unknown frame is remembered."""
        held = self._discriminator
        motion = self._motion
        motion[0, 0], motion[1, 0], motion[2, 0] = q, dq, ddq
        _step(
            motion, held.thresholds, held.mode, held.state, held.ring, self._row, self._scales, self._program,
            self._weights, self._work, self._used, self._counters, self._outputs, self._gain, self._offset, self._out,
        )  # fmt: skip
        return self._out.copy()

    def run(self, frames: Frames) -> FloatArray:
        """Predict the current (N, n) of a whole log's frames."""
        trained = self._trained
        padded, place = pad(frames.channels, frames.segments, frames.finite, self._memory)
        scaled = trained.frame_scaling.apply(padded)
        held = MotionDiscriminator(trained.discriminator, self._discriminator.n).run(
            frames.motion.q, frames.motion.dq, frames.segments
        )
        rows = len(held)
        starts = (place - (self._memory - 1)) * scaled.shape[1]
        out = np.zeros((rows, len(self._out)))
        fixed = (self._program, self._weights, len(self._work), self._outputs, self._gain, self._offset, scaled.ravel())
        over_rows(_evaluate_rows, fixed, starts, trained.held_scaling.apply(held.reshape(rows, -1)), out)
        out[~complete(frames.finite, frames.segments, self._memory)] = np.nan
        return out
