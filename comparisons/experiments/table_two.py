"""Table II of the paper on the virtual VS060: errors of all methods, what a step takes, and the hierarchies one by one.

Run it by ``python -m comparisons.experiments.table_two --preset quick --seeds 3 --out DIR``; a run that was killed goes
on when it is started again. It writes ``table_two.json`` and ``table_two.md`` into DIR, and keeps the logs and models
there. Shan and Pham, "Sensorless Estimation of Contact Using Deep-Learning for Human-Robot Interaction", section V; the
rows that the paper lacks are the models with hysteresis and the hybrid, which stands on that with Maxwell slip.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np

from comparisons.comparison.contestant import Contestant
from comparisons.comparison.held_out import HeldOut
from comparisons.comparison.methods import FAMILIES, PHYSICS, Preset, training_options
from comparisons.comparison.run import summary
from comparisons.comparison.scoring import score
from comparisons.comparison.step_time import step_time
from comparisons.comparison.workshop import Workshop
from comparisons.experiments.data import PaperData, paper_data
from comparisons.experiments.table_two_page import table_two_page
from comparisons.output import to_json
from comparisons.progress import Progress, show_progress
from comparisons.report.provenance import provenance
from comparisons.virtual_robot import VirtualRobot
from ident.robot import load_robot
from learned.predictor import LearnedModel

ROBOT = "vs060"
HIERARCHIES = ("HRDL-MD, H1", "HRDL-MD, H1-2", "HRDL-MD, H1-3")
SLIP = "model-based, Maxwell slip"
MODELS: dict[str, tuple[str, bool]] = {
    "model-based, from sinusoids": ("sigmoid", True),
    "model-based": ("sigmoid", False),
    "model-based, chosen effects": (PHYSICS, False),
    SLIP: ("maxwell-slip", False),
}
"""Identified models: family, and whether they are identified from the sinusoids, by the name of the row."""

NETWORKS = {"MLP": "mlp", "RDL": "rdl", "LSTM": "lstm", "RDL-MD": "rdl-md", "HRDL-MD": "hrdl-md", "hybrid": "hybrid"}
BANDWIDTH = 5.0


@dataclass
class Rows:
    """Fits the methods of the table, one after another.

    Attributes:
        data: the logs.
        folder: where models are kept.
        preset, epochs, seeds, device: how networks learn, as of `sensorless compare`.
        progress: told what is being done.
    """

    data: PaperData
    folder: Path
    preset: Preset
    epochs: int | None
    seeds: int
    device: str | None
    progress: Progress

    def all(self) -> Iterator[Contestant]:
        """Yield every run of every row; runs of one row have its name as their method."""
        for row in (*MODELS, *NETWORKS):
            yield from self.runs(row)

    def runs(self, row: str) -> Iterator[Contestant]:
        """Yield the runs of one of `MODELS` or `NETWORKS`; those of a network with hierarchies are of several rows."""
        if row in MODELS:
            yield self._model(row, *MODELS[row])
            return
        physics = self._model(SLIP, *MODELS[SLIP]) if NETWORKS[row] == "hybrid" else None
        for seed in range(self.seeds):
            yield from self._network(row, NETWORKS[row], seed, physics)

    def _model(self, row: str, family: str, excited: bool) -> Contestant:
        logs = self.data.excitation if excited else self.data.train
        workshop = Workshop(self.folder, self.data.robot, logs, self.progress)
        name = f"{family}-excitation" if excited else family
        model, seconds = workshop.physics(name, FAMILIES.get(family), None)
        return Contestant(name, row, model, seconds=seconds)

    def _network(self, row: str, method: str, seed: int, physics: Contestant | None) -> Iterator[Contestant]:
        workshop = Workshop(self.folder, self.data.robot, self.data.train, self.progress)
        options = training_options(method, self.preset, self.epochs, seed, self.device)
        below = None if physics is None or isinstance(physics.model, LearnedModel) else physics.model
        model, seconds = workshop.network(f"{method}-seed{seed}", method, options, below)
        if method != "hrdl-md":
            yield Contestant(f"{method}-seed{seed}", row, model, seconds=seconds, seed=seed)
            return
        for number, name in enumerate(HIERARCHIES, start=1):
            whole = seconds if number == model.hierarchies else None
            part = model.truncated(number)
            yield Contestant(f"{method}-{number}-seed{seed}", name, part, seconds=whole, seed=seed)


def table_two(
    *,
    out: Path,
    preset: Preset = "quick",
    seeds: int = 3,
    epochs: int | None = None,
    data: str | None = None,
    seed: int = 0,
    device: str | None = None,
) -> None:
    """Make the paper's Table II on the virtual VS060.

    Args:
        out: directory for the tables, the logs and the models.
        preset: quick, or paper: the paper's amounts of data and sizes of networks.
        seeds: trainings of each network.
        epochs: passes over the training logs at most, instead of the preset's.
        data: another preset of the data sets than that of the networks.
        seed: of the data.
        device: that networks learn on: cpu or cuda.
    """
    out.mkdir(parents=True, exist_ok=True)
    with show_progress() as progress:
        virtual = VirtualRobot(load_robot(ROBOT))
        logs = paper_data(virtual, data or preset, out / "data", seed, progress)
        tests = HeldOut.of(logs.test)
        rows = Rows(logs, out / "models", preset, epochs, seeds, device, progress)
        result = _measure(rows, tests)
    words = ["python", "-m", "comparisons.experiments.table_two", *sys.argv[1:]]
    note = provenance([out / "data"], seed=seed, command=words, libraries=("torch",))
    result |= {"preset": preset, "data": data or preset, "seeds": seeds, "epochs": epochs, "provenance": note.to_dict()}
    (out / "table_two.json").write_text(to_json(result), encoding="utf-8")
    (out / "table_two.md").write_text(table_two_page(result), encoding="utf-8")
    print(out / "table_two.md")


def _measure(rows: Rows, tests: HeldOut) -> dict[str, Any]:
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for contestant in rows.all():
        rows.progress(f"{contestant.name}: testing", 0.0)
        figures = score(contestant, tests, BANDWIDTH).figures
        took = step_time(contestant.estimator(tests.logs[0]), tests.logs[0])
        found.setdefault(contestant.method, {})[contestant.name] = {
            **figures,
            "step_us_p50": took.p50,
            "step_us_p99": took.p99,
        }
        rows.progress(f"{contestant.name}: testing", 1.0)
    train = [sum(len(block) for block in log.blocks(100_000)) for log in rows.data.train]
    return {
        "unit": rows.data.robot.unit,
        "joints": list(rows.data.robot.joints),
        "frames": {"train": int(np.sum(train)), "test": len(tests.whole)},
        "rows": {row: summary(runs) for row, runs in found.items()},
    }


if __name__ == "__main__":
    cyclopts.run(table_two)
