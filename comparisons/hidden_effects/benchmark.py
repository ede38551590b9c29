"""How often the gap workflow names a hidden effect rightly, side by side with what people do today.

Run it by ``python -m comparisons.hidden_effects.benchmark --suite small --seed 1 --out DIR``; a run that was killed
goes on when it is started again, case by case. It writes ``benchmark.md``, ``benchmark.json`` and plots into DIR, and
one file for every finished case into DIR/cases.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from joblib import Parallel, delayed

from comparisons.cli import run_alone
from comparisons.cluster import workers
from comparisons.hidden_effects.benchmark_page import page, plots, results
from comparisons.hidden_effects.measured import FOLDER, MeasuredTask, measured_tasks
from comparisons.hidden_effects.styles import ALL, STYLES
from comparisons.hidden_effects.suites import KINDS, SUITES, Sizes, Suite, Task, shuffled, tasks
from comparisons.hidden_effects.work import METHODS, whole, work
from comparisons.output import to_json
from comparisons.report.provenance import provenance
from ident.errors import InputError

MEASURED = "measured"
SEVERAL = cyclopts.Parameter(consume_multiple=True)


def benchmark(
    *,
    out: Path,
    suite: Suite = "small",
    seed: int = 1,
    jobs: int = 2,
    scheduler: str | None = None,
    per_effect: int | None = None,
    severities: Annotated[tuple[float, ...], SEVERAL] = (),
    mixtures: int | None = None,
    nothing: int | None = None,
    robots: Annotated[tuple[str, ...], SEVERAL] = (),
    styles: Annotated[tuple[str, ...], SEVERAL] = (),
    only: Annotated[tuple[str, ...], SEVERAL] = (),
    methods: Annotated[tuple[str, ...], SEVERAL] = METHODS,
    measured: Path | None = None,
) -> None:
    """Hide effects, ask the gap workflow and its rivals for them, and score the answers.

    Args:
        out: directory of the table, the plots and the finished cases.
        suite: small (minutes) or full (hours).
        seed: draws cases, motions and noise.
        jobs: processes on this machine, one core each.
        scheduler: address of a Dask scheduler, tcp://HOST:PORT, whose workers then do the cases instead.
        per_effect: cases of each effect at each severity, instead of the suite's.
        severities: of the hidden effects, instead of the suite's.
        mixtures: pairs, and as many triples, at each severity from one.
        nothing: cases in which nothing is hidden.
        robots: vs060, ur10, panda, xarm7.
        styles: how they are moved and logged, taken in turn: usual, 500Hz, 50Hz, fourier, sinusoid, short,
            stop-and-go, noisy, sticks, servos, yields; all for every one of them but the last three.
        only: sets of cases (single, changed, pair, triple, nothing, foreign, tie, measured), names of effects, or those
            of a set, as tie-stribeck.
        methods: who is asked.
        measured: folder of measured logs for half measured cases; default: the environment's SENSORLESS_MEASURED.
    """
    unknown = [m for m in methods if m not in METHODS]
    if unknown:
        raise InputError(f"no method {unknown[0]}", "--methods", f"give some of: {', '.join(METHODS)}")
    if any("pysindy" in m for m in methods) and find_spec("pysindy") is None:
        raise InputError("pysindy is not installed", "--methods", 'pip install "sensorless[bench]", or leave it out')
    strange = [s for s in styles if s not in (*STYLES, "all")]
    if strange:
        raise InputError(f"no style {strange[0]}", "--styles", f"give some of: {', '.join(STYLES)}, or all")
    usual = SUITES[suite]
    sizes = Sizes(
        usual.per_effect if per_effect is None else per_effect,
        severities or usual.severities,
        usual.mixtures if mixtures is None else mixtures,
        usual.nothing if nothing is None else nothing,
        robots or usual.robots,
        ALL if "all" in styles else styles or usual.styles,
    )
    folder = measured or (Path(os.environ[FOLDER]) if FOLDER in os.environ else None)
    listed = _chosen([*tasks(sizes, seed), *measured_tasks(folder, seed)], only)
    records = run(shuffled(listed, seed), methods, out / "cases", jobs, scheduler)
    found = results(records, methods)
    words = ["python", "-m", "comparisons.hidden_effects.benchmark", *sys.argv[1:]]
    found["provenance"] = provenance([], seed=seed, command=words, libraries=("pysindy",)).to_dict()
    (out / "benchmark.json").write_text(to_json(found), encoding="utf-8")
    (out / "benchmark.md").write_text(page(found), encoding="utf-8")
    plots(found, out)
    print(page(found))


def run(
    listed: Sequence[Task | MeasuredTask],
    methods: Sequence[str],
    folder: Path,
    jobs: int = 1,
    scheduler: str | None = None,
) -> list[dict[str, Any]]:
    """Do those cases that are not done yet, each kept in a file as soon as it is, and return the records of all."""
    folder.mkdir(parents=True, exist_ok=True)
    known = {task.name: _read(folder / f"{task.name}.json") for task in listed}
    left = [task for task in listed if not (found := known[task.name]) or not whole(found, methods)]
    started = time.monotonic()
    calls = (delayed(work)(task, methods, known[task.name]) for task in left)
    with workers(scheduler, jobs):
        finished: Iterable[dict[str, Any]] = Parallel(return_as="generator_unordered")(calls)
        for number, record in enumerate(finished, start=1):
            known[record["name"]] = record
            _write(folder / f"{record['name']}.json", record)
            _tell(number, len(left), time.monotonic() - started, record)
    return [record for record in known.values() if record is not None]


def _chosen(listed: Sequence[Task | MeasuredTask], only: Sequence[str]) -> list[Task | MeasuredTask]:
    if not only:
        return list(listed)

    def words(task: Task | MeasuredTask) -> set[str]:
        if isinstance(task, MeasuredTask):
            effects, kinds = {task.effect}, {MEASURED, task.kind}
        else:
            effects, kinds = {h.effect for h in task.case.hidden}, {task.kind}
        return {*kinds, *effects, *(f"{kind}-{effect}" for kind in kinds for effect in effects)}

    chosen = [task for task in listed if words(task) & set(only)]
    if not chosen:
        raise InputError(f"no case of {', '.join(only)}", "--only", f"give {', '.join((*KINDS, MEASURED))} or effects")
    return chosen


def _read(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _write(path: Path, record: dict[str, Any]) -> None:
    half = path.with_suffix(".part")
    half.write_text(to_json(record), encoding="utf-8")
    os.replace(half, path)


def _tell(number: int, of: int, seconds: float, record: dict[str, Any]) -> None:
    broken = f"  broke down: {', '.join(record['errors'])}" if record["errors"] else ""
    left = seconds / number * (of - number) / 60.0
    print(f"[{number}/{of}, {left:.0f} min left] {record['name']}{broken}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    run_alone(benchmark)
