"""One sample through HRDL-MD, against one matrix-vector product over the same weights and against torch.

Run ``python benchmarks/inference.py``: everything is timed in one process, round after round in turn, on one core, and
the ratios are what counts. The paper gives 0.77 ms for HRDL-MD and 1.75 ms for RDL-MD; here the plain torch module of
RDL-MD is the yardstick, and so is the least that any evaluation must do, which is to read every weight once.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import time
from collections.abc import Callable

import numpy as np
import torch

from learned.model_file import TrainedModel
from learned.motion_discriminator import TABLE_I, DiscriminatorSpec
from learned.networks import DISCRIMINATED, architecture
from learned.runtime import DenseRuntime
from learned.runtime_lstm import LstmRuntime
from learned.torch_graph import network
from learned.window import Scaling

JOINTS, ROUNDS, CALLS = 6, 40, 50


def random_model(method: str) -> TrainedModel:
    spec = DiscriminatorSpec(sum(TABLE_I, ()) if method in DISCRIMINATED else ())
    shape = architecture(method, JOINTS, spec.count)
    weights = [network(shape, h, h).flat() for h in range(len(shape.groups))]
    held = spec.count * JOINTS
    return TrainedModel(
        robot="benchmark",
        joints=tuple(f"joint_{j + 1}" for j in range(JOINTS)),
        unit="%Use",
        rate=100.0,
        cutoff=20.0,
        architecture=shape,
        discriminator=spec,
        frame_scaling=Scaling(np.zeros(3 * JOINTS), np.ones(3 * JOINTS)),
        held_scaling=Scaling(np.zeros(held), np.full(held, 10.0)),
        output_gain=np.ones((len(shape.groups), JOINTS)),
        output_offset=np.zeros(JOINTS),
        weights=np.concatenate(weights),
    )


def step_of(method: str) -> Callable[[], object]:
    trained = random_model(method)
    runtime = LstmRuntime(trained) if method == "lstm" else DenseRuntime(trained)
    motion = np.random.default_rng(0).normal(size=(3, JOINTS))
    return lambda: runtime.step(motion[0], motion[1], motion[2])


class Block(torch.nn.Module):  # type: ignore[misc]
    """Three hidden layers with a skip round them."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.layers = torch.nn.ModuleList(torch.nn.Linear(k, 256) for k in (inputs, 256, 256))
        self.skip = torch.nn.Identity() if inputs == 256 else torch.nn.Linear(inputs, 256, bias=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Evaluate the block."""
        y = torch.relu(self.layers[0](x))
        y = torch.relu(self.layers[1](y))
        return torch.relu(self.layers[2](y) + self.skip(x))


def plain_rdl_md() -> Callable[[], object]:
    """RDL-MD as one would write it in torch; its input is ready made."""
    inputs = architecture("rdl-md", JOINTS, 15).stage(0).inputs
    module = torch.nn.Sequential(Block(inputs), Block(256), Block(256), torch.nn.Linear(256, JOINTS)).eval()
    x = torch.randn(1, inputs)
    return lambda: module(x)


def torch_of(method: str) -> Callable[[], object]:
    shape = architecture(method, JOINTS, 15)
    module = network(shape, 0, 0).eval()
    if method == "lstm":
        x = torch.randn(1, shape.memory, 3 * JOINTS)
        return lambda: module(x, 1)
    x = torch.randn(1, shape.stage(0).inputs)
    return lambda: module(x)


def product_over(weights: int) -> Callable[[], object]:
    matrix = np.random.default_rng(1).normal(size=(weights // 256, 256)).astype(np.float32)
    x = np.ones(256, dtype=np.float32)
    y = np.empty(len(matrix), dtype=np.float32)
    return lambda: np.dot(matrix, x, out=y)


def main() -> None:
    torch.set_num_threads(1)
    weights = architecture("hrdl-md", JOINTS, 15).stacked().weights
    timed = {"matrix-vector product": product_over(weights)}
    timed |= {f"{m} step": step_of(m) for m in ("mlp", "rdl", "lstm", "rdl-md", "hrdl-md")}
    timed |= {f"{m} torch": torch_of(m) for m in ("mlp", "rdl", "lstm")}
    timed["rdl-md torch"] = plain_rdl_md()
    samples: dict[str, list[float]] = {name: [] for name in timed}
    with torch.no_grad():
        for _ in range(ROUNDS):
            for name, call in timed.items():
                call()
                for _ in range(CALLS):
                    start = time.perf_counter()
                    call()
                    samples[name].append(1e6 * (time.perf_counter() - start))
    figures = {name: np.percentile(values, [50.0, 99.0]) for name, values in samples.items()}
    for name, (p50, p99) in figures.items():
        print(f"{name:24s} p50 {p50:8.1f} us   p99 {p99:8.1f} us")
    step, floor, plain = (figures[k] for k in ("hrdl-md step", "matrix-vector product", "rdl-md torch"))
    ratios = {
        "weights": weights,
        "step_over_product": {"p50": step[0] / floor[0], "p99": step[1] / floor[1], "target_at_most": 1.6},
        "torch_rdl_md_over_step": {"p50": plain[0] / step[0], "p99": plain[1] / step[1], "target_at_least": 6.0},
    }
    print(json.dumps(ratios, indent=2))


if __name__ == "__main__":
    main()
