"""The benchmark's figures as JSON-like values, as a page of markdown, and as plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.hidden_effects.answer import Truth, truth_from
from comparisons.hidden_effects.identifiability import SURE
from comparisons.hidden_effects.rates import Score
from comparisons.hidden_effects.scoring import TIES, Judged, calibration, confusion, curves, table
from comparisons.hidden_effects.work import judged

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ENOUGH = 1.0
"""Least severity in the table."""

CLEAR = 0.8
"""Least clarity of effects that count as identifiable, if the logs tell them from their rivals, too; at severity 1 the
baseline then errs by 1.25 times the noise."""

TARGETS = {
    "first name right": ">= 95 %",
    "true name in name + alternatives": ">= 99 %",
    "joint right": ">= 99 %",
    "a name, where nothing is hidden": "<= 1 %",
    "silence on effects outside the catalogue": ">= 95 %",
    "test RMSE over that with the law known": "<= 1.03",
    "main parameter's error": "<= 5 %",
    TIES: ">= 95 %",
    "F1, two effects": ">= 0.92",
}
"""What the gap workflow is to reach."""

PLAIN = (
    "test RMSE over that with the law known",
    "test RMSE over the noise",
    "F1, two effects",
    "F1, three effects",
)
"""Figures that are no percentages."""

CURVES = ("first name right", "true name in name + alternatives", "joint right", "main parameter's error")


def results(records: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> dict[str, Any]:
    """Score the records of a run, method by method."""
    found: dict[str, Any] = {
        "cases": sum(r["truth"] is not None for r in records),
        "cases_not_made": [r["name"] for r in records if r["truth"] is None],
        "not_told_apart": _not_told_apart(records),
        "methods": {},
    }
    for method in methods:
        asked = [j for r in records if (j := judged(r, method)) is not None]
        strong = [j for j in asked if j.truth.severity is None or j.truth.severity >= ENOUGH]
        weak = [j for j in asked if j.truth.severity is not None and j.truth.severity < ENOUGH]
        found["methods"][method] = {
            "table": _scores(table(strong)),
            "identifiable": _scores(table([j for j in strong if _identifiable(j.truth)])),
            "weak": _scores(table(weak)),
            "curves": {row: _scores(scores) for row, scores in curves(asked).items()},
            "calibration": {what: _scores(scores) for what, scores in calibration(asked).items()},
            "confusion": confusion([j for j in strong if j.truth.kind != "deleted"]),
            "broke_down": [j.truth.name for j in asked if j.answer is None],
            "seconds_median": Score.median(j.answer.seconds for j in asked if j.answer is not None).value,
            "wrong": wrong(strong),
        }
    return found


def _identifiable(truth: Truth) -> bool:
    """Whether what a case hides, if anything, is clear, and told from its rivals by the logs."""
    return truth.clarity is None or (truth.clarity >= CLEAR and truth.told_apart)


def wrong(cases: Sequence[Judged]) -> list[str]:
    """Return, for each case that is not answered rightly, what was hidden and what was said."""
    lines = []
    for j in cases:
        if j.truth.kind in ("single", "changed"):
            right = j.name_right and j.joint_right and len(j.findings) == 1
        elif j.truth.kind == "foreign":
            right = j.silent
        else:
            right = j.counts[1:] == (0, 0) and j.answer is not None
        if not right:
            said = [f"{n.effect}@{_joints(n.joints)}" for n in j.findings]
            also = [f"?@{_joints(u)}" for u in (j.answer.unexplained if j.answer is not None else ())]
            lines.append(f"{j.truth.name}: {', '.join([*said, *also]) or 'silent'}")
    return lines


def page(found: Mapping[str, Any]) -> str:
    """Return the page: the table, the same at less than severity one, calibration, and what was got wrong."""
    note = found["provenance"]
    lines = ["# Hidden effects", "", f"`{note['command_line']}`, {note['date']}; {found['cases']} cases.", ""]
    if found["cases_not_made"]:
        lines += [f"Not made, and in no figure: {', '.join(found['cases_not_made'])}.", ""]
    lines += [
        f"Severity {ENOUGH:g} and more; 95 % intervals (Wilson's; of F1 by resampling; of medians the quartiles) "
        "and of how many.",
        "",
        *_table(found["methods"], "table"),
    ]
    lines += [
        "",
        f"The same where the effect is at least {CLEAR:g} of what the baseline leaves with it taken away, and its own "
        f"law is nearer to it than its rivals' by {SURE:g} standard deviations of the noise:",
        "",
        *_table(found["methods"], "identifiable"),
    ]
    if found["not_told_apart"]:
        listed = ", ".join(f"{name} ({value:.1f})" for name, value in found["not_told_apart"].items())
        lines += ["", f"Not told from a rival by so much: {listed}."]
    if any(of["weak"] for of in found["methods"].values()):
        lines += ["", f"Severity below {ENOUGH:g}:", "", *_table(found["methods"], "weak")]
    for method, of in found["methods"].items():
        if of["broke_down"]:
            lines += ["", f"{method} broke down, which counts as wrong, on: {', '.join(of['broke_down'])}."]
    lines += ["", "Median seconds a case: " + ", ".join(
        f"{m} {of['seconds_median']:.1f}" for m, of in found["methods"].items()
    ) + " (rivals without building the columns that they share).", ""]  # fmt: skip
    first = next(iter(found["methods"].items()), None)
    if first is not None:
        lines += _calibrated(*first)
        lines += [f"Not answered rightly by {first[0]}:", "", *(f"- {w}" for w in first[1]["wrong"] or ["none"]), ""]
    return "\n".join(lines)


def plots(found: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw curves over severity, calibration, and the first method's confusion of names; return the files."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    from comparisons.report.style import report_style

    methods = found["methods"]
    drawn = []
    with report_style():
        drawn.append(_plot_curves(methods, folder / "severity.svg"))
        for method, of in list(methods.items())[:1]:
            drawn.append(_plot_calibration(of["calibration"], folder / "calibration.svg"))
            if of["confusion"]:
                drawn.append(_plot_confusion(method, of["confusion"], folder / "confusion.svg"))
    return drawn


def _not_told_apart(records: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Cases whose logs do not tell what is hidden from its rivals, each with the standard deviations that they do."""
    truths = [truth_from(r["truth"]) for r in records if r["truth"] is not None]
    return {t.name: t.margin for t in truths if t.margin is not None and not t.told_apart}


