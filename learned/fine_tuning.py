"""Fine-tuning a trained network on a short log: the alternative to identifying the payload under a frozen network."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch

from ident.errors import InputError
from ident.log import JointLog
from learned.batches import Batches
from learned.dataset import FrameSpec, build
from learned.predictor import LearnedModel
from learned.torch_graph import DenseGraph, network


def fine_tune(
    model: LearnedModel,
    log: JointLog,
    steps: int = 300,
    learning_rate: float = 1e-4,
    anchor: float = 1.0,
    seed: int = 0,
) -> LearnedModel:
    """Train all hierarchies of a model on, together, on one short log, and return the new model.

    Args:
        model: a trained model; not changed.
        log: a few seconds of motion, touching nothing.
        steps: steps of Adam, each on up to 1024 frames.
        learning_rate: of Adam.
        anchor: weight of the squared distance of the weights from where they were, to keep what the log cannot show.
        seed: of the batches.

    Raises:
        InputError: the model is an LSTM, or the log does not fit.
    """
    trained, shape = model.trained, model.trained.architecture
    if shape.method == "lstm":
        raise InputError("an LSTM cannot be fine-tuned here", "fine-tuning", "use a model with dense layers")
    spec = FrameSpec(shape.n, trained.rate, trained.cutoff, shape.memory, trained.discriminator, 1.0, None, seed)
    data, _ = build([log], spec, model.physics, (trained.frame_scaling, trained.held_scaling))
    batches = Batches(data, shape, torch.device("cpu"))
    batches.rescale(trained.output_offset, 1.0 / trained.output_gain[0])
    shares = torch.from_numpy((trained.output_gain / trained.output_gain[0]).astype(np.float32))
    modules = _modules(model)
    parameters = [p for module in modules for p in module.parameters()]
    before = [p.detach().clone() for p in parameters]
    optimiser = torch.optim.Adam(parameters, lr=learning_rate)
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        rows = rng.permutation(batches.rows)[:1024]
        total = sum(
            share * batches.output(m, rows, h) for h, (m, share) in enumerate(zip(modules, shares, strict=True))
        )
        error = total - batches.residual[torch.from_numpy(rows)]
        moved = sum(((p - b) ** 2).sum() for p, b in zip(parameters, before, strict=True))
        optimiser.zero_grad(set_to_none=True)
        ((error**2).mean() + anchor * moved).backward()
        optimiser.step()
    weights = np.concatenate([module.flat() for module in modules])
    return LearnedModel(dataclasses.replace(trained, weights=weights), model.physics, model.factor)


def _modules(model: LearnedModel) -> list[DenseGraph]:
    """Networks of a model as torch modules."""
    shape, first, modules = model.trained.architecture, 0, []
    for hierarchy in range(len(shape.groups)):
        module = network(shape, hierarchy, 0)
        assert isinstance(module, DenseGraph)
        size = module.graph.weights
        module.load_flat(model.trained.weights[first : first + size])
        first += size
        modules.append(module)
    return modules
