"""``sensorless observe``: what the outside world adds to the joints along a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

if TYPE_CHECKING:
    from ident.log import JointLog
    from ident.robot import Robot
    from observers.contact import Contacts
    from observers.cusum import Cusum
    from observers.residual import Residual, ResidualEstimator
    from observers.thresholds import Threshold

Method = Literal["direct", "gmo", "kalman", "disturbance", "sliding-mode", "filtered-dynamics"]
Logs = Annotated[list[Path], Parameter(consume_multiple=True, negative="")]


def observe(
    robot: str,
    /,
    *,
    model: Path,
    log: Logs,
    out: Path,
    method: Method = "gmo",
    bandwidth: float = 5.0,
    contact_free: Annotated[list[Path] | None, Parameter(consume_multiple=True, negative="")] = None,
    false_alarms: float = 1.0,
    moving: Annotated[bool, Parameter(negative="")] = False,
    cusum: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Estimate what the outside world adds to the joints along a log, and find contacts.

    Args:
        robot: a robot card, or the name of a built-in robot.
        model: output of identify, or of train (for direct).
        log: logs to observe: files, globs or folders.
        out: directory for the residuals, report and result.json.
        method: direct, gmo, kalman, disturbance, sliding-mode or filtered-dynamics.
        bandwidth: of the residual [Hz].
        contact_free: logs without contact, from which thresholds are taken; without them no contacts are told.
        false_alarms: wanted in an hour without contact.
        moving: let thresholds grow with the joints' speed and acceleration.
        cusum: tell weak pushes that last as well, by cumulative sums with as many false alarms of their own.
    """
    from comparisons.output import OutputDirectory
    from comparisons.progress import show_progress
    from comparisons.report.observation import observation_report
    from comparisons.report.provenance import provenance
    from ident.errors import InputError
    from ident.readers import open_logs
    from ident.robot import load_robot
    from observers.cusum import Cusum, alarms

    if cusum and contact_free is None:
        raise InputError("no logs without contact to fit cumulative sums to", "--cusum", "give --contact-free too")
    loaded = load_robot(robot)
    observed = [source.read() for source in open_logs(log, loaded)]
    free = [source.read() for source in open_logs(contact_free, loaded)] if contact_free is not None else []
    estimator, cutoff = _estimator(method, model, loaded, [*free, *observed], bandwidth)
    with OutputDirectory(out, "observe") as output, show_progress() as progress:
        quiet = [estimator.run(one) for one in free]
        threshold = _threshold(quiet, free, false_alarms, cutoff if moving else None)
        cumulative = Cusum.fit(quiet, false_alarms) if cusum else None
        residuals, sums, figures = [], [], []
        for number, one in enumerate(observed):
            residuals.append(estimator.run(one))
            contacts = _contacts(threshold, residuals[-1], one, cutoff)
            figures.append(_figures(one, residuals[-1], contacts))
            if cumulative is not None:
                sums.append(cumulative.run(residuals[-1]))
                figures[-1]["cusum_alarms"] = [vars(alarm) for alarm in alarms(one.t, sums[-1])]
            progress("observing", (number + 1) / len(observed))
        _save(output.path, observed, residuals)
        note = provenance([model, *log, *(contact_free or [])])
        result = _result(loaded, method, bandwidth, threshold, cumulative, figures)
        output.result(result | {"provenance": note.to_dict()})
        report = observation_report(loaded, method, threshold, observed, residuals, figures, sums if cusum else None)
        report.provenance(note).write(output.path / "report.html")
    if threshold is not None:
        print(f"{sum(len(f['contacts']) for f in figures)} contacts")
    if cusum:
        print(f"{sum(len(f['cusum_alarms']) for f in figures)} alarms of the cumulative sums")
    print(out / "report.html")


