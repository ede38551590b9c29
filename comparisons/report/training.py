"""The report of ``sensorless train``: errors, loss curves, and predictions beside measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.report import style
from comparisons.report.report import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.log import JointLog, LogSource
    from learned.predictor import LearnedModel

SHOWN = 60.0
"""Seconds of the first test log that are plotted."""


def training_report(
    model: LearnedModel, joints: Sequence[str], figures: Mapping[str, Any], logs: Sequence[LogSource]
) -> Report:
    """Report a training.

    Args:
        model: the trained model.
        joints: names of the joints.
        figures: ``train`` and ``test``, each with ``rmse`` and ``relative_error_percent`` (n,).
        logs: test logs, of which the first is shown.
    """
    unit, trained = model.unit, model.trained
    mean = float(np.mean(figures["test"]["rmse"]))
    report = Report(
        f"{model.method} for {trained.robot}", f"Mean error on the test logs: {mean:.4g} {unit} (root mean square)."
    )
    report.section("Errors")
    rows = [
        [
            joint + 1, name, *(figures[part]["rmse"][joint] for part in ("train", "test")),
            figures["test"]["relative_error_percent"][joint],
        ]
        for joint, name in enumerate(joints)
    ]  # fmt: skip
    columns = ["joint", "name", f"RMSE, training [{unit}]", f"RMSE, test [{unit}]", "relative, test [%]"]
    report.table(columns, rows, "Errors against the current as logged, unfiltered")
    known = trained.training["validation"]
    apart = [[j + 1, known["rmse_known"][j], known["rmse_unknown"][j]] for j in range(len(joints))]
    columns = ["joint", f"after the joint's first motion [{unit}]", f"before it [{unit}]"]
    report.table(columns, apart, "RMSE on the validation log: before its first motion nobody knows how a joint stopped")
    report.section("Training").text(_account(model))
    report.figure(_losses(trained.training["stages"]), "Losses in units of each joint's deviation, one panel a network")
    log = logs[0].read()
    log = log[: max(2, round(SHOWN * log.rate))]
    report.section("Prediction").figure(_traces(model, log, joints), f"Beginning of `{log.name}`")
    return report


def _account(model: LearnedModel) -> str:
    """Say what was trained."""
    trained, shape = model.trained, model.trained.architecture
    frames = trained.training["frames"]
    return (
        f"{len(trained.weights)} weights in {model.hierarchies} network(s), on {frames['train']} frames, stopped by "
        f"{frames['validation']} frames of validation. Frames of {shape.memory} samples at {trained.rate:g} Hz, motion "
        f"filtered causally at {trained.cutoff:g} Hz, {trained.discriminator.count} discriminator thresholds."
    )


def _losses(stages: Sequence[Mapping[str, Any]]) -> Figure:
    with style.report_style():
        figure = style.new_figure(9.0, 3.0)
        axes = figure.subplots(1, len(stages), squeeze=False)[0]
        for number, (axis, stage) in enumerate(zip(axes, stages, strict=True), start=1):
            history = np.asarray(stage["history"])
            axis.semilogy(history[:, 0], color=style.MEASURED, label="training")
            axis.semilogy(history[:, 1], color=style.PREDICTED, label="validation")
            axis.axvline(stage["best_epoch"], color=style.FURTHER[3], label="kept")
            axis.set_title(f"Network {number}")
            axis.set_xlabel("epoch")
        axes[0].set_ylabel("mean square error")
        style.legend_above(figure, axes[0])
    return figure


def _traces(model: LearnedModel, log: JointLog, joints: Sequence[str]) -> Figure:
    predicted = model.predict(log, causal=True)
    figure, axes = style.joint_grid(joints, "time [s]", f"current [{model.unit}]")
    with style.report_style():
        for joint, axis in enumerate(axes):
            axis.plot(*style.thin(log.t, log.current[:, joint]), color=style.MEASURED, label="measured")
            axis.plot(*style.thin(log.t, predicted[:, joint]), color=style.PREDICTED, label="predicted")
        style.legend_above(figure, axes[0])
    return figure
