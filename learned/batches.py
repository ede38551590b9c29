"""Batches gathered from a data set, on the CPU or a GPU alike, and the loss on them."""

from __future__ import annotations

import copy

import numpy as np
import torch
from torch import Tensor

from ident.arrays import FloatArray, IntArray
from learned.dataset import BLOCK, Dataset, blocks
from learned.networks import Architecture
from learned.torch_graph import DenseGraph, Lstm

SHARD = 1 << 18
"""Rows shuffled together: few enough that those on disk are read in neighbourhoods."""
LSTM_TARGETS = 50
"""Last frames of an LSTM's window that have a loss: each of them has seen at least 50 frames, and none is wasted."""


class Batches:
    """A data set as seen by one stage of training, which learns ``residual``, what is left in units of its deviation.

    Args:
        data: the frames.
        shape: architecture that is trained.
        device: where tensors go.
        rows: the rows to draw from; default all that have a target.
    """

    def __init__(self, data: Dataset, shape: Architecture, device: torch.device, rows: IntArray | None = None) -> None:
        self.shape = shape
        self.kept = LSTM_TARGETS if shape.method == "lstm" else 1
        frames = torch.from_numpy(data.frames).to(device)
        count, channels = frames.shape
        size = (count - shape.memory + 1, shape.memory * channels)
        self._windows = frames.as_strided(size, (channels, 1))
        self._held = torch.from_numpy(data.held).to(device)
        self.weight = torch.from_numpy(data.weight).to(device)
        self.residual = torch.from_numpy(np.array(data.target)).to(device)
        self.rows = data.rows if rows is None else rows
        self.device = device

    def only(self, rows: IntArray) -> Batches:
        """Return the same frames, drawing from ``rows`` alone."""
        part = copy.copy(self)
        part.rows = rows
        return part

    def deviation(self, centre: FloatArray) -> FloatArray:
        """Root mean square of the residual about ``centre`` over the weighted rows, (n,)."""
        squares, weights = np.zeros(self.shape.n), np.zeros(self.shape.n)
        for part in blocks(len(self.rows)):
            y, w = self._plain(self.rows[part])
            squares += np.sum(w * (y - centre) ** 2, axis=0)
            weights += w.sum(axis=0)
        return np.asarray(np.sqrt(squares / np.maximum(weights, 1e-30)))

    def mean(self) -> FloatArray:
        """Mean of the residual over the weighted rows, (n,)."""
        total, weights = np.zeros(self.shape.n), np.zeros(self.shape.n)
        for part in blocks(len(self.rows)):
            y, w = self._plain(self.rows[part])
            total += np.sum(w * y, axis=0)
            weights += w.sum(axis=0)
        return np.asarray(total / np.maximum(weights, 1e-30))

    def order(self, seed: int, epoch: int) -> IntArray:
        """Rows of one epoch in random order: shards in random order, each shuffled; a function of its arguments alone.

        For the LSTM a row stands for a window, and windows follow each other by as many frames as have a loss.
        """
        rng = np.random.default_rng([seed, epoch])
        rows = self.rows[int(rng.integers(self.kept)) :: self.kept]
        if len(rows) == 0:
            rows = self.rows[-1:]
        starts = rng.permutation(np.arange(0, len(rows), SHARD))
        return np.concatenate([rng.permutation(rows[start : start + SHARD]) for start in starts])

    def loss(self, module: DenseGraph | Lstm, rows: IntArray, hierarchy: int) -> tuple[Tensor, Tensor]:
        """Weighted sum of squared errors at ``rows``, and the sum of weights."""
        at = torch.from_numpy(rows).to(self.device)
        if self.kept > 1:
            at = (at[:, None] + torch.arange(1 - self.kept, 1, device=self.device)).ravel()
        weight = self.weight.index_select(0, at)
        error = self.output(module, rows, hierarchy).reshape(weight.shape) - self.residual.index_select(0, at)
        return (weight * error * error).sum(), weight.sum()

    def output(self, module: DenseGraph | Lstm, rows: IntArray, hierarchy: int) -> Tensor:
        """Network's output at ``rows``: (B, n), of the LSTM the last frames of each window (B, kept, n)."""
        at = torch.from_numpy(rows).to(self.device)
        window = self._windows.index_select(0, at - (self.shape.memory - 1))
        if isinstance(module, Lstm):
            y: Tensor = module(window.reshape(len(rows), self.shape.memory, -1), self.kept)
            return y
        first, last = self.shape.groups[hierarchy]
        if last > first:
            held = self._held[:, first * self.shape.n : last * self.shape.n].index_select(0, at)
            window = torch.cat([window, held], dim=1)
        dense: Tensor = module(window)
        return dense

    @torch.no_grad()  # type: ignore[untyped-decorator]
    def take_off(self, module: DenseGraph, rows: IntArray, hierarchy: int) -> None:
        """Subtract a trained network's output from the residual at ``rows``."""
        for start in range(0, len(rows), BLOCK):
            part = rows[start : start + BLOCK]
            self.residual[torch.from_numpy(part).to(self.device)] -= self.output(module, part, hierarchy)

    @torch.no_grad()  # type: ignore[untyped-decorator]
    def best_shares(self, module: DenseGraph, hierarchy: int) -> FloatArray:
        """Share of each of a network's outputs, 0 to 1, with which it leaves the least squared error, (n,)."""
        along, power = np.zeros(self.shape.n), np.zeros(self.shape.n)
        for part in blocks(len(self.rows)):
            rows = self.rows[part]
            output = self.output(module, rows, hierarchy).double().cpu().numpy()
            y, w = self._plain(rows)
            along += np.sum(w * y * output, axis=0)
            power += np.sum(w * output**2, axis=0)
        return np.asarray(np.clip(along / np.maximum(power, 1e-30), 0.0, 1.0))

    def rescale(self, centre: FloatArray, gain: FloatArray) -> None:
        """Replace the residual r by (r - centre) * gain, in place."""
        as_tensor = [torch.from_numpy(v.astype(np.float32)).to(self.device) for v in (centre, gain)]
        for part in blocks(len(self.residual)):
            self.residual[part] = (self.residual[part] - as_tensor[0]) * as_tensor[1]

    def _plain(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Residual and weight at ``rows`` as float64."""
        at = torch.from_numpy(rows).to(self.device)
        y, w = (x.index_select(0, at).double().cpu().numpy() for x in (self.residual, self.weight))
        return y, w