def _estimator(
    method: str, folder: Path, robot: Robot, logs: list[JointLog], bandwidth: float
) -> tuple[ResidualEstimator, float]:
    """Load the model, identified or learned, and put the estimator on it; with its motion filter's cut-off [Hz]."""
    from ident.current_unit import check_unit
    from ident.errors import InputError
    from ident.model_file import load_model
    from observers.methods import make_estimator

    if not (folder / "weights.npz").is_file():
        model = load_model(folder, robot)
        check_unit(model, logs)
        return make_estimator(method, model, logs, bandwidth), model.cutoff
    if method != "direct":
        what = f"{method} needs the links' parameters, and a network has none"
        raise InputError(what, f"--model {folder}", "give --method direct, or the output of identify")
    from learned.predictor import LearnedModel
    from observers.direct import DirectEstimator

    network = LearnedModel.load(folder, robot)
    return DirectEstimator(network, logs[0].rate, gain=robot.gain, coupling=robot.coupling), network.trained.cutoff


def _threshold(quiet: list[Residual], free: list[JointLog], per_hour: float, moving: float | None) -> Threshold | None:
    from ident.signals import derive
    from observers.thresholds import fit_threshold

    if not free:
        return None
    motions = None if moving is None else [derive(log, moving, causal=True) for log in free]
    return fit_threshold(quiet, per_hour, motions)


def _contacts(threshold: Threshold | None, residual: Residual, log: JointLog, cutoff: float) -> Contacts | None:
    from ident.signals import derive
    from observers.contact import ContactDetector

    if threshold is None:
        return None
    motion = derive(log, cutoff, causal=True) if threshold.moves else None
    return ContactDetector(threshold).run(residual, motion)


def _save(folder: Path, logs: list[JointLog], residuals: list[Residual]) -> None:
    """Write residual.parquet, or, where there are several logs, residuals/<log>.parquet for each."""
    from ident.errors import InputError

    if len(logs) == 1:
        residuals[0].save(folder / "residual.parquet")
        return
    names = [log.name for log in logs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two logs are named {name}", "--log", "rename one of them")
    (folder / "residuals").mkdir()
    for name, residual in zip(names, residuals, strict=True):
        residual.save(folder / "residuals" / f"{name}.parquet")


def _figures(log: JointLog, residual: Residual, contacts: Contacts | None) -> dict[str, Any]:
    from observers.residual import Flag

    good = residual.good
    own = residual.current[good] if good.any() else np.full((1, log.n), np.nan)
    figures: dict[str, Any] = {
        "log": log.name,
        "rows": len(log),
        "rms": np.sqrt(np.mean(own**2, axis=0)),
        "mean": own.mean(axis=0),
        "peak": np.abs(own).max(axis=0),
        "flagged": {flag.name.lower(): int(np.sum(residual.flags & int(flag) != 0)) for flag in Flag if flag.name},
    }
    if log.tau_ext is not None and residual.torque is not None:
        figures["torque_rmse"] = np.sqrt(np.mean((residual.torque - log.tau_ext)[good] ** 2, axis=0))
    if contacts is not None:
        figures["contacts"] = [
            {"start": e.start, "end": e.end, "level": e.level.name.lower(), "link": e.link, "links": e.links}
            for e in contacts.episodes()
        ]
    return figures


def _result(
    robot: Robot,
    method: str,
    bandwidth: float,
    threshold: Threshold | None,
    cumulative: Cusum | None,
    figures: list[dict[str, Any]],
) -> dict[str, Any]:
    result: dict[str, Any] = {
        "joints": list(robot.joints),
        "unit": robot.unit,
        "method": method,
        "bandwidth": bandwidth,
        "logs": figures,
    }
    if threshold is not None:
        result["threshold"] = {
            "constant": threshold.constant,
            "by_speed": threshold.by_speed,
            "by_acceleration": threshold.by_acceleration,
        }
    if cumulative is not None:
        result["cusum"] = {"allowance": cumulative.allowance, "limit": cumulative.limit}
    return result
