"""The networks as torch modules, for training; the only file here with layers in torch."""

from __future__ import annotations

import itertools

import numpy as np
import torch
from torch import Tensor, nn

from ident.arrays import FloatArray
from learned.networks import Architecture, Graph
from learned.window import Float32Array


class DenseGraph(nn.Module):  # type: ignore[misc]
    """A graph of dense layers in torch: takes (B, inputs), gives (B, n), the sum of the graph's outputs."""

    def __init__(self, graph: Graph, generator: torch.Generator, silent: bool = False, apart: bool = False) -> None:
        """Draw weights uniformly within one over the root of a layer's inputs; ``silent`` starts with zero output.

        With ``apart`` neuron k of every layer is joint k modulo n's, and the weights between two joints' are nought and
        stay so: inputs, too, follow each other joint by joint.
        """
        super().__init__()
        self.graph = graph
        self.matrices = nn.ParameterList()
        self.biases = nn.ParameterList()
        for layer in graph.layers:
            rows, columns = layer.shape
            inputs = rows / graph.n if apart else rows
            bound = 0.0 if silent and layer.target[0] in graph.outputs else inputs**-0.5
            matrix = nn.Parameter((torch.rand(rows, columns, generator=generator) - 0.5) * 2.0 * bound)
            if apart:
                _keep_apart(matrix, graph.n)
            self.matrices.append(matrix)
            self.biases.append(
                nn.Parameter((torch.rand(columns * layer.bias, generator=generator) * 2.0 - 1.0) * bound)
            )

    def forward(self, x: Tensor) -> Tensor:
        """Evaluate the layers one after another."""
        done: dict[int, Tensor] = {}
        for layer, matrix, bias in zip(self.graph.layers, self.matrices, self.biases, strict=True):
            start = layer.sources[0][0]
            source = done[start] if start in done else self._entry(x, layer.sources)
            y = torch.addmm(bias, source, matrix) if layer.bias else source @ matrix
            if layer.skip >= 0:
                y = y + done[layer.skip]
            done[layer.target[0]] = torch.relu_(y) if layer.relu else y
        total = done[self.graph.outputs[0]]
        for start in self.graph.outputs[1:]:
            total = total + done[start]
        return total

    def _entry(self, x: Tensor, sources: tuple[tuple[int, int], ...]) -> Tensor:
        """Take ranges of the input, without a copy where they are neighbours."""
        first = sources[0][0]
        size = sum(size for _, size in sources)
        if all(a + n == b for (a, n), (b, _) in itertools.pairwise(sources)):
            return x if size == x.shape[1] else x[:, first : first + size]
        return torch.cat([x[:, start : start + n] for start, n in sources], dim=1)

    def scale_outputs(self, shares: FloatArray) -> None:
        """Multiply each output by a share (n,), for graphs with one hierarchy."""
        factors = torch.from_numpy(shares.astype(np.float32))
        with torch.no_grad():
            for parameter in (self.matrices[-1], self.biases[-1]):
                parameter *= factors.to(parameter.device)

    def flat(self) -> Float32Array:
        """Return all weights in the order of ``Graph.program``."""
        parts = [
            p.detach().cpu().numpy().ravel() for pair in zip(self.matrices, self.biases, strict=True) for p in pair
        ]
        return np.concatenate(parts).astype(np.float32)

    def load_flat(self, weights: Float32Array) -> None:
        """Take weights in the order of ``Graph.program``."""
        _fill(self._tensors(), weights)

    def _tensors(self) -> list[Tensor]:
        return [p for pair in zip(self.matrices, self.biases, strict=True) for p in pair]


class Lstm(nn.Module):  # type: ignore[misc]
    """Dense encoder, one LSTM layer, dense decoder: takes (B, frames, 3n), gives (B, kept, n) for the last frames."""

    def __init__(self, n: int, width: int, generator: torch.Generator) -> None:
        super().__init__()
        self.encoder = nn.Linear(3 * n, width)
        self.cells = nn.LSTM(width, width, batch_first=True)
        self.decoder = nn.Linear(width, width)
        self.output = nn.Linear(width, n)
        with torch.no_grad():
            for parameter in self.parameters():
                bound = float(parameter.shape[-1] if parameter.ndim > 1 else width) ** -0.5
                parameter.copy_((torch.rand(parameter.shape, generator=generator) * 2.0 - 1.0) * bound)

    def forward(self, x: Tensor, kept: int) -> Tensor:
        """Run over the window from an empty state and read the last ``kept`` frames."""
        states, _ = self.cells(torch.relu(self.encoder(x)))
        result: Tensor = self.output(torch.relu(self.decoder(states[:, -kept:])))
        return result

    def _tensors(self) -> list[Tensor]:
        cells = self.cells
        matrices = [
            self.encoder.weight,
            cells.weight_ih_l0,
            cells.weight_hh_l0,
            self.decoder.weight,
            self.output.weight,
        ]
        biases = [self.encoder.bias, cells.bias_ih_l0, cells.bias_hh_l0, self.decoder.bias, self.output.bias]
        return [tensor for pair in zip(matrices, biases, strict=True) for tensor in pair]

    def flat(self) -> Float32Array:
        """Return all weights: matrix (in, out) and bias of encoder, cells' input, cells' state, decoder, output."""
        return np.concatenate([t.detach().cpu().numpy().T.ravel() for t in self._tensors()]).astype(np.float32)

    def load_flat(self, weights: Float32Array) -> None:
        """Take weights in the order of ``flat``."""
        _fill([t.T if t.ndim > 1 else t for t in self._tensors()], weights)


def network(shape: Architecture, hierarchy: int, seed: int, silent: bool = False) -> DenseGraph | Lstm:
    """Return the freshly drawn network of one stage of training."""
    generator = torch.Generator().manual_seed(seed)
    if shape.method == "lstm":
        return Lstm(shape.n, shape.width, generator)
    return DenseGraph(shape.stage(hierarchy), generator, silent, shape.apart)


def _keep_apart(matrix: nn.Parameter, n: int) -> None:
    """Set the weights between different joints to nought, and their gradients for good."""
    rows, columns = matrix.shape
    own = (torch.arange(rows)[:, None] % n == torch.arange(columns) % n).to(matrix.dtype)
    with torch.no_grad():
        matrix *= own
    matrix.register_hook(lambda gradient: gradient * own.to(gradient.device))


def _fill(tensors: list[Tensor], weights: Float32Array) -> None:
    """Copy a flat block of weights into tensors, in place."""
    first = 0
    with torch.no_grad():
        for tensor in tensors:
            size = tensor.numel()
            tensor.copy_(torch.from_numpy(weights[first : first + size].copy()).reshape(tensor.shape))
            first += size
