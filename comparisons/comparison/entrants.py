"""From names of methods to estimators, each fitted when its turn comes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from comparisons.comparison.contestant import Contestant
from comparisons.comparison.methods import (
    PHYSICS,
    Preset,
    effects_of,
    is_direct,
    is_network,
    is_observer,
    known,
    training_options,
)
from comparisons.comparison.workshop import Workshop
from ident.errors import InputError
from ident.model import CurrentModel
from ident.model_file import load_model
from learned.model_file import is_trained_model
from learned.predictor import LearnedModel
from observers.model_based import known_gain

if TYPE_CHECKING:
    from ident.arrays import FloatArray
    from ident.robot import Robot


@dataclass(frozen=True)
class Request:
    """What is asked of a comparison.

    Attributes:
        methods: names, as of `parse_methods`.
        preset: how long networks learn and how wide they are.
        epochs: passes over the training logs at most, instead of the preset's.
        seeds: trainings of each network.
        bandwidth: of the residuals [Hz] at which all are alike.
        cutoff: of the filter that derives velocity and acceleration [Hz]; chosen from the logs where None.
        device: that networks learn on; chosen where None.
    """

    methods: tuple[str, ...]
    preset: Preset = "quick"
    epochs: int | None = None
    seeds: int = 1
    bandwidth: float = 5.0
    cutoff: float | None = None
    device: str | None = None

    def __post_init__(self) -> None:
        for name, value in (("epochs", self.epochs), ("seeds", self.seeds), ("bandwidth", self.bandwidth)):
            if value is not None and not value > 0:
                raise InputError(f"{name} of {value}", f"--{name}", "give a number above 0")


@dataclass
class Entrants:
    """Makes the estimators of a comparison.

    Attributes:
        request: what is asked.
        workshop: where models are fitted.
        given: models made before, by name; one of the name `PHYSICS` is what observers and hybrids stand on.
    """

    request: Request
    workshop: Workshop
    given: dict[str, CurrentModel | LearnedModel]

    def all(self) -> Iterator[Contestant]:
        """Yield the estimators in the order of the methods, then the models given, each fitted when it is asked for."""
        for method in self.request.methods:
            if is_observer(method):
                yield self._contestant(method, method, *self._physics, observer=method)
            elif method in self.given:
                yield self._contestant(method, method, self.given[method], None)
            elif is_network(method):
                yield from self._trained(method)
            else:
                yield self._contestant(method, method, *self._identified(method))
        for name, model in self.given.items():
            if name not in self.request.methods:
                yield self._contestant(name, name, model, None)

    def _trained(self, method: str) -> Iterator[Contestant]:
        request = self.request
        for seed in range(request.seeds):
            name = method if request.seeds == 1 else f"{method}-seed{seed}"
            options = training_options(method, request.preset, request.epochs, seed, request.device)
            below = self._physics[0] if method == "hybrid" else None
            model, seconds = self.workshop.network(name, method, options, below)
            yield self._contestant(name, method, model, seconds, seed=seed)

    def _identified(self, method: str) -> tuple[CurrentModel, float | None]:
        if method == PHYSICS:
            return self._physics
        return self.workshop.physics(method, effects_of(method), self.request.cutoff)

    @cached_property
    def _physics(self) -> tuple[CurrentModel, float | None]:
        given = self.given.get(PHYSICS)
        if isinstance(given, CurrentModel):
            return given, None
        return self.workshop.physics(PHYSICS, effects_of(PHYSICS), self.request.cutoff)

    @cached_property
    def _gain(self) -> FloatArray | None:
        """Drive gains that the card or the identified model knows."""
        given = self.given.get(PHYSICS)
        return known_gain(given) if isinstance(given, CurrentModel) else self.workshop.robot.gain

    def _contestant(
        self,
        name: str,
        method: str,
        model: CurrentModel | LearnedModel,
        seconds: float | None,
        observer: str | None = None,
        seed: int | None = None,
    ) -> Contestant:
        return Contestant(
            name,
            method,
            model,
            observer,
            self.request.bandwidth,
            self._gain,
            seconds,
            seed,
            self.workshop.robot.coupling,
        )


def load_models(folders: Sequence[Path], robot: Robot) -> dict[str, CurrentModel | LearnedModel]:
    """Read the models that earlier runs made, each by the name of its folder; the first identified one is `PHYSICS`.

    Raises:
        InputError: a folder holds no model, one of another robot, or has the name of a method or of another folder.
    """
    found: dict[str, CurrentModel | LearnedModel] = {}
    for folder in folders:
        trained = is_trained_model(folder)
        first = PHYSICS not in found and not trained
        name = PHYSICS if first else folder.resolve().name
        if name in found or (not first and (name in known() or is_direct(name))):
            what = f"two models would be named {name}"
            raise InputError(what, f"--model {folder}", "rename the folder: models are named after theirs")
        found[name] = LearnedModel.load(folder, robot) if trained else load_model(folder, robot)
    return found
