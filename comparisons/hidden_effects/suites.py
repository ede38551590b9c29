"""Which cases a run consists of: every effect at every severity on rotating robots and joints, mixtures, none."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import numpy as np

from comparisons.hidden_effects.cases import CHANGES, WHOLE_ROBOT, Case, Hidden, robot_of
from comparisons.hidden_effects.laws import FOREIGN, LAWS
from comparisons.hidden_effects.styles import POOR, STYLES
from comparisons.virtual_robot.figures import link_torque, usual_torque
from ident.arrays import BoolArray

KINDS = ("single", "changed", "pair", "triple", "nothing", "foreign", "tie")
"""Sets of cases; ``changed`` are single effects that show only against a model identified before, ``tie`` single
effects in logs too poor to tell some from others, of which those count whose name is left open."""

STRUCTURAL = tuple(name for name in LAWS if name not in CHANGES)

OF_LOAD, CARRIES = ("backlash", "elasticity", "load-friction"), 0.1
"""Effects that act through a joint's load, and the share of its usual torque that the links must ask for: on a joint
that carries nothing they reach a severity only if springs wind up by radians, or more load is lost than there is."""

AT_REST = ("coulomb-asymmetry",)
"""Effects that show only between rest and motion."""


@dataclass(frozen=True)
class Sizes:
    """How many cases a run has.

    Attributes:
        per_effect: cases of each effect at each severity.
        severities: of single effects, in the catalogue and outside.
        mixtures: pairs, and as many triples, at each severity from one.
        nothing: cases in which nothing is hidden; every fourth asks what changed.
        robots: their names, taken in turn.
        styles: how they are moved and logged, of `STYLES`, taken in turn.
    """

    per_effect: int
    severities: tuple[float, ...]
    mixtures: int
    nothing: int
    robots: tuple[str, ...]
    styles: tuple[str, ...] = ("usual",)


SUITES = {
    "small": Sizes(1, (2.0,), 3, 6, ("vs060", "ur10")),
    "full": Sizes(4, (0.5, 1.0, 2.0, 5.0), 40, 400, ("vs060", "ur10", "panda", "xarm7")),
}

Suite = Literal["small", "full"]


@dataclass(frozen=True)
class Task:
    """A case and the set that it belongs to."""

    kind: str
    case: Case

    @property
    def name(self) -> str:
        """A name unlike that of any other task of a run."""
        return f"{self.kind}-{self.case.name}{'-changed' if self.case.changed else ''}"


def tasks(sizes: Sizes, seed: int, kinds: Sequence[str] = KINDS) -> list[Task]:
    """Return the cases of a run; the same seed gives the same cases, whatever other sets are left out."""
    made = {
        "single": lambda: _singles("single", STRUCTURAL, sizes, seed),
        "changed": lambda: _singles("changed", CHANGES, sizes, seed),
        "foreign": lambda: _singles("foreign", tuple(FOREIGN), sizes, seed),
        "pair": lambda: _mixtures("pair", 2, sizes, seed),
        "triple": lambda: _mixtures("triple", 3, sizes, seed),
        "nothing": lambda: _nothing(sizes, seed),
        "tie": lambda: _singles("tie", STRUCTURAL, replace(sizes, styles=tuple(POOR)), seed),
    }
    return [task for kind in KINDS if kind in kinds for task in made[kind]()]


def shuffled(listed: Sequence[Any], seed: int) -> list[Any]:
    """Shuffle, so that a run that is broken off has seen a bit of everything."""
    order = np.random.default_rng([seed, 77]).permutation(len(listed))
    return [listed[k] for k in order]


def _singles(kind: str, effects: Sequence[str], sizes: Sizes, seed: int) -> Iterator[Task]:
    for effect in effects:
        # An effect keeps its robots and joints at all severities: curves then compare like with like.
        first = zlib.crc32(effect.encode()) + seed
        for number in range(sizes.per_effect):
            robot = sizes.robots[(first + number) % len(sizes.robots)]
            joint = _joint(effect, robot, first // 7 + 2 * number)
            for severity in sizes.severities:
                hidden = Hidden(effect, joint, severity)
                style = sizes.styles[(first // 3 + number) % len(sizes.styles)]
                if effect in AT_REST and style in STYLES and STYLES[style].holds:
                    continue  # what dry friction holds hides it
                case = Case(robot, (hidden,), 1000 * seed + number, changed=effect in CHANGES, style=style)
                yield Task(kind, case)


def _joint(effect: str, robot: str, first: int) -> int | None:
    """The first joint, from one on, that could have an effect; None for an effect of the whole robot."""
    if effect in WHOLE_ROBOT:
        return None
    able = np.ones(robot_of(robot).n, dtype=bool) if effect not in OF_LOAD else _carrying(robot)
    return next(j for k in range(len(able)) if able[j := (first + k) % len(able)])


@cache
def _carrying(robot: str) -> BoolArray:
    loaded = robot_of(robot)
    return link_torque(loaded) >= CARRIES * usual_torque(loaded)


def _mixtures(kind: str, count: int, sizes: Sizes, seed: int) -> Iterator[Task]:
    for severity in [s for s in sizes.severities if s >= 1.0]:
        rng = np.random.default_rng([seed, count, round(10 * severity)])
        for number in range(sizes.mixtures):
            robot = sizes.robots[(number + seed) % len(sizes.robots)]
            names = [str(n) for n in rng.choice(STRUCTURAL, count, replace=False)]
            drawn = rng.integers(0, robot_of(robot).n, count).tolist()
            hidden = tuple(
                Hidden(name, _joint(name, robot, first), severity) for name, first in zip(names, drawn, strict=True)
            )
            style = sizes.styles[number % len(sizes.styles)]
            yield Task(kind, Case(robot, hidden, 1000 * seed + 300 + number, style=style))


def _nothing(sizes: Sizes, seed: int) -> Iterator[Task]:
    for number in range(sizes.nothing):
        robot = sizes.robots[(number + seed) % len(sizes.robots)]
        style = sizes.styles[number // len(sizes.robots) % len(sizes.styles)]
        case = Case(robot, (), 1000 * seed + 500 + number, style=style)
        yield Task("nothing", replace(case, changed=True) if number % 4 == 3 else case)
