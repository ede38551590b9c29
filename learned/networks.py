"""The networks, as lists of dense layers that training, run time and ONNX export all read.

A layer reads one or two ranges of a work vector and writes another. The work vector begins with the network's input:
the M frames of q, dq, ddq, oldest first, then the discriminator values, threshold by threshold. One list serves the
plain network, the residual blocks and the hierarchies alike, so nothing is ever converted from one form to another.

Sizes. The paper gives HRDL-MD (three hierarchies of 3 hidden layers of 256 neurons, M = 5) and leaves the rest to be
inferred from its inference times (Table II b): one hierarchy's depth takes 0.77 ms, as hierarchies run side by side;
MLP and RDL take the same 1.45 ms, so they differ in nothing but the additions of the skips, and about twice as long,
which three blocks of 3 hidden layers do; RDL-MD adds nothing but the 90 discriminator values (1.75 ms). The LSTM takes
2.21 ms for 100 frames, which one layer of 64 cells between a dense encoder and decoder of 64 does.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ident.arrays import IntArray
from ident.errors import InputError
from learned.motion_discriminator import TABLE_I

Method = Literal["mlp", "lstm", "rdl", "rdl-md", "hrdl", "hrdl-md", "hybrid"]
METHODS: tuple[Method, ...] = ("mlp", "lstm", "rdl", "rdl-md", "hrdl", "hrdl-md", "hybrid")
DISCRIMINATED = ("rdl-md", "hrdl-md", "hybrid")
LSTM_FRAMES = 100

Range = tuple[int, int]
"""Start and size of a run of numbers in the work vector."""


@dataclass(frozen=True)
class Layer:
    """A dense layer ``target = [relu](sources @ W + b + skip)``; an added range starts at ``skip``, -1 for none."""

    sources: tuple[Range, ...]
    target: Range
    relu: bool
    skip: int = -1
    bias: bool = True

    @property
    def shape(self) -> tuple[int, int]:
        """Inputs and outputs of the weight matrix."""
        return sum(size for _, size in self.sources), self.target[1]


@dataclass(frozen=True)
class Graph:
    """Layers in the order in which they are computed; ``outputs`` start where each hierarchy leaves its n results."""

    inputs: int
    layers: tuple[Layer, ...]
    outputs: tuple[int, ...]
    n: int

    @property
    def width(self) -> int:
        """Length of the work vector."""
        return max(start + size for start, size in (layer.target for layer in self.layers))

    @property
    def weights(self) -> int:
        """Number of weights: of each layer its matrix (inputs, outputs) row by row, then its bias."""
        return sum(rows * columns + columns * layer.bias for layer in self.layers for rows, columns in [layer.shape])

    def program(self) -> IntArray:
        """Layers as rows of numbers for the compiled evaluation.

        Columns: start and size of the first source, of the second (0, 0 where there is none), of the target, first
        weight, first bias (-1 for none), 1 with a ReLU, start of the skip (-1 for none).
        """
        rows, first = [], 0
        for layer in self.layers:
            second = layer.sources[1] if len(layer.sources) > 1 else (0, 0)
            inputs, outputs = layer.shape
            bias = first + inputs * outputs if layer.bias else -1
            rows.append([*layer.sources[0], *second, *layer.target, first, bias, int(layer.relu), layer.skip])
            first += inputs * outputs + outputs * layer.bias
        return np.array(rows, dtype=np.int64)


@dataclass(frozen=True)
class Architecture:
    """What is trained, stage by stage.

    Attributes:
        method: name of the method.
        n: joints, or outputs.
        memory: frames M that the network sees.
        groups: for each hierarchy the range (first, last + 1) of the thresholds it sees.
        width: neurons of a hidden layer; of the LSTM its cells, encoder and decoder.
        depth: hidden layers of a block.
        blocks: blocks one after another, with a skip round each where ``residual``.
        residual: whether blocks have skips.
        channels: numbers in a frame; 0 is q, dq and ddq of the n joints.
        apart: whether each output has neurons of its own, which see its own joint's motion alone.
    """

    method: Method
    n: int
    memory: int
    groups: tuple[tuple[int, int], ...]
    width: int
    depth: int = 3
    blocks: int = 1
    residual: bool = False
    channels: int = 0
    apart: bool = False

    @property
    def frames(self) -> int:
        """Numbers in a window of frames."""
        return self.memory * self.frame

    @property
    def frame(self) -> int:
        """Numbers in a frame."""
        return self.channels or 3 * self.n

    @property
    def thresholds(self) -> int:
        """Thresholds that all hierarchies see together."""
        return max((last for _, last in self.groups), default=0)

    def stage(self, hierarchy: int) -> Graph:
        """Graph of one hierarchy by itself: its input is the window and its own group of thresholds."""
        first, last = self.groups[hierarchy]
        held = (last - first) * self.n
        entry: tuple[Range, ...] = ((0, self.frames), (self.frames, held)) if held else ((0, self.frames),)
        place = self.frames + held
        layers: list[Layer] = []
        source = entry
        for _ in range(self.blocks):
            skip = -1
            if self.residual and source is not entry:
                skip = source[0][0]
            elif self.residual:
                layers.append(Layer(source, (place, self.width), relu=False, bias=False))
                skip, place = place, place + self.width
            for k in range(self.depth):
                target = (place, self.width)
                layers.append(Layer(source, target, relu=True, skip=skip if k == self.depth - 1 else -1))
                source, place = (target,), place + self.width
        layers.append(Layer(source, (place, self.n), relu=False))
        return Graph(self.frames + held, tuple(layers), (place,), self.n)

    def stacked(self) -> Graph:
        """All hierarchies as one graph; they share the window and read each its own group of thresholds."""
        inputs = self.frames + self.thresholds * self.n
        place = inputs
        layers: list[Layer] = []
        outputs = []
        for hierarchy, (first, _) in enumerate(self.groups):
            graph = self.stage(hierarchy)
            shift = place - graph.inputs
            held = first * self.n
            layers += [_moved(layer, self.frames, held, graph.inputs, shift) for layer in graph.layers]
            outputs.append(graph.outputs[0] + shift)
            place += graph.width - graph.inputs
        return Graph(inputs, tuple(layers), tuple(outputs), self.n)

    def truncated(self, hierarchies: int) -> Architecture:
        """Return the same with its first hierarchies only."""
        return dataclasses.replace(self, groups=self.groups[:hierarchies])


def _moved(layer: Layer, frames: int, held: int, inputs: int, shift: int) -> Layer:
    """Move a stand-alone hierarchy's layer to where it lies among the others."""

    def place(start: int) -> int:
        if start < frames:
            return start
        return start + held if start < inputs else start + shift

    sources = tuple((place(start), size) for start, size in layer.sources)
    skip = -1 if layer.skip < 0 else place(layer.skip)
    return dataclasses.replace(layer, sources=sources, target=(place(layer.target[0]), layer.target[1]), skip=skip)


