"""The wrench at the tool by the paper's two schemes, with the same number of parameters.

Run ``python benchmarks/learned_wrench.py --table DIR`` after ``python -m comparisons.experiments.table_two --out DIR``,
whose HRDL-MD models the compound scheme stands on. Both schemes learn from the same motion near one pose with pushes at
the tool, and are judged on motion and pushes of another seed; it prints JSON.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from learned_figures import SEEDS, Table

from comparisons.experiments.compliant import POSE
from comparisons.experiments.wrench_data import near_pose
from ident.arrays import FloatArray
from ident.log import JointLog
from learned.options import TrainingOptions
from learned.wrench import WrenchModel, train_wrench

TEST_SECONDS = 600.0


def recorded(table: Table, seconds: float, seed: int) -> JointLog:
    virtual = table.virtual
    return virtual.record(near_pose(virtual.robot, np.array(POSE), seconds, seed), seed)


def rmse(model: WrenchModel, log: JointLog) -> FloatArray:
    """RMSE (6,) [N, N m] of a wrench."""
    assert log.wrench is not None
    return np.asarray(np.sqrt(np.nanmean((model.predict(log) - log.wrench) ** 2, axis=0)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--table", type=Path, required=True, help="directory of table_two")
    parser.add_argument("--seconds", type=float, default=3600.0, help="of motion to learn from")
    parser.add_argument("--epochs", type=int, default=6)
    parser.add_argument("--predictors", nargs="+", default=["hrdl-md"], help="methods that compound schemes stand on")
    given = parser.parse_args()
    torch.set_num_threads(1)
    table = Table(given.table)
    logs = [recorded(table, given.seconds, 81), recorded(table, TEST_SECONDS, 82)]
    test = recorded(table, TEST_SECONDS, 83)
    assert test.wrench is not None
    result: dict[str, Any] = {"rms of the wrench": np.sqrt(np.mean(test.wrench**2, axis=0))}
    for seed in SEEDS:
        options = TrainingOptions(epochs=given.epochs, batch=512, seed=seed, device="cpu")
        for name in ("single", *given.predictors):
            predictor = None if name == "single" else table.model(f"{name}-seed{seed}")
            model = train_wrench(table.virtual.robot, logs[:1], logs[1:], predictor, options)
            scheme = "single" if predictor is None else f"compound on {name}"
            result[f"{scheme}, seed {seed}"] = {"parameters": model.parameters, "rmse": rmse(model, test)}
    print(json.dumps(result, indent=2, default=lambda value: np.round(value, 3).tolist()))


if __name__ == "__main__":
    main()
