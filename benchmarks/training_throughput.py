"""Training steps against their matrix products alone, at the same shapes, in one process.

Run ``python benchmarks/training_throughput.py [--device cuda]``. A step gathers a batch of windows, runs a hierarchy of
HRDL-MD forwards and backwards, and takes a step of Adam; of that only the matrix products cannot be spared. The figure
is the share of the time that they alone take: the target is 60 % or more.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import numpy as np
import torch

from learned.batches import Batches
from learned.dataset import Dataset
from learned.fitting import descend
from learned.motion_discriminator import TABLE_I
from learned.networks import architecture
from learned.torch_graph import network

JOINTS, FRAMES, ROUNDS = 6, 200_000, 30


def frames() -> Dataset:
    rng = np.random.default_rng(0)
    widths = (3 * JOINTS, sum(map(len, TABLE_I)) * JOINTS, JOINTS)
    state, held, target = (rng.normal(size=(FRAMES, width)).astype(np.float32) for width in widths)
    return Dataset(state, held, target, np.ones_like(target), np.arange(4, FRAMES))


def products(batch: int, device: torch.device) -> Callable[[], None]:
    """Return the products of one step: forwards, and for the gradients of each layer's weights and input."""
    shapes = [layer.shape for layer in architecture("hrdl-md", JOINTS, 15).stage(0).layers]
    inputs = [torch.randn(batch, rows, device=device) for rows, _ in shapes]
    weights = [torch.randn(rows, columns, device=device) for rows, columns in shapes]
    slopes = [torch.randn(batch, columns, device=device) for _, columns in shapes]

    def run() -> None:
        for x, w in zip(inputs, weights, strict=True):
            torch.mm(x, w)
        for k, (x, w, g) in enumerate(zip(inputs, weights, slopes, strict=True)):
            torch.mm(x.T, g)
            if k:
                torch.mm(g, w.T)

    return run


def steps(batch: int, device: torch.device) -> Callable[[], None]:
    shape = architecture("hrdl-md", JOINTS, 15)
    batches = Batches(frames(), shape, device)
    module = network(shape, 0, 0).to(device)
    optimiser = torch.optim.AdamW(module.parameters(), lr=1e-3, weight_decay=0.0, fused=True)
    order = batches.order(0, 0)
    state = {"at": 0}

    def run() -> None:
        rows = order[state["at"] : state["at"] + batch]
        state["at"] = (state["at"] + batch) % (len(order) - batch)
        descend(module, batches, 0, optimiser, 1e-3, rows)

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--batches", type=int, nargs="+", default=[1024, 4096])
    given = parser.parse_args()
    device = torch.device(given.device)
    wait = torch.cuda.synchronize if device.type == "cuda" else lambda: None
    shares = {}
    for batch in given.batches:
        calls = {"products": products(batch, device), "step": steps(batch, device)}
        seconds: dict[str, list[float]] = {name: [] for name in calls}
        for _ in range(ROUNDS):
            for name, call in calls.items():
                call()
                wait()
                start = time.perf_counter()
                for _ in range(5):
                    call()
                wait()
                seconds[name].append((time.perf_counter() - start) / 5)
        p50 = {name: float(np.median(values)) for name, values in seconds.items()}
        shares[batch] = p50["products"] / p50["step"]
        frames_a_second = batch / p50["step"]
        print(f"batch {batch}: products {1e3 * p50['products']:.2f} ms, step {1e3 * p50['step']:.2f} ms", end=", ")
        print(f"{frames_a_second:.0f} frames/s")
    print(json.dumps({"device": given.device, "share_of_products": shares, "target_at_least": 0.6}, indent=2))


if __name__ == "__main__":
    main()
