"""What can be compared, by name, and how long networks learn."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from ident.effects import load_catalogue
from ident.errors import InputError
from learned.networks import METHODS as NETWORKS

if TYPE_CHECKING:
    from learned.options import TrainingOptions

PHYSICS = "physics"
"""The model that identify chooses; observers and hybrids stand on it."""

FAMILIES: dict[str, tuple[str, ...]] = {
    "coulomb-viscous": ("coulomb", "viscous"),
    "sigmoid": ("sigmoid", "viscous"),
    "stribeck": ("coulomb", "viscous", "stribeck"),
    "maxwell-slip": ("maxwell-slip", "viscous"),
}
"""Effects that every joint gets besides links, rotor and offset, by the name of the family."""

OBSERVERS = ("gmo", "kalman", "disturbance", "sliding-mode")
FURTHER_OBSERVERS = ("filtered-dynamics",)

GROUPS: dict[str, tuple[str, ...]] = {
    "direct": (PHYSICS, *FAMILIES),
    "observers": OBSERVERS,
    "learned": tuple(name for name in NETWORKS if name != "hrdl"),
}
"""Names that stand for several methods."""
GROUPS["default"] = (*GROUPS["direct"], *GROUPS["observers"])
GROUPS["all"] = (*GROUPS["default"], *GROUPS["learned"])

Preset = Literal["quick", "paper"]

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {"epochs": 15, "patience": 5, "batch": 256, "width": 64},
    "paper": {},
}
"""Training options in place of those that a method suggests, which are the paper's for its own methods."""


def parse_methods(given: Sequence[str]) -> list[str]:
    """Return methods in the order given, each once, from names, lists with commas and groups.

    A name is one of the families, observers and networks, or effects of the catalogue joined by ``+``, which every
    joint then gets.

    Raises:
        InputError: no method has such a name, or none is named.
    """
    names = [name.strip() for words in given for name in words.split(",")]
    found = [method for name in names if name for method in GROUPS.get(name, (name,))]
    if not found:
        raise InputError("no method", "--methods", f"give some of {', '.join(known())}")
    for name in found:
        if name not in known() and not is_direct(name):
            near = difflib.get_close_matches(name, known(), n=1)
            how = f"did you mean {near[0]}?" if near else f"give some of {', '.join(known())}, or effects joined by +"
            raise InputError(f"no method {name!r}", "--methods", how)
    return list(dict.fromkeys(found))


def known() -> list[str]:
    """Names of all methods and groups."""
    return [PHYSICS, *FAMILIES, *OBSERVERS, *FURTHER_OBSERVERS, *NETWORKS, *GROUPS]


def is_observer(name: str) -> bool:
    """Tell whether a method is an observer that stands on the identified model."""
    return name in (*OBSERVERS, *FURTHER_OBSERVERS)


def is_network(name: str) -> bool:
    """Tell whether a method is trained."""
    return name in NETWORKS


def is_direct(name: str) -> bool:
    """Tell whether a method is a physical model compared with the current as it is."""
    return name in (PHYSICS, *FAMILIES) or ("+" in name and set(name.split("+")) <= set(load_catalogue()))


def effects_of(name: str) -> tuple[str, ...] | None:
    """Effects that a physical model is identified with; None for `PHYSICS`, which chooses its own."""
    return None if name == PHYSICS else FAMILIES.get(name) or tuple(name.split("+"))


def training_options(method: str, preset: Preset, epochs: int | None, seed: int, device: str | None) -> TrainingOptions:
    """Return how a network learns: what its method suggests, changed by the preset, then by what the user says."""
    from learned.options import suggested

    own = suggested(method)
    changes = dict(PRESETS[preset])
    if "width" in changes:
        changes["width"] = min(changes["width"], own.width or changes["width"])
    if epochs is not None:
        changes["epochs"] = epochs
    return dataclasses.replace(own, **changes, seed=seed, device=device)
