"""What the models of Table II do at rest, with a changed payload, and with a tenth of the data.

Run ``python benchmarks/learned_figures.py drift|payload|tenth --table DIR`` after ``python -m
comparisons.experiments.table_two --out DIR``, whose logs and models it takes; it prints JSON. RMSE is in %Use, against
the current as logged; where one number is given it is the mean over the joints.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from comparisons.comparison.methods import FAMILIES
from comparisons.comparison.workshop import DONE
from comparisons.experiments.table_two import network_options
from comparisons.protocols import named
from comparisons.virtual_robot import VirtualRobot
from comparisons.virtual_robot.motion import Protocol
from ident.arrays import FloatArray
from ident.identification import identify
from ident.log import JointLog
from ident.model_file import load_model
from ident.predictor import CurrentPredictor
from ident.readers import open_logs
from ident.rigid_body import RigidBody
from ident.robot import Robot, load_robot
from learned.adaptation import PAYLOAD_SPREAD, AdaptedModel, adapt_payload, last_link
from learned.fine_tuning import fine_tune
from learned.predictor import LearnedModel
from learned.training import train

SEEDS = (0, 1, 2)
MASS, COM, INERTIA = 2.0, (0.02, -0.01, 0.1), (0.006, 0.006, 0.003)
"""The payload that nobody tells of [kg, m, kg m^2]: half of what the arm may carry."""

ADAPTING, PIECES = (4.0, 20.0), 5
"""Lengths [s] of the motion to adapt on, and how many of each are tried."""

SHORT_OF_A_START = 100
"""Rows left out at the start of a log: nobody knows yet how the joints came to rest."""

CANDIDATES = 40
"""Random motions of which that is taken that tells most of a payload."""

MORE_EPOCHS = 20
"""Passes over a tenth of the frames, at most."""

REST, JUST_STOPPED = 600.0, (0.3, 1.0, 5.0)
"""Time at rest [s], and moments after the stop [s] from which the change of the estimate is taken."""


class Table:
    """Logs and models of a run of table_two."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.virtual = VirtualRobot(load_robot("vs060"))

    def model(self, name: str) -> LearnedModel:
        """Return a trained model by its name, ``hrdl-md-seed0`` for instance."""
        found = [p.parent for p in (self.folder / "models").glob(f"{name}-*/{DONE}")]
        if len(found) != 1:
            raise SystemExit(f"{len(found)} models named {name} in {self.folder}")
        return LearnedModel.load(found[0], self.virtual.robot)

    def logs(self, *names: str) -> list[JointLog]:
        """Return logs of the data set by the beginnings of their names."""
        paths = [self.folder / "data" / f"{name}*.parquet" for name in names]
        return [source.read() for source in open_logs(paths, self.virtual.robot)]


def rmse(model: CurrentPredictor, logs: list[JointLog]) -> FloatArray:
    """RMSE (n,) of a model on logs, their beginnings left out."""
    errors = [(model.predict(log, causal=True) - log.current)[SHORT_OF_A_START:] for log in logs]
    return np.asarray(np.sqrt(np.nanmean(np.concatenate(errors) ** 2, axis=0)))


def stops(log: JointLog, count: int) -> list[int]:
    """Rows, evenly spread, at which all joints have just come to rest after a motion and stay there for a second."""
    moved = np.abs(np.diff(log.q, axis=0)).max(axis=1) > 2e-4
    still = np.array([not moved[k : k + 100].any() for k in range(len(moved) - 100)])
    found = [k for k in range(1000, len(still)) if still[k] and not still[k - 1] and moved[k - 50 : k].any()]
    return [found[k] for k in np.linspace(0, len(found) - 1, count).round().astype(int)]


def drift(table: Table) -> dict[str, Any]:
    """How far estimates move in ten minutes in which nothing does, from some moments after the stop on."""
    (log,) = table.logs("test_001")
    held = round(REST * log.rate)
    parts = []
    for row in stops(log, 3):
        before = log[row - 1000 : row + 1]
        q = np.concatenate([before.q, np.repeat(before.q[-1:], held, axis=0)])
        parts.append(JointLog(np.arange(len(q)) / log.rate, q, np.zeros_like(q)))
    result = {}
    for method in ("mlp", "lstm", "rdl-md", "hrdl-md", "hybrid"):
        model = table.model(f"{method}-seed0")
        changes: dict[str, list[float]] = {f"from {s} s": [] for s in JUST_STOPPED}
        for part in parts:
            predicted = model.predict(part, causal=True)[1000:]
            for s in JUST_STOPPED:
                later = predicted[round(s * log.rate) :]
                changes[f"from {s} s"].append(float(np.abs(later - later[0]).max()))
        result[method] = {moment: max(values) for moment, values in changes.items()}
    return result


