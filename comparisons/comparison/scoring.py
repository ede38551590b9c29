"""The figures of one estimator on the test logs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from comparisons.comparison.contestant import Contestant
from comparisons.comparison.held_out import HeldOut, low_pass
from comparisons.metrics import contact_figures, error_figures, rmse
from ident.arrays import BoolArray, FloatArray
from ident.causal import FORGOTTEN
from ident.errors import InputError
from ident.log import JointLog
from ident.model import CurrentModel
from observers.contact import ContactDetector
from observers.residual import Flag, Residual, ResidualEstimator, joint_torque
from observers.stamps import Stamps
from observers.thresholds import Threshold, fit_threshold

FALSE_ALARMS = 1.0
"""False alarms an hour for which thresholds of contact are fitted."""


SETTLED = 5.0
"""Periods of the motion filter's cut-off after a start or a gap in which nothing is scored: accelerations are late."""


@dataclass(frozen=True, eq=False)
class Score:
    """An estimator on the test logs.

    Attributes:
        contestant: the estimator.
        error: residual against the current as logged, (N, n) over all logs; NaN where there is none.
        smooth: residual in step with the current and at the common bandwidth, (N, n); NaN where there is none.
        figures: as result.json holds them.
    """

    contestant: Contestant
    error: FloatArray
    smooth: FloatArray
    figures: dict[str, Any]


def score(contestant: Contestant, tests: HeldOut, bandwidth: float) -> Score:
    """Run an estimator over all test logs and take its figures.

    Raises:
        InputError: a log does not suit the estimator.
    """
    error = np.concatenate([_residual(contestant, contestant.estimator(log), log) for log in tests.logs])
    smooth = np.concatenate([_smooth(contestant, log, bandwidth) for log in tests.logs])
    own = error_figures(error, tests.regimes)
    unknown = ~np.isfinite(error).all(axis=1)
    figures: dict[str, Any] = {
        **own,
        "kind": "direct" if contestant.observer is None else "observer",
        "learned": contestant.learned,
        "memory": contestant.memory,
        "parameters": contestant.parameters,
        "training_seconds": contestant.seconds,
        "skipped": {log.name: int(unknown[rows].sum()) for log, rows in zip(tests.logs, tests.rows, strict=True)},
        "smoothed": error_figures(smooth, tests.regimes),
        **_contact(tests, smooth, contestant),
        **_without_lag(contestant, tests),
    }
    if contestant.gain is not None:
        figures["gain"] = contestant.gain
        figures["torque"] = {name: value * np.abs(contestant.gain) for name, value in own.items()}
    return Score(contestant, error, smooth, figures)


def _without_lag(contestant: Contestant, tests: HeldOut) -> dict[str, FloatArray]:
    """Error of a physical model's prediction with the filters that do not lag, which no robot can run online."""
    model = contestant.model
    if contestant.observer is not None or not isinstance(model, CurrentModel):
        return {}
    error = np.concatenate([model.predict(log) - log.current for log in tests.logs])
    return {"rmse_without_lag": rmse(error, tests.regimes.masks()["rmse"])}


def _residual(contestant: Contestant, estimator: ResidualEstimator, log: JointLog) -> FloatArray:
    """Residual (N, n) of a log; NaN where the estimator has none, or its motion filter has not settled."""
    residual = estimator.run(log)
    return np.where((residual.good & _settled(contestant, log))[:, None], residual.current, np.nan)


def _settled(contestant: Contestant, log: JointLog) -> BoolArray:
    """Rows (N,) at which the filter that derives motion has forgotten the start, or the gap, behind it."""
    cutoff = contestant.model.cutoff
    stamps = Stamps(log.rate, FORGOTTEN / cutoff, SETTLED / cutoff)
    settled = np.zeros(len(log), dtype=np.bool_)
    for rows in log.segments():
        stamps.reset()
        flags, _ = stamps.scan(log.t[rows], log.q[rows])
        settled[rows] = (flags & int(Flag.SETTLING)) == 0
    return settled


def _smooth(contestant: Contestant, log: JointLog, bandwidth: float) -> FloatArray:
    """Residual at the common bandwidth, which observers have by themselves."""
    residual = _residual(contestant, contestant.in_step(log), log)
    return residual if contestant.observer is not None else low_pass(residual, log, bandwidth)


def _contact(tests: HeldOut, smooth: FloatArray, contestant: Contestant) -> dict[str, Any]:
    """Figures that stand on a threshold: what can be detected, and how contacts are."""
    threshold, source = _threshold(tests, smooth)
    if threshold is None:
        return {"detectable_current": np.full(smooth.shape[1], np.nan)}
    figures: dict[str, Any] = {"detectable_current": threshold.constant, "threshold_from": source}
    if contestant.gain is not None:
        figures["detectable_torque"] = threshold.constant * np.abs(contestant.gain)
    if not tests.touched.any():
        return figures
    told = np.zeros(len(smooth), dtype=np.bool_)
    detector = ContactDetector(threshold)
    every = np.ones(len(smooth), dtype=np.bool_)
    for residual, rows in zip(_residuals(tests, smooth, every), tests.rows, strict=True):
        told[rows] = detector.run(residual).level > 0
    sureness = np.abs(smooth / threshold.constant).max(axis=1)
    figures["contact"] = dict(contact_figures(tests.regimes, tests.touched, told, sureness))
    torque = joint_torque(smooth, contestant.gain, contestant.coupling)
    if torque is not None and all(log.tau_ext is not None for log in tests.logs):
        truth = np.concatenate([log.tau_ext for log in tests.logs if log.tau_ext is not None])
        mask = np.broadcast_to(tests.touched[:, None], smooth.shape)
        figures["contact"]["torque_rmse"] = rmse(torque - truth, mask)
    return figures


def _threshold(tests: HeldOut, smooth: FloatArray) -> tuple[Threshold | None, str]:
    """Threshold of contact from logs without one or, where there are none, from the free rows of those there are."""
    alone = np.zeros(len(smooth), dtype=np.bool_)
    for rows in tests.rows:
        alone[rows] = not tests.touched[rows].any()
    for free, source in ((alone, "logs without contact"), (tests.regimes.free, "rows without contact")):
        try:
            return fit_threshold(_residuals(tests, smooth, free), FALSE_ALARMS), source
        except InputError:
            continue  # too short
    return None, ""


def _residuals(tests: HeldOut, smooth: FloatArray, counted: BoolArray) -> list[Residual]:
    """Residuals log by log, in which only finite rows that are ``counted`` (N,) are good."""
    good = counted & np.isfinite(smooth).all(axis=1)
    flags = np.where(good, int(Flag.GOOD), int(Flag.SETTLING))
    return [
        Residual(log.t, np.nan_to_num(smooth[rows]), None, flags[rows], log.segment, "")
        for log, rows in zip(tests.logs, tests.rows, strict=True)
    ]