def table_i_groups(hierarchies: int) -> tuple[tuple[int, int], ...]:
    """Ranges of each hierarchy's thresholds among those of Table I laid end to end; further hierarchies begin again."""
    ends = np.cumsum([0, *(len(group) for group in TABLE_I)]).tolist()
    return tuple((ends[k % len(TABLE_I)], ends[k % len(TABLE_I) + 1]) for k in range(hierarchies))


def architecture(
    method: str,
    n: int,
    thresholds: int,
    hierarchies: int = 3,
    width: int | None = None,
    memory: int = 5,
    depth: int = 3,
) -> Architecture:
    """Return the network that a method names, of the paper's size unless told otherwise.

    Args:
        method: one of ``METHODS``.
        n: joints.
        thresholds: values that the discriminator holds for a joint; when they are as many as Table I's, each hierarchy
            of hrdl-md sees a group of that table, else all of them.
        hierarchies: of hrdl, hrdl-md and hybrid.
        width: neurons of a hidden layer (256; the LSTM 64).
        memory: frames M (the LSTM sees 100).
        depth: hidden layers of a hierarchy or block.

    Raises:
        InputError: no such method.
    """
    if method not in METHODS:
        raise InputError(f"unknown method {method!r}", "training", f"choose one of {', '.join(METHODS)}")
    if method == "lstm":
        return Architecture("lstm", n, LSTM_FRAMES, ((0, 0),), width or 64)
    size = width or 256
    if method in ("mlp", "rdl", "rdl-md"):
        group = (0, thresholds if method == "rdl-md" else 0)
        return Architecture(method, n, memory, (group,), size, depth, blocks=3, residual=method != "mlp")
    groups: tuple[tuple[int, int], ...] = ((0, 0),) * hierarchies
    if method != "hrdl":
        whole = method == "hrdl-md" and thresholds == sum(len(group) for group in TABLE_I)
        groups = table_i_groups(hierarchies) if whole else ((0, thresholds),) * hierarchies
    return Architecture(method, n, memory, groups, size, depth, apart=method == "hybrid")
