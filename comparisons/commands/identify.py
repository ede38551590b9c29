"""``sensorless identify``: from a card and logs to an identified, saved, explained model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from comparisons.output import OutputDirectory
from comparisons.progress import show_progress
from ident.errors import InputError

if TYPE_CHECKING:
    from ident.identification import Identification

Many = Parameter(consume_multiple=True)


def identify(
    robot: str,
    /,
    *,
    train: Annotated[list[str], Many],
    test: Annotated[list[str] | None, Many] = None,
    out: Path,
    cutoff: float | None = None,
    gains: Literal["known", "shared", "per-joint", "payload"] | None = None,
    effects: Annotated[list[str] | None, Many] = None,
    robust: bool = False,
    payload_train: Annotated[list[str] | None, Many] = None,
    payload_mass: float | None = None,
    payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0),
    payload_frame: str | None = None,
) -> None:
    """Identify a robot's current model from its logs.

    Args:
        robot: a robot card, or the name of a built-in robot.
        train: logs to fit, the robot touching nothing: files, globs or folders.
        test: logs that play no part in the fit and are predicted.
        out: directory for result.json, report.html, the model and the predictions.
        cutoff: of the filter that derives velocity and acceleration [Hz]; chosen from the logs unless given.
        gains: how drive gains are treated; from the payload where one is given, known where the card gives them, else
            per joint.
        effects: names of the effects every joint gets, instead of those that predict held-out logs best.
        robust: give less weight to outliers and contacts.
        payload_train: logs of the training motion with a known payload, to find the drive gains.
        payload_mass: its mass [kg].
        payload_com: its centre of mass in the payload frame [m].
        payload_frame: frame that carries it, by its URDF name; the last joint's unless given.
    """
    options: dict[str, Any] = {"cutoff": cutoff, "gains": gains, "effects": effects, "robust": robust}
    if (payload_train is None) != (payload_mass is None):
        what = "payload logs and payload mass go together"
        raise InputError(what, "--payload-train", "give --payload-train and --payload-mass, or neither")
    if payload_train is not None:
        options["payload"] = (payload_train, payload_mass, payload_com, payload_frame)
    with OutputDirectory(out, "identify") as output:
        found = identify_into(output, robot, train, test, options)
    for warning in found.warnings:
        print(f"warning: {warning}")
    print(out / "report.html")


def identify_into(
    output: OutputDirectory, robot: str, train: list[str], test: list[str] | None, options: dict[str, Any]
) -> Identification:
    """Identify and write everything into an output directory; shared with ``sensorless demo``."""
    from comparisons.predictions import errors_on, write_predictions
    from comparisons.report.identification import identification_report
    from comparisons.report.provenance import provenance
    from ident.cautions import reach_warnings
    from ident.current_unit import check_unit
    from ident.gap.evidence import evidence
    from ident.identification import PayloadLogs
    from ident.identification import identify as identify_model
    from ident.log_set import set_warnings
    from ident.payload import Payload
    from ident.readers import open_logs
    from ident.robot import load_robot

    loaded = load_robot(robot)
    if test == []:
        raise InputError("no logs to test on", "--test", "give logs after it, or leave it out")
    logs, held_out = open_logs(train, loaded), open_logs(test, loaded) if test else []
    if "payload" in options:
        patterns, mass, com, frame = options.pop("payload")
        options["loaded"] = PayloadLogs(Payload(mass, com, frame=frame), open_logs(patterns, loaded))
    with show_progress() as progress:
        found = identify_model(loaded, logs, progress=progress, **options)
        progress("predicting", 0.0)
        check_unit(found.model, held_out)
        errors = {"train": errors_on(found.model, logs, False, found.cutoff.hertz)}
        if held_out:
            errors["test"] = write_predictions(found.model, held_out, output.path, False, found.cutoff.hertz)
        figures = {part: e.as_dict() for part, e in errors.items()}
        if found.rests.joints:
            for part, shown in {"train": logs, **({"test": held_out} if held_out else {})}.items():
                figures[part]["rmse_moving"] = evidence([found.model], shown, found.rests).moving[0]
        further = reach_warnings(loaded, logs, held_out, found.cutoff.hertz)
        found = replace(found, warnings=(*found.warnings, *further, *set_warnings(logs, held_out)))
        progress("predicting", 1.0)
    found.write(output.path)
    note = provenance([*train, *(test or [])])
    output.result({**found.result(), **figures, "provenance": note.to_dict()})
    report = identification_report(found, figures, logs, held_out, note)
    report.write(output.path / "report.html")
    return found
