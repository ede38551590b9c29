"""Candidates of a screening: groups of thresholds, and how to train with them."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

from ident.errors import InputError
from learned.motion_discriminator import PLAY_THRESHOLDS, TABLE_I, Signal
from learned.networks import METHODS
from learned.options import TrainingOptions

KEYS = ("name", "method", "thresholds", "signal", "hierarchies")


@dataclass(frozen=True)
class Candidate:
    """Thresholds to try.

    Attributes:
        name: of the candidate.
        thresholds: of the discriminator [rad/s; displacement: rad], in their groups one after another.
        method: the network, with the discriminator or without.
        signal: that the thresholds are of.
        hierarchies: networks that the thresholds are dealt to; of methods that have them.
    """

    name: str
    thresholds: tuple[float, ...] = ()
    method: str = "hrdl-md"
    signal: Signal = "velocity"
    hierarchies: int = 1

    def options(self, base: TrainingOptions) -> TrainingOptions:
        """Return how to train this candidate."""
        thresholds = self.thresholds or base.thresholds
        return dataclasses.replace(base, hierarchies=self.hierarchies, signal=self.signal, thresholds=thresholds)

    def result(self) -> dict[str, Any]:
        """Return it as it stands in the result."""
        return dataclasses.asdict(self)


H1, H2, H3 = TABLE_I

GRID: tuple[Candidate, ...] = (
    Candidate("no discriminator", method="rdl"),
    Candidate("one threshold, 0.002", (0.002,)),
    Candidate("one threshold, 0.010", (0.010,)),
    Candidate("one threshold, 0.028", (0.028,)),
    Candidate("the paper's first group", H1),
    Candidate("the paper's second group", H2),
    Candidate("the paper's third group", H3),
    Candidate("all of Table I, one network", tuple(sorted({*H1, *H2, *H3}))),
    Candidate("Table I, three hierarchies", (*H1, *H2, *H3), hierarchies=3),
    Candidate("finer, 1 to 5 mrad/s", (0.001, 0.002, 0.003, 0.004, 0.005)),
    Candidate("coarser, 20 to 100 mrad/s", (0.02, 0.04, 0.06, 0.08, 0.10)),
    Candidate("spread, 2 to 100 mrad/s", (0.002, 0.005, 0.014, 0.037, 0.10)),
    Candidate("median velocity, first group", H1, signal="median-velocity"),
    Candidate("displacement, 0.5 to 10 mrad", PLAY_THRESHOLDS, signal="displacement"),
)
"""The paper's groups, each by itself and together, and what lies below, above, between and beside them."""


def load_grid(path: Path | None) -> tuple[Candidate, ...]:
    """Return the candidates of a TOML file with tables ``[[candidate]]``; `GRID` where there is no file.

    Raises:
        InputError: there is no such file, or it holds no candidates, or one of them is wrong.
    """
    if path is None:
        return GRID
    where = f"grid {path}"
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError("no such file", where, "give a TOML file of candidates") from error
    except (tomllib.TOMLDecodeError, UnicodeError) as error:
        raise InputError(f"not valid TOML ({error})", where, "mend that line") from error
    given = tables.get("candidate")
    if not isinstance(given, list) or not given or set(tables) != {"candidate"}:
        raise InputError("no [[candidate]], or other tables", where, "give a table [[candidate]] for each, no other")
    found = tuple(_candidate(table, where) for table in given)
    names = [one.name for one in found]
    if len(set(names)) < len(names):
        raise InputError("two candidates have one name", where, "rename one of them")
    return found


def _candidate(table: dict[str, Any], where: str) -> Candidate:
    unknown = sorted(set(table) - set(KEYS))
    if unknown:
        raise InputError(f"unknown key {unknown[0]!r}", where, f"give some of {', '.join(KEYS)}")
    name, thresholds = table.get("name"), table.get("thresholds", [])
    if not isinstance(name, str) or not name or "/" in name:
        raise InputError(f"a candidate's name is {name!r}", where, "give a word or two without /")
    if not isinstance(thresholds, list) or not all(isinstance(v, int | float) and v > 0.0 for v in thresholds):
        raise InputError(f"thresholds of {name!r} are {thresholds!r}", where, "give positive numbers")
    method, signal, hierarchies = (
        table.get("method", "hrdl-md"),
        table.get("signal", "velocity"),
        table.get("hierarchies", 1),
    )
    if method not in METHODS or method == "hybrid":
        known = ", ".join(m for m in METHODS if m != "hybrid")
        raise InputError(f"method of {name!r} is {method!r}", where, f"give one of {known}")
    if signal not in get_args(Signal):
        raise InputError(f"signal of {name!r} is {signal!r}", where, f"give one of {', '.join(get_args(Signal))}")
    if not isinstance(hierarchies, int) or hierarchies < 1:
        raise InputError(f"hierarchies of {name!r} are {hierarchies!r}", where, "give a whole number from 1 up")
    return Candidate(name, tuple(float(v) for v in thresholds), method, cast("Signal", signal), hierarchies)
