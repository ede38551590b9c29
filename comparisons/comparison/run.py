"""A whole comparison: every estimator fitted, scored and timed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from comparisons.comparison.entrants import Entrants
from comparisons.comparison.held_out import HeldOut
from comparisons.comparison.kept import Kept
from comparisons.comparison.scoring import score
from comparisons.comparison.step_time import step_time
from comparisons.progress import Progress


@dataclass(frozen=True, eq=False)
class Comparison:
    """What came of a comparison.

    Attributes:
        tests: the test logs.
        methods: figures of each method by its name, as result.json holds them.
        runs: names of the runs of each method: one, or one for each seed.
        kept: residuals of the runs.
        bandwidth: at which all residuals are alike [Hz].
    """

    tests: HeldOut
    methods: dict[str, dict[str, Any]]
    runs: dict[str, list[str]]
    kept: Kept
    bandwidth: float


def run_comparison(entrants: Entrants, tests: HeldOut, kept: Kept, progress: Progress) -> Comparison:
    """Fit, score and time all estimators of a comparison.

    Raises:
        InputError: logs or options that do not suit an estimator.
    """
    bandwidth = entrants.request.bandwidth
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for contestant in entrants.all():
        progress(f"{contestant.name}: testing", 0.0)
        scored = score(contestant, tests, bandwidth)
        kept.put(scored)
        took = step_time(contestant.estimator(tests.logs[0]), tests.logs[0])
        figures = {**scored.figures, "step_us_p50": took.p50, "step_us_p99": took.p99}
        found.setdefault(contestant.method, {})[contestant.name] = figures
        progress(f"{contestant.name}: testing", 1.0)
    methods = {method: summary(runs) for method, runs in found.items()}
    return Comparison(tests, methods, {method: list(runs) for method, runs in found.items()}, kept, bandwidth)


def summary(runs: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of a method: of its only run, or the mean over its runs with their spread and each by itself.

    ``rmse_spread`` is the standard deviation over the runs, with one less than their number below.
    """
    figures = [dict(run) for run in runs.values()]
    if len(figures) == 1:
        return figures[0]
    spread = np.std([run["rmse"] for run in figures], axis=0, ddof=1)
    return {**_mean(figures), "rmse_spread": spread, "runs": dict(runs)}


def _mean(figures: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean of every figure that all runs have, over those in which it is known; what is no number is the first's."""
    return {name: _mean_of([run[name] for run in figures]) for name in figures[0] if all(name in f for f in figures)}


def _mean_of(values: Sequence[Any]) -> Any:
    first = values[0]
    if isinstance(first, Mapping):
        return _mean(values)
    numbers = [value for value in values if value is not None]
    if isinstance(first, bool | str) or not numbers:
        return first
    if isinstance(first, int) and all(value == first for value in values):
        return first
    return np.mean(numbers, axis=0)
