"""``sensorless train``: a network that predicts the current of a robot that touches nothing."""

from __future__ import annotations

import dataclasses
import hashlib
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from ident.errors import InputError

if TYPE_CHECKING:
    from comparisons.progress import Progress
    from ident.log import LogSource
    from ident.model import CurrentModel
    from ident.robot import Robot
    from learned.options import Progress as Stand
    from learned.options import ProgressCallback
    from learned.predictor import LearnedModel

Logs = Annotated[list[Path], Parameter(consume_multiple=True, negative="")]
Method = Literal["mlp", "lstm", "rdl", "rdl-md", "hrdl", "hrdl-md", "hybrid"]
Signal = Literal["velocity", "median-velocity", "displacement"]


def train(
    robot: str,
    /,
    *,
    train: Logs,
    test: Logs,
    out: Path,
    method: Method = "hrdl-md",
    validation: Annotated[list[Path] | None, Parameter(consume_multiple=True, negative="")] = None,
    model: Path | None = None,
    epochs: int = 40,
    patience: int = 10,
    batch: int = 1024,
    hierarchies: int | None = None,
    width: int | None = None,
    signal: Signal | None = None,
    rate: float | None = None,
    cutoff: float | None = None,
    cross_fit: int = 0,
    seed: int = 0,
    device: str | None = None,
    on_disk: Annotated[bool, Parameter(negative="")] = False,
    onnx: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Train a network that predicts the motor current, and test it.

    A training that was killed goes on where it was when the same command is given again.

    Args:
        robot: a robot card, or the name of a built-in robot.
        train: logs to learn from, the robot touching nothing: files, globs or folders.
        test: logs to test on.
        out: directory for the model, predictions, report and result.json.
        method: mlp, lstm, rdl, rdl-md, hrdl, hrdl-md, or hybrid: hrdl-md on top of an identified model.
        validation: logs to stop early by; by default every eighth training log, or the end of each where they are few.
        model: output of identify for a hybrid to stand on; by default one is identified from the training logs.
        epochs: passes over the training logs at most.
        patience: epochs without a better validation loss after which a network is done.
        batch: frames a step.
        hierarchies: networks, each learning what those before it leave; 3, of a hybrid 1.
        width: neurons of a hidden layer.
        signal: what remembers a joint's last motion: velocity (the paper's), median-velocity or displacement (a
            hybrid's), which ringing does not mislead.
        rate: sampling rate to train at [Hz].
        cutoff: of the causal low pass on the motion [Hz].
        cross_fit: folds, so that each network learns what others that had not seen a frame leave of it.
        seed: of weights and batches.
        device: cpu or cuda.
        on_disk: keep the training frames in files, for logs larger than memory.
        onnx: write the networks as model.onnx too.
    """
    from comparisons.output import OutputDirectory
    from comparisons.predictions import errors_on, write_predictions
    from comparisons.progress import show_progress
    from ident.readers import open_logs
    from ident.robot import load_robot
    from learned.options import suggested
    from learned.training import train as fit

    loaded = load_robot(robot)
    learn, prove = open_logs(train, loaded), open_logs(test, loaded)
    stop = open_logs(validation, loaded) if validation else None
    given = {"hierarchies": hierarchies, "width": width, "rate": rate, "cutoff": cutoff, **_discriminator(signal)}
    options = dataclasses.replace(
        suggested(method), epochs=epochs, patience=patience, batch=batch, seed=seed, cross_fit=cross_fit,
        device=device, on_disk=on_disk, **{name: value for name, value in given.items() if value is not None},
    )  # fmt: skip
    work = _work(out, f"{loaded.card} {method} {model} {options} {[s.name for s in learn]}")
    with OutputDirectory(out, "train") as output, show_progress() as progress:
        physics = _physics(method, model, loaded, learn, progress)
        try:
            trained = fit(loaded, learn, stop, method, options, work, _told(progress), physics)
        except InputError:
            shutil.rmtree(work, ignore_errors=True)
            raise
        trained.save(output.path)
        if onnx:
            from learned.onnx_export import export

            export(trained.trained, output.path / "model.onnx")
        errors = {"train": errors_on(trained, learn), "test": write_predictions(trained, prove, output.path)}
        figures = {name: e.as_dict() for name, e in errors.items()}
        _report(output.path, trained, loaded, figures, prove, [*train, *test], seed)
        output.result(_result(trained, figures, errors["test"].skipped))
    shutil.rmtree(work)
    print(f"{method}: mean RMSE {errors['test'].rmse.mean():.4g} {trained.unit} on the test logs")
    print(out / "report.html")


def _physics(
    method: str, model: Path | None, robot: Robot, logs: list[LogSource], progress: Progress
) -> CurrentModel | None:
    """Load the identified model that a hybrid stands on, or identify one."""
    if method != "hybrid":
        if model is not None:
            raise InputError(f"{method} stands on no model", "--model", "leave it out, or train a hybrid")
        return None
    if model is None:
        from ident.identification import identify

        return identify(robot, logs, progress=progress).model
    from ident.model_file import load_model

    return load_model(model, robot)


def _discriminator(signal: Signal | None) -> dict[str, Any]:
    """Options of the discriminator; velocities and displacements have thresholds of their own."""
    from learned.motion_discriminator import PLAY_THRESHOLDS, TABLE_I

    if signal is None:
        return {}
    return {"signal": signal, "thresholds": PLAY_THRESHOLDS if signal == "displacement" else sum(TABLE_I, ())}


def _work(out: Path, what: str) -> Path:
    """Folder beside ``out`` for the checkpoint of one particular training: a run that fails leaves ``out`` alone."""
    name = hashlib.sha256(what.encode()).hexdigest()[:8]
    return out.absolute().parent / f".{out.name}-training-{name}"


def _told(progress: Progress) -> ProgressCallback:
    """Turn where a training stands into a bar a stage."""

    def tell(stand: Stand) -> None:
        progress(f"Network {stand.stage} of {stand.stages}, loss {stand.validation:.4f}", stand.epoch / stand.epochs)

    return tell


def _result(model: LearnedModel, figures: dict[str, Any], skipped: dict[str, int]) -> dict[str, Any]:
    trained = model.trained
    stages = [{"best_epoch": s["best_epoch"], "history": s["history"]} for s in trained.training["stages"]]
    return {
        "joints": list(trained.joints),
        "unit": trained.unit,
        "method": model.method,
        "rate": trained.rate,
        "cutoff": trained.cutoff,
        **figures,
        "skipped": skipped,
        "validation": trained.training["validation"],
        "frames": trained.training["frames"],
        "weights": len(trained.weights),
        "stages": stages,
    }


def _report(
    folder: Path,
    model: LearnedModel,
    robot: Robot,
    figures: dict[str, Any],
    logs: list[LogSource],
    inputs: list[Path],
    seed: int,
) -> None:
    from comparisons.report.provenance import provenance
    from comparisons.report.training import training_report

    report = training_report(model, robot.joints, figures, logs)
    report.provenance(provenance(inputs, seed=seed, libraries=("torch",))).write(folder / "report.html")
