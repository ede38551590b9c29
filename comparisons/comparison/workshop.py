"""Where the models of a comparison are fitted, each once: what is done is kept, so a killed run goes on."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from comparisons.progress import Progress
from ident.log import LogSource
from ident.model import CurrentModel
from ident.model_file import load_model, save_model
from learned.predictor import LearnedModel

if TYPE_CHECKING:
    from ident.robot import Robot
    from learned.options import Progress as Stand
    from learned.options import TrainingOptions

DONE, BEGUN = "fit.json", "begun.json"


@dataclass
class Workshop:
    """Fits models in folders of their own under ``folder``; what was fitted there before in the same way is read.

    Attributes:
        folder: where the models are kept.
        robot: the robot.
        logs: training logs.
        progress: told what is being done.
        earlier: folder of models of a run that is done, which are taken over where they were fitted in the same way.
        made: folder of each model used, by name.
    """

    folder: Path
    robot: Robot
    logs: Sequence[LogSource]
    progress: Progress
    earlier: Path | None = None
    made: dict[str, Path] = field(default_factory=dict)

    def physics(self, name: str, effects: Sequence[str] | None, cutoff: float | None) -> tuple[CurrentModel, float]:
        """Identify a model, and return it with the seconds it took."""
        from ident.identification import identify

        place = self._place(name, f"{effects} {cutoff}")

        def fit(place: Path) -> None:
            def tell(what: str, share: float) -> None:
                self.progress(f"{name}: {what}", share)

            save_model(identify(self.robot, self.logs, cutoff=cutoff, effects=effects, progress=tell).model, place)

        seconds = self._once(place, fit)
        return load_model(place, self.robot), seconds

    def network(
        self, name: str, method: str, options: TrainingOptions, physics: CurrentModel | None
    ) -> tuple[LearnedModel, float]:
        """Train a network, and return it with the seconds it took; ``physics`` is what a hybrid stands on."""
        below = (
            None if physics is None else [(t.effect, t.shape.tolist(), t.coefficients.tolist()) for t in physics.terms]
        )
        place = self._place(name, f"{method} {options} {below}")

        def fit(place: Path) -> None:
            from learned.training import train

            train(self.robot, self.logs, None, method, options, place, self._told(name, place), physics)

        seconds = self._once(place, fit)
        return LearnedModel.load(place, self.robot), seconds

    def publish(self, folder: Path) -> None:
        """Copy the models used into ``folder``."""
        for name, place in self.made.items():
            shutil.copytree(place, folder / name, ignore=shutil.ignore_patterns(BEGUN))

    def _once(self, place: Path, fit: Callable[[Path], None]) -> float:
        """Fit into a folder unless that is done, and return the seconds it took, earlier attempts included."""
        if not (place / DONE).is_file():
            place.mkdir(parents=True, exist_ok=True)
            before, start = _seconds(place / BEGUN), time.perf_counter()
            fit(place)
            _write(place / DONE, {"key": place.name, "seconds": before + time.perf_counter() - start})
        return _seconds(place / DONE)

    def _place(self, name: str, how: str) -> Path:
        """Folder of a model, named by all that decides what comes of it."""
        what = f"{self.robot.card} {[_stamp(log) for log in self.logs]} {how}"
        place = self.folder / f"{name}-{hashlib.sha256(what.encode()).hexdigest()[:12]}"
        former = None if self.earlier is None else self.earlier / name
        if former is not None and not place.exists() and _key(former / DONE) == place.name:
            shutil.copytree(former, place)
        self.made[name] = place
        return place

    def _told(self, name: str, place: Path) -> Callable[[Stand], None]:
        """Show where a training stands, and note how long it has taken, should it be killed."""
        before, start = _seconds(place / BEGUN), time.perf_counter()

        def tell(stand: Stand) -> None:
            _write(place / BEGUN, {"seconds": before + time.perf_counter() - start})
            what = f"{name}: network {stand.stage} of {stand.stages}, loss {stand.validation:.4f}"
            self.progress(what, stand.epoch / stand.epochs)

        return tell


def _stamp(log: LogSource) -> str:
    """Name of a log and, of a file, its size and the time it was last written."""
    path = getattr(log, "path", None)
    if not isinstance(path, Path) or not path.exists():
        return repr(log)
    status = path.stat()
    return f"{path.resolve()} {status.st_size} {status.st_mtime_ns}"


def _write(path: Path, content: dict[str, Any]) -> None:
    """Write a file so that a kill leaves the old one or the new one."""
    beside = path.with_suffix(".part")
    beside.write_text(json.dumps(content) + "\n", encoding="utf-8")
    beside.replace(path)


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _seconds(path: Path) -> float:
    return float(_read(path).get("seconds", 0.0))


def _key(path: Path) -> str:
    return str(_read(path).get("key", ""))