def _scores(scores: Mapping[Any, Score]) -> dict[str, dict[str, Any]]:
    return {f"{key:g}" if isinstance(key, float) else key: asdict(score) for key, score in scores.items()}


def _joints(joints: Sequence[int]) -> str:
    return "+".join(str(j + 1) for j in joints) or "all"


def _table(methods: Mapping[str, Any], which: str) -> list[str]:
    left_out = {TIES} if which == "identifiable" else set()  # ties are what logs do not tell
    rows = [row for row in dict.fromkeys(row for of in methods.values() for row in of[which]) if row not in left_out]
    lines = [f"| | target | {' | '.join(methods)} |", "|---|---|" + "---|" * len(methods)]
    for row in rows:
        cells = [_cell(row, of[which].get(row)) for of in methods.values()]
        target = TARGETS.get(row, "") if which != "weak" else ""
        lines.append(f"| {row} | {target} | {' | '.join(cells)} |")
    return lines


def _cell(row: str, score: Mapping[str, Any] | None) -> str:
    if score is None or not score["of"]:
        return ""
    low, high = score["interval"]
    if row in PLAIN:
        return f"{score['value']:.2f} ({low:.2f} to {high:.2f}; {score['of']})"
    return f"{100 * score['value']:.1f} % ({100 * low:.1f} to {100 * high:.1f}; {score['of']})"


def _calibrated(method: str, of: Mapping[str, Any]) -> list[str]:
    given = of["calibration"]
    lines = [
        f"Stated p-values of {method}: share of cases with nothing hidden in which the best candidate has that p or "
        "less, in which a name is given at it, and share of names stated between the level before and this one that "
        "are wrong with all their alternatives.",
        "",
        "| p | best candidate, nothing hidden | named, nothing hidden | wrong names |",
        "|---|---|---|---|",
    ]
    for level in given["nothing hidden"]:
        others = [_cell("", given[what][level]) for what in ("candidates", "nothing hidden", "names")]
        lines.append(f"| {level} | {' | '.join(others)} |")
    return [*lines, ""]


def _plot_curves(methods: Mapping[str, Any], path: Path) -> Path:
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, len(CURVES), figsize=(13, 3.2), layout="constrained")
    for row, axes in zip(CURVES, panels, strict=True):
        for method, of in methods.items():
            _curve(axes, method, of["curves"].get(row, {}))
        axes.set(title=row, xscale="log", xlabel="severity [RMS over noise]", ylim=(0, 1.02))
    if panels[0].get_legend_handles_labels()[0]:
        panels[0].legend()
    figure.savefig(path)
    plt.close(figure)
    return path


def _curve(axes: Axes, label: str, scores: Mapping[str, Mapping[str, Any]]) -> None:
    known = {float(x): score for x, score in scores.items() if score["of"]}
    if not known:
        return
    x = sorted(known)
    y = np.array([known[k]["value"] for k in x])
    low, high = np.array([known[k]["interval"] for k in x]).T
    axes.errorbar(x, y, yerr=[np.maximum(y - low, 0.0), np.maximum(high - y, 0.0)], label=label, marker="o", capsize=2)


def _plot_calibration(given: Mapping[str, Any], path: Path) -> Path:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(4.5, 4.0), layout="constrained")
    for label, scores in given.items():
        _curve(axes, label, scores)
    levels = [float(level) for level in given["nothing hidden"]]
    axes.plot(levels, levels, color="black", linewidth=0.8, label="as stated")
    axes.set(xscale="log", xlabel="stated p-value", ylabel="observed rate of false names", ylim=(-0.02, 1.02))
    axes.legend()
    figure.savefig(path)
    plt.close(figure)
    return path


def _plot_confusion(method: str, counts: Mapping[str, Mapping[str, int]], path: Path) -> Path:
    import matplotlib.pyplot as plt

    hidden = list(counts)
    said = [*(h for h in hidden if h != "nothing"), *sorted({s for row in counts.values() for s in row} - {*hidden})]
    shares = np.array([[counts[h].get(s, 0) / sum(counts[h].values()) for s in said] for h in hidden])
    figure, axes = plt.subplots(figsize=(1.5 + 0.28 * len(said), 1.8 + 0.24 * len(hidden)), layout="constrained")
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (y, x), share in np.ndenumerate(shares):
        if share > 0:
            axes.text(x, y, str(counts[hidden[y]][said[x]]), ha="center", va="center", fontsize=7)
    axes.set_xticks(range(len(said)), said, rotation=90)
    axes.set_yticks(range(len(hidden)), hidden)
    axes.set(title=f"{method}: first name", xlabel="said", ylabel="hidden")
    axes.grid(visible=False)
    figure.savefig(path)
    plt.close(figure)
    return path
