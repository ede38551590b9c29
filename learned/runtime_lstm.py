"""The LSTM baseline at run time: compiled, without torch, the last 100 frames from an empty state at every sample.

What a frame puts into the gates does not depend on the state, so it is computed once a frame and remembered; only the
product with the state is repeated for each frame of the window.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled, over_rows
from learned.model_file import TrainedModel
from learned.runtime import add_product
from learned.window import Frames, complete, pad


@compiled
def _gates(frame: Any, weights: Any, layout: Any, hidden: Any, used: Any, gates: Any) -> None:
    """Encode one scaled frame and put it through the cells' input matrix."""
    width = len(hidden)
    hidden[:] = weights[layout[1] : layout[1] + width]
    add_product(frame, hidden, weights, layout[0], used)
    for k in range(width):
        hidden[k] = max(hidden[k], np.float32(0.0))
    gates[:] = weights[layout[3] : layout[3] + 4 * width]
    gates += weights[layout[5] : layout[5] + 4 * width]
    add_product(hidden, gates, weights, layout[2], used)


@compiled
def _sigmoid(x: Any) -> Any:
    return np.float32(1.0) / (np.float32(1.0) + np.exp(-x))


@compiled
def _last_output(gates: Any, first: int, weights: Any, layout: Any, used: Any, state: Any, y: Any) -> None:
    """Run the cells over a ring of gate inputs, the oldest at ``first``, and decode the last state into ``y``.

    ``state`` (6, width) is room for the hidden state, the cell and the four gates.
    """
    frames, width = len(gates), state.shape[1]
    state[:2] = np.float32(0.0)
    hidden, cell = state[0], state[1]
    room = state[2:6].reshape(4 * width)
    for m in range(frames):
        room[:] = gates[(first + m) % frames]
        add_product(hidden, room, weights, layout[4], used)
        for k in range(width):
            keep, take = _sigmoid(room[width + k]), _sigmoid(room[k])
            cell[k] = keep * cell[k] + take * np.tanh(room[2 * width + k])
            hidden[k] = _sigmoid(room[3 * width + k]) * np.tanh(cell[k])
    decoded = state[1]
    decoded[:] = weights[layout[7] : layout[7] + width]
    add_product(hidden, decoded, weights, layout[6], used)
    for k in range(width):
        decoded[k] = max(decoded[k], np.float32(0.0))
    y[:] = weights[layout[9] : layout[9] + len(y)]
    add_product(decoded, y, weights, layout[8], used)


@compiled
def _encode_rows(weights: Any, layout: Any, width: int, frames: Any, gates: Any) -> None:
    """Gate inputs of every frame."""
    hidden = np.zeros(width, dtype=np.float32)
    used = np.zeros(max(width, frames.shape[1]), dtype=np.int64)
    for k in range(len(frames)):
        _gates(frames[k], weights, layout, hidden, used, gates[k])


@compiled
def _output_rows(gates: Any, weights: Any, layout: Any, width: int, memory: int, last: Any, out: Any) -> None:
    """Output of the windows that end at the rows ``last`` of ``gates``."""
    state = np.zeros((6, width), dtype=np.float32)
    used = np.zeros(width, dtype=np.int64)
    for k in range(len(last)):
        end = last[k] + 1
        _last_output(gates[end - memory : end], 0, weights, layout, used, state, out[k])


class LstmRuntime:
    """Evaluates a trained LSTM on causal motion at the model's rate."""

    def __init__(self, trained: TrainedModel) -> None:
        self._trained = trained
        shape = trained.architecture
        n, width, memory = shape.n, shape.width, shape.memory
        blocks = [(3 * n, width), (width, 4 * width), (width, 4 * width), (width, width), (width, n)]
        sizes = [size for rows, columns in blocks for size in (rows * columns, columns)]
        self._layout = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
        self._weights = np.ascontiguousarray(trained.weights, dtype=np.float32)
        self._gates = np.zeros((memory, 4 * width), dtype=np.float32)
        self._hidden = np.zeros(width, dtype=np.float32)
        self._used = np.zeros(max(width, 3 * n), dtype=np.int64)
        self._state = np.zeros((6, width), dtype=np.float32)
        self._out = np.zeros(n, dtype=np.float32)
        self.reset()

    def reset(self) -> None:
        """Forget all memory, as at the start of a segment."""
        self._next, self._unknown, self._started = 0, 0, False

    def step(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """Predict the current (n,) from one sample of filtered motion; NaN while an unknown frame is remembered."""
        frame = np.concatenate([q, dq, ddq])
        memory = len(self._gates)
        if not np.isfinite(frame).all():
            if self._started:
                self._unknown = memory
                self._next = (self._next + 1) % memory
            return np.full(len(q), np.nan)
        scaled = self._trained.frame_scaling.apply(frame)
        row = self._gates[self._next]
        _gates(scaled, self._weights, self._layout, self._hidden, self._used, row)
        if not self._started:
            self._gates[:] = row.copy()
            self._started = True
        self._next = (self._next + 1) % memory
        self._unknown = max(self._unknown - 1, 0)
        if self._unknown:
            return np.full(len(q), np.nan)
        _last_output(self._gates, self._next, self._weights, self._layout, self._used, self._state, self._out)
        return self._in_unit(self._out)

    def run(self, frames: Frames) -> FloatArray:
        """Predict the current (N, n) of a whole log's frames."""
        memory, width = self._gates.shape[0], self._gates.shape[1] // 4
        padded, place = pad(frames.channels, frames.segments, frames.finite, memory)
        gates = np.zeros((len(padded), 4 * width), dtype=np.float32)
        over_rows(_encode_rows, (self._weights, self._layout, width), self._trained.frame_scaling.apply(padded), gates)
        out = np.zeros((len(place), len(self._out)), dtype=np.float32)
        over_rows(_output_rows, (gates, self._weights, self._layout, width, memory), place, out)
        predicted = self._in_unit(out)
        predicted[~complete(frames.finite, frames.segments, memory)] = np.nan
        return predicted

    def _in_unit(self, y: Any) -> FloatArray:
        return np.asarray(y * self._trained.output_gain[0] + self._trained.output_offset)
