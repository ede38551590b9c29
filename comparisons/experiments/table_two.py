"""Table II of the paper on the virtual VS060: errors of all methods, what a step takes, and the hierarchies one by one.

Run it by ``python -m comparisons.experiments.table_two --preset quick --seeds 3 --out DIR``; a run that was killed goes
on when it is started again. ``--jobs`` says how many methods are fitted at a time, ``--scheduler tcp://HOST:8786`` has
the workers of a Dask cluster fit them (extra ``cluster``; workers must see DIR under the same path). It writes
``table_two.json`` and ``table_two.md`` into DIR, and keeps the logs and models there. Shan and Pham, "Sensorless
Estimation of Contact Using Deep-Learning for Human-Robot Interaction", section V; the rows that the paper lacks are the
models with hysteresis, that with the effects which the gap workflow names, and the hybrid, which stands on the one with
Maxwell slip.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from comparisons.cli import run_alone
from comparisons.cluster import workers
from comparisons.comparison.contestant import Contestant
from comparisons.comparison.held_out import HeldOut
from comparisons.comparison.methods import FAMILIES, PHYSICS, Preset, training_options
from comparisons.comparison.run import summary
from comparisons.comparison.scoring import score
from comparisons.comparison.step_time import step_time
from comparisons.comparison.workshop import Workshop
from comparisons.experiments.data import PaperData, paper_data
from comparisons.experiments.table_two_gap import GapWorkshop
from comparisons.experiments.table_two_page import table_two_page
from comparisons.output import to_json
from comparisons.progress import Progress, show_nothing, show_progress
from comparisons.report.provenance import provenance
from comparisons.virtual_robot import VirtualRobot
from ident.robot import load_robot
from learned.options import TrainingOptions
from learned.predictor import LearnedModel

ROBOT = "vs060"
HIERARCHIES = ("HRDL-MD, H1", "HRDL-MD, H1-2", "HRDL-MD, H1-3")
SLIP, NAMED = "model-based, Maxwell slip", "model-based, named effects"
GAP = "gap"
MODELS: dict[str, tuple[str, bool]] = {
    "model-based, from sinusoids": ("sigmoid", True),
    "model-based": ("sigmoid", False),
    "model-based, chosen effects": (PHYSICS, False),
    SLIP: ("maxwell-slip", False),
    NAMED: (GAP, False),
}
"""Identified models: family, and whether they are identified from the sinusoids, by the name of the row."""

NETWORKS = {"MLP": "mlp", "RDL": "rdl", "LSTM": "lstm", "RDL-MD": "rdl-md", "HRDL-MD": "hrdl-md", "hybrid": "hybrid"}
BANDWIDTH = 5.0

DATA: dict[Preset, str] = {"quick": "medium", "paper": "paper"}
"""Data sets that each preset's networks learn from. Neighbouring frames say nearly the same: from the 15 minutes of
``quick`` a network learns the poses by heart, so it is better to see three hours fewer times."""

QUICK: dict[str, Any] = {"epochs": 4, "batch": 512}
"""How networks of the quick preset learn from so much, where it differs from `sensorless compare`; twice the batch
goes with twice its learning rate."""


@dataclass
class Rows:
    """Fits the methods of the table.

    Attributes:
        data: the logs.
        folder: where models are kept.
        preset, epochs, seeds, device: how networks learn, as of `sensorless compare`.
        progress: told what is being done.
        named: effects that the gap workflow has named, with their joints, once it has been asked.
    """

    data: PaperData
    folder: Path
    preset: Preset
    epochs: int | None
    seeds: int
    device: str | None
    progress: Progress
    named: dict[str, list[int]] = field(default_factory=dict)

    def fit(self) -> None:
        """Fit every run of every row side by side, within a block of `workers`; `all` then finds them done."""
        self._model(SLIP, *MODELS[SLIP])  # hybrids stand on it
        apart = dataclasses.replace(self, progress=show_nothing)
        calls = [delayed(apart._fit_model)(row) for row in MODELS if row != SLIP]
        calls += [delayed(apart._fit_network)(row, seed) for seed in range(self.seeds) for row in NETWORKS]
        for number, _ in enumerate(Parallel(return_as="generator_unordered")(calls), start=1):
            self.progress("fitting", number / len(calls))

    def _fit_model(self, row: str) -> None:
        self._model(row, *MODELS[row])

    def _fit_network(self, row: str, seed: int) -> None:
        for _ in self._network(row, NETWORKS[row], seed):
            pass

    def all(self) -> Iterator[Contestant]:
        """Yield every run of every row, seed after seed; runs of one row have its name as their method."""
        for row in MODELS:
            yield from self.runs(row)
        for seed in range(self.seeds):
            for row in NETWORKS:
                yield from self._network(row, NETWORKS[row], seed)

    def runs(self, row: str) -> Iterator[Contestant]:
        """Yield the runs of one of `MODELS` or `NETWORKS`; those of a network with hierarchies are of several rows."""
        if row in MODELS:
            yield self._model(row, *MODELS[row])
            return
        for seed in range(self.seeds):
            yield from self._network(row, NETWORKS[row], seed)

    def _model(self, row: str, family: str, excited: bool) -> Contestant:
        logs = self.data.excitation if excited else self.data.train
        workshop = GapWorkshop(self.folder, self.data.robot, logs, self.progress)
        if family == GAP:
            model, seconds, self.named = workshop.named(GAP)
            return Contestant(GAP, row, model, seconds=seconds)
        name = f"{family}-excitation" if excited else family
        model, seconds = workshop.physics(name, FAMILIES.get(family), None)
        return Contestant(name, row, model, seconds=seconds)

    def _network(self, row: str, method: str, seed: int) -> Iterator[Contestant]:
        physics = self._model(SLIP, *MODELS[SLIP]) if method == "hybrid" else None
        workshop = Workshop(self.folder, self.data.robot, self.data.train, self.progress)
        options = network_options(method, self.preset, self.epochs, seed, self.device)
        below = None if physics is None or isinstance(physics.model, LearnedModel) else physics.model
        model, seconds = workshop.network(f"{method}-seed{seed}", method, options, below)
        if method != "hrdl-md":
            yield Contestant(f"{method}-seed{seed}", row, model, seconds=seconds, seed=seed)
            return
        for number, name in enumerate(HIERARCHIES, start=1):
            whole = seconds if number == model.hierarchies else None
            part = model.truncated(number)
            yield Contestant(f"{method}-{number}-seed{seed}", name, part, seconds=whole, seed=seed)


def network_options(method: str, preset: Preset, epochs: int | None, seed: int, device: str | None) -> TrainingOptions:
    """Return how a network of the table learns; arguments as of `sensorless compare`."""
    own = training_options(method, preset, epochs, seed, device)
    if preset != "quick":
        return own
    faster = dataclasses.replace(own, **QUICK, learning_rate=2.0 * own.learning_rate)
    return faster if epochs is None else dataclasses.replace(faster, epochs=epochs)


def table_two(
    *,
    out: Path,
    preset: Preset = "quick",
    seeds: int = 3,
    epochs: int | None = None,
    data: str | None = None,
    seed: int = 0,
    device: str | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
) -> None:
    """Make the paper's Table II on the virtual VS060.

    Args:
        out: directory for the tables, the logs and the models.
        preset: quick (three hours of motion, networks of 64 neurons a layer), or paper: its amounts of data and sizes.
        seeds: trainings of each network.
        epochs: passes over the training logs at most, instead of the preset's.
        data: another preset of the data sets than `DATA` has for that of the networks.
        seed: of the data.
        device: that networks learn on: cpu or cuda.
        jobs: methods fitted at a time on this machine, -1 for one a core.
        scheduler: address of a Dask scheduler whose workers fit them instead.
    """
    out.mkdir(parents=True, exist_ok=True)
    with show_progress() as progress:
        virtual = VirtualRobot(load_robot(ROBOT))
        home = out.absolute()  # workers need not stand where this process does
        logs = paper_data(virtual, data or DATA[preset], home / "data", seed, progress)
        tests = HeldOut.of(logs.test)
        rows = Rows(logs, home / "models", preset, epochs, seeds, device, progress)
        if scheduler is not None or jobs != 1:
            with workers(scheduler, jobs):
                rows.fit()
        result = _measure(rows, tests)
    words = ["python", "-m", "comparisons.experiments.table_two", *sys.argv[1:]]
    note = provenance([out / "data"], seed=seed, command=words, libraries=("torch",))
    result |= {
        "preset": preset,
        "data": data or DATA[preset],
        "seeds": seeds,
        "epochs": network_options("mlp", preset, epochs, 0, device).epochs,
        "provenance": note.to_dict(),
    }
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
        "named": rows.named,
        "rows": {row: summary(runs) for row, runs in found.items()},
    }


if __name__ == "__main__":
    run_alone(table_two)
