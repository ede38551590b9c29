"""The stages of a training: each hierarchy learns what those before it leave."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ident.arrays import Array, FloatArray
from learned.batches import Batches
from learned.checkpoint import read_matching, write_whole
from learned.dataset import Dataset
from learned.fitting import Fitted, fit
from learned.networks import Architecture
from learned.options import Progress, ProgressCallback, TrainingOptions
from learned.threads import at_most, worth_having
from learned.torch_graph import DenseGraph, Lstm, network

CHECKPOINT = "checkpoint.pt"


class Stages:
    """The stages of one training; what is done is remembered in the checkpoint.

    Attributes:
        weights: of each hierarchy, flat.
        gains: unit of the current per unit of each hierarchy's output, (n,) each.
        offset: mean current, (n,).
        fitted: losses of each hierarchy.
    """

    def __init__(
        self,
        data: Dataset,
        held_out: Dataset,
        shape: Architecture,
        options: TrainingOptions,
        out: Path | None,
        progress: ProgressCallback | None,
    ) -> None:
        self.shape, self.options, self.progress = shape, options, progress
        self.device = torch.device(options.device or ("cuda" if torch.cuda.is_available() else "cpu"))
        self.training = Batches(data, shape, self.device)
        self.validation = Batches(held_out, shape, self.device)
        self.fingerprint = _fingerprint(data, held_out, shape, options)
        self.path = None if out is None else out / CHECKPOINT
        self.state: dict[str, Any] = {"fingerprint": self.fingerprint, "done": {}, "current": None}
        if self.path is not None:
            self.state = read_matching(self.path, self.fingerprint) or self.state
        self.weights: list[Array] = []
        self.gains: list[FloatArray] = []
        self.offset: FloatArray = np.zeros(shape.n)
        self.fitted: list[Fitted] = []
        parts = options.cross_fit if len(shape.groups) > 1 and options.cross_fit > 1 else 0
        self.folds = np.array_split(data.rows, parts) if parts else []

    def run(self) -> None:
        """Fit one hierarchy after another to what those before leave."""
        scale = np.ones(self.shape.n)
        for hierarchy in range(len(self.shape.groups)):
            # A physical model has an offset of its own; a network that corrects it begins with nothing to add.
            fresh = hierarchy == 0 and self.shape.method != "hybrid"
            centre = self.training.mean() if fresh else np.zeros(self.shape.n)
            deviation = self.training.deviation(centre)
            gain = 1.0 / np.where(deviation > 0.0, deviation, 1.0)
            for batches in (self.training, self.validation):
                batches.rescale(centre, gain)
            scale = scale / gain
            if fresh:
                self.offset = centre
            self.gains.append(scale)
            self._stage(hierarchy)

    def _stage(self, hierarchy: int) -> None:
        """Fit a hierarchy, on all frames and, for what the next one learns, without each fold in turn."""
        module, fitted = self._network(hierarchy, None)
        self.weights.append(module.flat())
        self.fitted.append(fitted)
        if hierarchy + 1 == len(self.shape.groups) or isinstance(module, Lstm):
            return
        self.validation.take_off(module, self.validation.rows, hierarchy)
        if not self.folds:
            self.training.take_off(module, self.training.rows, hierarchy)
            return
        others = [self._network(hierarchy, fold)[0] for fold in range(len(self.folds))]
        for other, rows in zip(others, self.folds, strict=True):
            if isinstance(other, DenseGraph):
                self.training.take_off(other, rows, hierarchy)

    def _network(self, hierarchy: int, fold: int | None) -> tuple[DenseGraph | Lstm, Fitted]:
        """Return a fitted network, from the checkpoint if it is done there."""
        name = f"{hierarchy}" if fold is None else f"{hierarchy}/{fold}"
        number = hierarchy * (len(self.folds) + 1) + (0 if fold is None else fold + 1)
        silent = hierarchy > 0 or self.shape.method == "hybrid"
        seed = self.options.seed * 1000 + number
        module = network(self.shape, hierarchy, seed, silent=silent).to(self.device)
        if name in self.state["done"]:
            done = self.state["done"][name]
            module.load_state_dict(done["module"])
            return module, Fitted(done["history"], done["best_epoch"])
        current = self.state["current"]
        training = self.training
        if fold is not None:
            training = training.only(np.concatenate([r for k, r in enumerate(self.folds) if k != fold]))

        def keep(snapshot: dict[str, Any]) -> None:
            self.state["current"] = {"name": name, **snapshot}
            self._write()

        def report(epoch: int, loss: float, validation: float) -> None:
            if self.progress is not None:
                stages = len(self.shape.groups) * (len(self.folds) + 1) - len(self.folds)
                self.progress(Progress(number + 1, stages, epoch, self.options.epochs, loss, validation))

        resumed = current if current is not None and current["name"] == name else None
        with at_most(worth_having(module, self.options.batch)):
            fitted = fit(module, training, self.validation, hierarchy, self.options, seed, keep, report, resumed)
        if silent and isinstance(module, DenseGraph):
            # What corrects another prediction may do so on one joint and do harm on the next.
            module.scale_outputs(self.validation.best_shares(module, hierarchy))
        state = module.state_dict()
        self.state["done"][name] = {"module": state, "history": fitted.history, "best_epoch": fitted.best_epoch}
        self.state["current"] = None
        self._write()
        return module, fitted

    def _write(self) -> None:
        if self.path is not None:
            write_whole(self.path, self.state)

    def summary(self) -> dict[str, Any]:
        """What a person wants to know of the training."""
        options = dataclasses.asdict(self.options)
        losses = [{"history": f.history, "best_epoch": f.best_epoch} for f in self.fitted]
        frames = {"train": len(self.training.rows), "validation": len(self.validation.rows)}
        return {"options": options, "frames": frames, "stages": losses}


def _fingerprint(data: Dataset, held_out: Dataset, shape: Architecture, options: TrainingOptions) -> str:
    """Tell one training from another."""
    digest = hashlib.sha256(repr((shape, dataclasses.replace(options, checkpoint_seconds=0.0))).encode())
    arrays: list[Array] = [data.rows, held_out.rows]
    arrays += [part[:: max(1, len(part) // 4096)] for d in (data, held_out) for part in (d.frames, d.target, d.held)]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