def payload(table: Table) -> dict[str, Any]:
    """RMSE with a payload of 2 kg that the models do not know, as they are, adapted, and fine-tuned."""
    virtual = table.virtual
    load = virtual.scenario.with_effect("payload", mass=MASS, com=COM, inertia=INERTIA)
    carrying = VirtualRobot(virtual.robot, load)
    motion = named("mixed")(virtual.robot, frames=20_000, seed=41)
    free, loaded = virtual.record(motion, 41), carrying.record(motion, 42)
    slip = load_model(next((table.folder / "models").glob("maxwell-slip-*")), virtual.robot)
    short, longer = (
        [carrying.record(named("continuous")(virtual.robot, seconds=s, seed=50 + k), 50 + k) for k in range(PIECES)]
        for s in ADAPTING
    )
    chosen = [carrying.record(telling(virtual.robot, k), 90 + k) for k in range(PIECES)]
    reference = table.logs("hysteresis_000")[0][:20_000]
    result: dict[str, Any] = {}
    for method, seed in itertools.product(("hrdl-md", "hybrid"), SEEDS):
        model = table.model(f"{method}-seed{seed}")
        before, untold = rmse(model, [free]), rmse(model, [loaded])

        def adapted(log: JointLog, model: LearnedModel = model) -> AdaptedModel:
            return adapt_payload(model, virtual.robot, log, reference, slip)

        ways: dict[str, list[Any]] = {
            "adapted on 4 s": [adapted(log) for log in short],
            "adapted on 4 s that tell most": [adapted(log) for log in chosen],
            "adapted on 20 s": [adapted(log) for log in longer],
            "fine-tuned on 4 s": [fine_tune(model, log) for log in short[:3]],
            "fine-tuned on 4 s, faster": [fine_tune(model, log, learning_rate=1e-3, anchor=0.1) for log in short[:3]],
        }
        found = {way: np.array([rmse(one, [loaded]) for one in models]) for way, models in ways.items()}
        result[f"{method}, seed {seed}"] = {
            "before": before.mean(),
            "untold over before": untold.mean() / before.mean(),
            **{f"{way}, over before": np.sort(each.mean(axis=1) / before.mean()) for way, each in found.items()},
            "before, joints": before,
            "untold, joints": untold,
            "adapted on 4 s, joints, median": np.median(found["adapted on 4 s"], axis=0),
            "mass found on 4 s": [one.payload[0] for one in ways["adapted on 4 s"]],
        }
    return result


def telling(robot: Robot, number: int) -> Protocol:
    """Of random motions of 4 s the one that tells most of a payload: with the greatest determinant of information."""
    body, columns = RigidBody(robot.multibody), last_link(robot)
    best, most = None, -np.inf
    for seed in range(1000 * number, 1000 * number + CANDIDATES):
        motion = named("continuous")(robot, seconds=ADAPTING[0], seed=seed)
        q = np.concatenate([block.q for block in motion.blocks()])
        dq = np.gradient(q, 1.0 / motion.rate, axis=0)
        ddq = np.gradient(dq, 1.0 / motion.rate, axis=0)
        rows = body.regressor(q, dq, ddq)[:, :, columns] * PAYLOAD_SPREAD
        # a joint tells the more of a torque, the less torque its links ask of it
        usual = body.inverse_dynamics(q, dq, ddq, robot.multibody.parameters).std(axis=0) + 0.5
        weighed = rows / usual[:, None]
        information = np.linalg.slogdet(np.einsum("kja,kjb->ab", weighed, weighed) + np.eye(10))[1]
        if information > most:
            best, most = motion, information
    assert best is not None
    return best


def tenth(table: Table) -> dict[str, Any]:
    """RMSE on the test logs of hybrids, physics included, from a tenth of the frames, and of others from all."""
    robot, tests = table.virtual.robot, table.logs("test")
    moving, stopping = table.logs("continuous_000", "hysteresis_000")
    more = table.logs("hysteresis_001")[0]
    logs = [moving[: len(moving) * 6 // 10], stopping, more[: len(more) // 5]]
    rows = sum(map(len, logs))
    physics = identify(robot, logs, effects=FAMILIES["maxwell-slip"]).model
    result: dict[str, Any] = {"frames": rows, "physics of a tenth": rmse(physics, tests)}
    for seed in SEEDS:
        options = network_options("hybrid", "quick", MORE_EPOCHS, seed, "cpu")
        model = train(robot, logs, None, "hybrid", options, physics=physics)
        result[f"hybrid of a tenth, seed {seed}"] = rmse(model, tests)
        for method in ("hrdl-md", "hybrid"):
            result[f"{method} of all, seed {seed}"] = rmse(table.model(f"{method}-seed{seed}"), tests)
    return result


WHAT: dict[str, Callable[[Table], dict[str, Any]]] = {"drift": drift, "payload": payload, "tenth": tenth}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=list(WHAT))
    parser.add_argument("--table", type=Path, required=True, help="directory of table_two")
    given = parser.parse_args()
    torch.set_num_threads(1)
    found = WHAT[given.what](Table(given.table))
    print(json.dumps(found, indent=2, default=lambda value: np.round(value, 4).tolist()))


if __name__ == "__main__":
    main()
