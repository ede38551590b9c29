"""``sensorless gap``: find where simulation and measurement disagree, name what is missing, and add it to the model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from comparisons.output import OutputDirectory
from comparisons.progress import show_progress
from ident.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ident.gap import GapReport
    from ident.log import JointLog

Many = Parameter(consume_multiple=True)


def gap(
    robot: str,
    /,
    *,
    train: Annotated[list[str], Many],
    test: Annotated[list[str], Many],
    model: Path | None = None,
    out: Path,
    cutoff: float | None = None,
) -> None:
    """Find what a robot's model lacks, name it, add it, and show the gap shrink.

    Without --model: what does the structure of links, Coulomb and viscous friction, rotor and offset lack? Everything
    is fitted again with every candidate. With --model: what has changed since that model was identified? It is held
    fixed.

    Args:
        robot: a robot card, or the name of a built-in robot.
        train: logs to find the gap in: files, globs or folders; in the order of recording, if their clocks begin anew.
        test: logs that play no part in finding it, and on which the gap is shown before and after.
        model: directory that identify or gap wrote.
        out: directory for result.json, report.html, the extended model and the predictions.
        cutoff: of the filter that derives velocity and acceleration [Hz]; chosen from the logs unless given.
    """
    with OutputDirectory(out, "gap") as output:
        found = gap_into(output, robot, train, test, model, cutoff)
    from comparisons.report.gap import nameless, sentence

    for warning in found.warnings:
        print(f"warning: {warning}")
    for finding in found.findings:
        print(sentence(found, finding))
    if not found.findings:
        print("Nothing is named: no effect of the catalogue passes the gate on these logs.")
    for one in found.unexplained:
        print(nameless(one))
    print(out / "report.html")


def gap_into(
    output: OutputDirectory, robot: str, train: list[str], test: list[str], model: Path | None, cutoff: float | None
) -> GapReport:
    """Run the workflow and write everything into an output directory; shared with ``sensorless demo``."""
    from comparisons.protocols.experiments import Experiments
    from comparisons.report.gap import gap_report
    from comparisons.report.provenance import provenance
    from ident.gap import baseline_model, find_gap
    from ident.model_file import load_model, save_model
    from ident.readers import open_logs
    from ident.robot import load_robot

    if not train or not test:
        raise InputError("no logs", "--test" if train else "--train", "give logs after it")
    if model is not None and cutoff is not None:
        raise InputError("a model has its own cut-off", "--cutoff", "leave out --cutoff or --model")
    loaded = load_robot(robot)
    known = None if model is None else load_model(model, loaded)
    logs, held_out = open_logs(train, loaded), open_logs(test, loaded)
    with show_progress() as progress:
        start = baseline_model(loaded, logs, cutoff, progress) if known is None else known
        motions = Experiments(loaded)
        found = find_gap(start, logs, held_out, known is None, progress, motions)
        progress("predicting", 0.0)
        figures = write_both(found, held_out, output.path)
        progress("predicting", 1.0)
    save_model(found.model, output.path)
    write_experiments(found, motions, output.path / "experiments")
    note = provenance([*train, *test])
    output.result({**gap_result(found), **figures, "provenance": note.to_dict()})
    gap_report(found, held_out, note).write(output.path / "report.html")
    return found


def write_experiments(found: GapReport, motions: Mapping[str, JointLog], folder: Path) -> None:
    """Write the motions that would tell most of what is open as ``<motion>.csv``: t and commanded positions q1..qn."""
    from ident.excitation.output import write_columns

    for name in dict.fromkeys(name for finding in found.findings for name in finding.telling):
        folder.mkdir(parents=True, exist_ok=True)
        motion = motions[name]
        write_columns(motion.t, {"q": motion.q}, folder / f"{name}.csv")


def write_both(found: GapReport, logs: list[Any], folder: Path) -> dict[str, Any]:
    """Write ``predictions/<log>.parquet`` with b1..bn before and p1..pn after, and return their errors."""
    import numpy as np

    from comparisons.predictions import FOLDER, Errors, PredictionWriter, refuse_same_names

    refuse_same_names(logs)
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    before, after = Errors.of(found.model.n), Errors.of(found.model.n)
    for source in logs:
        with PredictionWriter(folder / FOLDER / f"{source.name}.parquet") as writer:
            both = zip(found.before.predict_blocks(source), found.model.predict_blocks(source), strict=True)
            for (log, old), (_, new) in both:
                known = np.isfinite(old).all(axis=1) & np.isfinite(new).all(axis=1)
                for predicted in (old, new):
                    predicted[~known] = np.nan
                before.add(log, old)
                after.add(log, new)
                writer.write(log, {"b": old, "p": new})
    return {
        "rmse": {"before": before.rmse, "after": after.rmse},
        "rows": after.rows,
        "skipped": sum(after.skipped.values()),
    }


def gap_result(found: GapReport) -> dict[str, Any]:
    """What was found, as result.json holds it."""
    assert found.evidence is not None
    steps = found.evidence.steps
    findings = [
        {
            "effect": f.effect,
            "family": f.family,
            "joints": [j + 1 for j in f.joints],
            "alternatives": list(f.alternatives),
            "parameters": f.parameters,
            "p_value": f.p_value,
            "rmse_before": steps[k],
            "rmse_after": steps[k + 1],
            "next_experiment": f.next_experiment,
        }
        for k, f in enumerate(found.findings)
    ]
    return {
        "unit": found.model.unit,
        "joints": list(found.model.robot.joints),
        "force_unit": found.model.force_unit,
        "findings": findings,
        "unexplained": [
            {"joints": [j + 1 for j in u.joints], "depends_on": list(u.depends_on), "share": u.share}
            for u in found.unexplained
        ],
        "untestable": [
            {"effect": u.effect, "joints": [j + 1 for j in u.joints], "reason": u.reason} for u in found.untestable
        ],
        "rests_left_out": [j + 1 for j in found.rests],
        "presliding": found.model.presliding.tolist(),
        "rmse_moving": {"before": found.evidence.moving[0], "after": found.evidence.moving[-1]},
        "noise_floor": found.noise_floor,
        "warnings": list(found.warnings),
    }
