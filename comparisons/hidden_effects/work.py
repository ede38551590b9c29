"""One case of a run: make it, ask the workflow and its rivals, and return a record that JSON holds."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from joblib import parallel_config
from threadpoolctl import threadpool_limits

from comparisons.hidden_effects.answer import Answer, Truth, answer_of, truth_from, truth_of
from comparisons.hidden_effects.cases import Case, Maker, make
from comparisons.hidden_effects.identifiability import told
from comparisons.hidden_effects.library import library
from comparisons.hidden_effects.measured import MeasuredTask, make_measured
from comparisons.hidden_effects.rivals import RIVALS, ask_rival
from comparisons.hidden_effects.scoring import Judged
from comparisons.hidden_effects.suites import Task
from comparisons.protocols.experiments import Experiments
from ident.gap import baseline_model, find_gap
from ident.gap.evidence import evidence
from ident.gap.report import Finding
from ident.log import JointLog
from ident.model import CurrentModel

WORKFLOW = "gap workflow"
METHODS = (WORKFLOW, *RIVALS)

LAST_LINES = 1500
"""Characters of a traceback that are kept."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What methods are given: the model before, logs, and whether the model's own parameters are fitted again.

    ``case`` records further motions of the same robot, where it is a virtual one.
    """

    model: CurrentModel
    train: list[JointLog]
    test: list[JointLog]
    refit: bool
    case: Case | None = None


def work(task: Task | MeasuredTask, methods: Sequence[str], known: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Ask methods about a case, one process and one thread.

    Args:
        task: the case.
        methods: of `METHODS`; those that ``known`` has answers of are not asked again.
        known: the record of the same case from a run before.

    Returns:
        ``name``, ``truth``, ``answers`` by method (None where the method broke down) and ``errors``, their tracebacks.
    """
    record: dict[str, Any] = {"name": task.name, "truth": None, "answers": {}, "errors": {}}
    if known is not None:
        record["answers"] = {m: a for m, a in known["answers"].items() if a is not None}
    missing = [m for m in methods if m not in record["answers"]]
    with threadpool_limits(1), parallel_config(backend="sequential"):
        try:
            truth, problem = _problem(task)
        except Exception:
            record["errors"] = {"case": traceback.format_exc()[-LAST_LINES:]}
            return record
        record["truth"] = asdict(truth)
        if WORKFLOW in missing:
            _ask(record, WORKFLOW, lambda: _workflow(problem, truth))
        others = [m for m in missing if m != WORKFLOW]
        shared = library(problem.model, problem.train, problem.refit) if others else None
        for method in others:
            assert shared is not None
            _ask(record, method, lambda method=method: ask_rival(method, shared, problem.train, problem.test))  # type: ignore[misc]
    return record


def judged(record: Mapping[str, Any], method: str) -> Judged | None:
    """Return a record's answer of a method beside its truth; None where the method was not asked."""
    if record["truth"] is None or method not in record["answers"]:
        return None
    answer = record["answers"][method]
    return Judged(truth_from(record["truth"]), None if answer is None else Answer.of(answer))


def whole(record: Mapping[str, Any], methods: Sequence[str]) -> bool:
    """Whether a record has the answers of all methods, none of which broke down."""
    return record["truth"] is not None and all(record["answers"].get(m) is not None for m in methods)


def _problem(task: Task | MeasuredTask) -> tuple[Truth, Problem]:
    if isinstance(task, MeasuredTask):
        half = make_measured(task)
        return half.truth, Problem(half.model, half.train, half.test, True)
    made = make(task.case)
    changed = task.case.changed
    model = baseline_model(made.robot, made.clean if changed else made.train)
    ideal = baseline_model(made.robot, made.plain[:3]) if task.case.hidden and not changed else model
    known = evidence([ideal], made.plain[3:]).after
    problem = Problem(model, made.train, made.test, not changed, task.case)
    of = [told(model, not changed, task.case, made, k) for k in range(len(task.case.hidden))]
    return truth_of(task.case, made, task.kind, task.name, known, of), problem


def _workflow(problem: Problem, truth: Truth) -> Answer:
    started = time.perf_counter()
    motions = Experiments(problem.model.robot)
    report = find_gap(problem.model, problem.train, problem.test, refit=problem.refit, motions=motions)
    answer = answer_of(report, time.perf_counter() - started)
    ties = [f for f in report.findings if f.motions and any(f.joints == s.joints for s in truth.secrets)]
    if problem.case is None or not ties:
        return answer
    return replace(answer, settled=_settled(problem, truth, ties[0], motions))


def _settled(problem: Problem, truth: Truth, tie: Finding, motions: Mapping[str, JointLog]) -> bool:
    """Whether, with logs of the motions proposed added, the true name is given without what they were to rule out."""
    assert problem.case is not None
    maker = Maker(problem.case)
    train = [*problem.train, *(maker.record(motions[name]) for name in tie.motions)]
    model = baseline_model(problem.model.robot, train) if problem.refit else problem.model
    report = find_gap(model, train, refit=problem.refit)
    names = [n for n in answer_of(report, 0.0).findings if n.joints == tie.joints]
    right = [n for n in names if any(n.means(s) for s in truth.secrets)]
    return bool(right) and not ({*tie.settled, tie.effect} - {right[0].effect}) & {*right[0].alternatives}


def _ask(record: dict[str, Any], method: str, ask: Callable[[], Answer]) -> None:
    try:
        record["answers"][method] = ask().to_dict()
    except Exception:
        # A method that breaks down on a case is wrong on it; the run goes on.
        record["answers"][method] = None
        record["errors"][method] = traceback.format_exc()[-LAST_LINES:]
