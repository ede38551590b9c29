"""Writing a trained model's networks as ONNX, for controllers that run neither Python nor numba.

The graph takes motion as it is, in SI units, and returns the current in the model's unit: scaling and the sum over
hierarchies are inside. Filters and discriminator have memory and stay outside; see
``MotionDiscriminator``.
Inputs: ``frames`` (B, M 3n), the last M of q, dq, ddq, oldest first; ``held`` (B, I n), threshold by threshold, where
the method has a discriminator. Output: ``current`` (B, n).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from ident.arrays import Array
from learned.model_file import TrainedModel
from learned.networks import Graph

OPSET = 17


def export(trained: TrainedModel, path: Path) -> None:
    """Write the networks of a trained model to ``path``; the physics of a hybrid is not in them.

    Args:
        trained: the networks, as ``LearnedModel.trained`` holds them.
        path: of the file to write.
    """
    writer = _Writer()
    shape = trained.architecture
    frames = writer.scale("frames", trained.frame_scaling.mean, trained.frame_scaling.gain, shape.memory)
    inputs = [helper.make_tensor_value_info("frames", TensorProto.FLOAT, ["B", shape.frames])]
    if shape.method == "lstm":
        output = _lstm(writer, frames, trained)
    else:
        names = {(0, shape.frames): frames}
        if shape.thresholds:
            size = shape.thresholds * shape.n
            inputs.append(helper.make_tensor_value_info("held", TensorProto.FLOAT, ["B", size]))
            names[(shape.frames, size)] = writer.scale("held", trained.held_scaling.mean, trained.held_scaling.gain, 1)
        output = _dense(writer, names, shape.stacked(), trained)
    writer.node("Add", [output, writer.constant(trained.output_offset)], "current")
    result = helper.make_tensor_value_info("current", TensorProto.FLOAT, ["B", shape.n])
    graph = helper.make_graph(writer.nodes, f"{shape.method} of {trained.robot}", inputs, [result], writer.constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=9)
    notes = {"unit": trained.unit, "rate": f"{trained.rate:g}", "joints": " ".join(trained.joints)}
    helper.set_model_props(model, notes)
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(model, str(path))


class _Writer:
    """Nodes and constants of a graph in the making."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, values: Array, whole: bool = False) -> str:
        """Add a constant, float32 or else int64, and return its name."""
        name = f"c{len(self.constants)}"
        kind = np.int64 if whole else np.float32
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(values, dtype=kind), name))
        return name

    def node(self, kind: str, inputs: list[str], name: str | None = None, outputs: int = 1, **attributes: Any) -> str:
        """Add an operation and return the name of its last output."""
        names = [f"n{len(self.nodes)}_{k}" for k in range(outputs - 1)] + [name or f"n{len(self.nodes)}"]
        self.nodes.append(helper.make_node(kind, inputs, names, **attributes))
        return names[-1]

    def scale(self, name: str, mean: Array, gain: Array, times: int) -> str:
        """Scale an input whose channels repeat ``times`` over."""
        centred = self.node("Sub", [name, self.constant(np.tile(mean, times))])
        return self.node("Mul", [centred, self.constant(np.tile(gain, times))])

    def columns(self, source: str, start: int, size: int) -> str:
        """Take columns of a (B, k) value."""
        bounds = [self.constant(np.array([v]), whole=True) for v in (start, start + size, 1)]
        return self.node("Slice", [source, *bounds])


def _dense(writer: _Writer, names: dict[tuple[int, int], str], graph: Graph, trained: TrainedModel) -> str:
    """Add a graph of dense layers; return the name of the scaled sum of its hierarchies."""
    first = 0
    done: dict[int, str] = {}
    for layer in graph.layers:
        rows, columns = layer.shape
        matrix = trained.weights[first : first + rows * columns].reshape(rows, columns)
        first += rows * columns
        total, row = "", 0
        for start, size in layer.sources:
            source = done[start] if start >= graph.inputs else _input(writer, names, start, size)
            product = writer.node("MatMul", [source, writer.constant(matrix[row : row + size])])
            total = writer.node("Add", [total, product]) if total else product
            row += size
        if layer.bias:
            total = writer.node("Add", [total, writer.constant(trained.weights[first : first + columns])])
            first += columns
        if layer.skip >= 0:
            total = writer.node("Add", [total, done[layer.skip]])
        done[layer.target[0]] = writer.node("Relu", [total]) if layer.relu else total
    outputs = [
        writer.node("Mul", [done[start], writer.constant(gain)])
        for start, gain in zip(graph.outputs, trained.output_gain, strict=True)
    ]
    return writer.node("Sum", outputs)


def _input(writer: _Writer, names: dict[tuple[int, int], str], start: int, size: int) -> str:
    """Return the name of a range of the input: one of the scaled inputs or columns of one."""
    first, whole = next((a, n) for a, n in names if a <= start < a + n)
    name = names[first, whole]
    return name if size == whole else writer.columns(name, start - first, size)


def _lstm(writer: _Writer, frames: str, trained: TrainedModel) -> str:
    """Add encoder, cells and decoder; return the name of the scaled output."""
    shape = trained.architecture
    n, width = shape.n, shape.width
    parts, first = [], 0
    for rows, columns in ((3 * n, width), (width, 4 * width), (width, 4 * width), (width, width), (width, n)):
        size = rows * columns
        parts.append((trained.weights[first : first + size].reshape(rows, columns), first + size, columns))
        first += size + columns
    bias = [trained.weights[start : start + columns] for _, start, columns in parts]
    matrices = [matrix for matrix, _, _ in parts]
    sequence = writer.node("Reshape", [frames, writer.constant(np.array([-1, shape.memory, 3 * n]), whole=True)])
    encoded = writer.node(
        "Add", [writer.node("MatMul", [sequence, writer.constant(matrices[0])]), writer.constant(bias[0])]
    )
    by_time = writer.node("Transpose", [writer.node("Relu", [encoded])], perm=[1, 0, 2])
    # Gates lie as input, forget, cell, output; ONNX has input, output, forget, cell.
    order = np.concatenate([np.arange(k * width, (k + 1) * width) for k in (0, 3, 1, 2)])
    cells = [writer.constant(matrix.T[order][None]) for matrix in matrices[1:3]]
    both = writer.constant(np.concatenate([bias[1][order], bias[2][order]])[None])
    last = writer.node("LSTM", [by_time, *cells, both], outputs=2, hidden_size=width)
    state = writer.node("Squeeze", [last, writer.constant(np.array([0]), whole=True)])
    for k in (3, 4):
        state = writer.node(
            "Add", [writer.node("MatMul", [state, writer.constant(matrices[k])]), writer.constant(bias[k])]
        )
        state = writer.node("Relu", [state]) if k == 3 else state
    return writer.node("Mul", [state, writer.constant(trained.output_gain[0])])
