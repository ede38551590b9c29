"""A screening as Markdown and as a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.report import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REGIMES = {"rmse": "all frames", "rmse_static": "static", "rmse_moving": "moving", "rmse_transition": "transition"}


@dataclass(frozen=True)
class Rank:
    """A candidate's place.

    Attributes:
        name: of the candidate.
        mean: of the figure that the choice goes by, over joints and folds.
        folds: that figure in each fold, (K,), mean over the joints.
        behind: how much more than the best candidate's it is, mean over the folds.
        spread: standard error of that, from the folds' differences.
    """

    name: str
    mean: float
    folds: np.ndarray[Any, np.dtype[np.float64]]
    behind: float
    spread: float


def ranked(result: Mapping[str, Any]) -> list[Rank]:
    """Return the candidates of a result, best first; folds are compared fold by fold."""
    folds = {name: _folds(one, result["by"]) for name, one in result["candidates"].items()}
    best = min(folds.values(), key=lambda values: float(values.mean()))
    places = []
    for name, values in folds.items():
        apart = values - best
        spread = float(apart.std(ddof=1) / np.sqrt(len(apart)))
        places.append(Rank(name, float(values.mean()), values, float(apart.mean()), spread))
    return sorted(places, key=lambda place: place.mean)


def screening_page(result: Mapping[str, Any]) -> str:
    """Return the page of a result of `screening`."""
    unit, by = result["unit"], result["by"]
    places = ranked(result)
    level = [place.name for place in places[1:] if place.behind < 2.0 * place.spread]
    told = f"`{places[0].name}` is chosen, by {REGIMES[by]}"
    told += f"; not told from it by two standard errors: {', '.join(level)}." if level else ", ahead of all others."
    lines = [
        "# Thresholds of the motion discriminator, screened\n",
        f"{len(result['folds'])} folds, each candidate trained without each of them and judged on it; "
        f"{result['width']} neurons a layer, {result['epochs']} epochs. RMSE [{unit}], means over joints and folds; "
        "behind: more than the best, paired fold by fold, with its standard error. Few folds make a rough standard "
        "error.\n",
        told + "\n",
        f"| candidate | thresholds | {' | '.join(REGIMES.values())} | behind |",
        "|---|---|" + "---:|" * (len(REGIMES) + 1),
    ]
    for place in places:
        one = result["candidates"][place.name]
        cells = [f"{float(_folds(one, key).mean()):.2f}" for key in REGIMES]
        thresholds = ", ".join(f"{1e3 * v:g}" for v in one["thresholds"]) or "none"
        behind = "" if place is places[0] else f"{place.behind:.2f} ± {place.spread:.2f}"
        lines.append(f"| {place.name} | {thresholds} | {' | '.join(cells)} | {behind} |")
    command, date = result["provenance"]["command_line"], result["provenance"]["date"]
    lines += ["\nThresholds in mrad/s, of displacements in mrad.\n", f"Made by `{command}`, {date}.\n"]
    return "\n".join(lines)


def screening_figure(result: Mapping[str, Any]) -> Figure:
    """Draw every candidate's folds and mean, best on top."""
    places = ranked(result)
    figure = style.new_figure(9.0, 0.9 + 0.28 * len(places))
    with style.report_style():
        axis = figure.subplots()
        for row, place in enumerate(places):
            axis.plot(place.folds, [row] * len(place.folds), "o", color=style.MEASURED, alpha=0.6, markersize=4)
            axis.plot([place.mean], [row], "|", color=style.PREDICTED, markersize=13, markeredgewidth=2.5)
        axis.plot([], [], "o", color=style.MEASURED, alpha=0.6, label="fold")
        axis.plot([], [], "|", color=style.PREDICTED, markeredgewidth=2.5, label="mean")
        axis.set_yticks(range(len(places)), [place.name for place in places])
        axis.set_ylim(len(places) - 0.5, -0.5)
        axis.set_xlim(left=0.0)
        axis.set_xlabel(f"RMSE, {REGIMES[result['by']]} [{result['unit']}]")
        axis.grid(axis="y", visible=False)
        style.legend_above(figure, axis)
    return figure


def _folds(one: Mapping[str, Any], key: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A figure of each fold, (K,), mean over the joints that have it."""
    return np.array([np.nanmean(np.array(fold[key], dtype=float)) for fold in one["folds"]])
