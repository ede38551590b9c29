"""``sensorless compare``: estimators side by side on the same logs."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

if TYPE_CHECKING:
    from comparisons.comparison.entrants import Request
    from comparisons.comparison.run import Comparison
    from comparisons.output import OutputDirectory
    from comparisons.report.provenance import Provenance
    from ident.robot import Robot

Many = Parameter(consume_multiple=True, negative="")
MODELS = "models"


def compare(
    robot: str,
    /,
    *,
    train: Annotated[list[Path], Many],
    test: Annotated[list[Path], Many],
    out: Path,
    methods: Annotated[list[str] | None, Many] = None,
    model: Annotated[list[Path] | None, Many] = None,
    preset: Literal["quick", "paper"] = "quick",
    epochs: int | None = None,
    seeds: int = 1,
    bandwidth: float = 5.0,
    cutoff: float | None = None,
    device: str | None = None,
    resume: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Compare estimators on the same logs: how they err, what they feel, what they cost.

    A comparison that was killed goes on where it was when the same command is given again.

    Args:
        robot: a robot card, or the name of a built-in robot.
        train: logs to fit, the robot touching nothing: files, globs or folders.
        test: logs to compare on; where they tell the true external torque (tau_ext), contacts are judged too.
        out: directory for result.json, report.html, the models and the predictions.
        methods: names, with commas or apart: physics, coulomb-viscous, sigmoid, stribeck, maxwell-slip, effects joined
            by +, gmo, kalman, disturbance, sliding-mode, filtered-dynamics, mlp, lstm, rdl, rdl-md, hrdl, hrdl-md,
            hybrid; or direct, observers, learned, all. By default all but the learned.
        model: outputs of identify, gap or train to compare as well, by the names of their folders; the first that is
            identified is the physics that observers and hybrids stand on.
        preset: how networks learn: quick (narrow, few epochs) or paper (the paper's sizes).
        epochs: passes over the training logs at most, instead of the preset's.
        seeds: trainings of each network; its figures are their means.
        bandwidth: of the residuals [Hz] at which all estimators are compared.
        cutoff: of the filter that derives velocity and acceleration [Hz]; chosen from the logs unless given.
        device: that networks learn on: cpu or cuda.
        resume: take over what an earlier comparison in out has fitted to the same logs in the same way.
    """
    from comparisons.comparison.entrants import Request
    from comparisons.comparison.methods import parse_methods
    from comparisons.output import OutputDirectory
    from comparisons.report.provenance import provenance
    from ident.robot import load_robot

    names = parse_methods(methods if methods is not None else ["default"])
    request = Request(tuple(names), preset, epochs, seeds, bandwidth, cutoff, device)
    loaded = load_robot(robot)
    note = provenance([*train, *test, *(model or [])], libraries=("torch",))
    work = _work(out, f"{loaded.card} {train}")
    with OutputDirectory(out, "compare") as output:
        comparison = _compared(output, work, request, loaded, (train, test, model or []), resume, note)
    shutil.rmtree(work, ignore_errors=True)
    for name, one in comparison.methods.items():
        print(f"{name}: mean residual {np.mean(one['smoothed']['rmse']):.4g} {loaded.unit} at {bandwidth:g} Hz")
    print(out / "report.html")


def _compared(
    output: OutputDirectory,
    work: Path,
    request: Request,
    robot: Robot,
    paths: tuple[Sequence[Path], Sequence[Path], Sequence[Path]],
    resume: bool,
    note: Provenance,
) -> Comparison:
    """Compare and write everything into an output directory; ``paths`` are training logs, test logs and models."""
    from comparisons.comparison.entrants import Entrants, load_models
    from comparisons.comparison.held_out import HeldOut
    from comparisons.comparison.kept import Kept
    from comparisons.comparison.run import run_comparison
    from comparisons.comparison.workshop import Workshop
    from comparisons.progress import show_progress
    from comparisons.report.comparison import comparison_report
    from ident.current_unit import check_unit
    from ident.model import CurrentModel
    from ident.readers import open_logs

    train, test, models = paths
    given = load_models(models, robot)
    learn, held_out = open_logs(train, robot), open_logs(test, robot)
    for model in given.values():
        if isinstance(model, CurrentModel):
            check_unit(model, held_out)
    tests = HeldOut.of(held_out)
    with tempfile.TemporaryDirectory() as scratch, show_progress() as progress:
        workshop = Workshop(work, robot, learn, progress, output.directory / MODELS if resume else None)
        comparison = run_comparison(Entrants(request, workshop, given), tests, Kept(Path(scratch)), progress)
        workshop.publish(output.path / MODELS)
        comparison.kept.write(tests, output.path)
        output.result({**_result(robot, comparison, request), "provenance": note.to_dict()})
        comparison_report(robot, comparison).provenance(note).write(output.path / "report.html")
    return comparison


def _work(out: Path, what: str) -> Path:
    """Folder beside ``out`` for what is fitted: a run that fails leaves ``out`` alone, and the next one goes on."""
    name = hashlib.sha256(what.encode()).hexdigest()[:8]
    return out.absolute().parent / f".{out.name}-comparison-{name}"


def _result(robot: Robot, comparison: Comparison, request: Request) -> dict[str, Any]:
    tests, regimes = comparison.tests, comparison.tests.regimes
    return {
        "joints": list(robot.joints),
        "unit": robot.unit,
        "bandwidth": comparison.bandwidth,
        "preset": request.preset,
        "seeds": list(range(request.seeds)),
        "frames": {
            "all": len(tests.whole),
            "without_contact": int(regimes.free.sum()),
            **{name.removeprefix("rmse_"): m.sum(axis=0) for name, m in regimes.masks().items() if name != "rmse"},
            "unknown_history": (regimes.free[:, None] & ~regimes.known).sum(axis=0),
            "cutoff_hertz": tests.cutoff,
        },
        "methods": comparison.methods,
    }
