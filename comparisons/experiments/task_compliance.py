"""Task compliance: a hand leads the tool of an arm that follows the wrench a network tells."""

from __future__ import annotations

from typing import Any

import numpy as np

from comparisons.experiments.compliance_work import NEAR, Work
from comparisons.experiments.compliant import READY, Ride, TaskFollower, ride
from comparisons.report.compliance_figures import save, task_compliance
from comparisons.virtual_robot import VirtualRobot
from comparisons.virtual_robot.contact import Hand
from ident.arrays import FloatArray
from ident.log import JointLog
from learned.options import TrainingOptions
from learned.predictor import LearnedModel
from learned.wrench import WrenchModel, train_wrench
from observers.compliance import TaskAdmittance
from observers.deadzone import Deadzone

SCHEMES = ("compound", "single")
GAIN = 0.0025
"""Kp of the task admittance [m/s per N]."""

HAND = Hand(
    times=(3.0, 6.0, 7.0, 10.0, 11.0, 14.0, 15.0, 18.0),
    offsets=(
        (0.0, 0.0, 0.0), (0.0, 0.14, 0.0), (0.0, 0.14, 0.0), (-0.12, 0.14, 0.08), (-0.12, 0.14, 0.08),
        (-0.12, 0.0, 0.08), (-0.12, 0.0, 0.08), (0.0, 0.0, 0.0),
    ),
    start=3.0,
    stop=19.0,
)  # fmt: skip
"""Leads the tool around the corners of a path, and lets go a second after the last."""

SECONDS = 22.0
TOUCHED_SECONDS = 120.0


def task_experiment(work: Work, network: LearnedModel) -> dict[str, Any]:
    """Train both schemes, let a hand lead the tool of the arm that follows the compound one, and draw it."""
    virtual, sizes = work.virtual, work.sizes
    half = sizes.wrench_seconds / 2.0
    train = [work.log(NEAR, half, seed) for seed in (7, 8)]
    test = [work.log(NEAR, TOUCHED_SECONDS, seed) for seed in (9, 10)]
    options = TrainingOptions(
        epochs=sizes.wrench_epochs, width=sizes.wrench_width, batch=512, seed=sizes.seed, device=sizes.device
    )
    models: dict[str, WrenchModel] = {}
    for scheme in SCHEMES:
        work.progress(f"wrench, {scheme}", 0.0)
        models[scheme] = train_wrench(
            virtual.robot, train, test[:1], network if scheme == "compound" else None, options
        )
        work.progress(f"wrench, {scheme}", 1.0)
    log = test[1].read()
    error = models["compound"].predict(log)[:, :3] - _wrench(log)[:, :3]
    boundary = np.sqrt(np.nanmean(error**2, axis=0))
    law = TaskAdmittance(virtual.robot, GAIN, Deadzone.of(boundary))
    work.progress("task compliance", 0.0)
    one = ride(virtual, TaskFollower(models, "compound", law), SECONDS, [HAND], sizes.seed)
    work.progress("task compliance", 1.0)
    save(task_compliance(one, boundary), work.out / "task_compliance")
    return {
        "deadzone": boundary,
        "parameters": {name: model.parameters for name, model in models.items()},
        "kept_after_epoch": {name: model.trained.training["stages"][0]["best_epoch"] for name, model in models.items()},
        "rms_test": np.sqrt(np.mean(_wrench(log) ** 2, axis=0)),
        "rmse_test": {name: _rmse(model.predict(log), log) for name, model in models.items()},
        **_task_figures(virtual, one),
    }


def _task_figures(virtual: VirtualRobot, one: Ride) -> dict[str, Any]:
    """Errors of the wrenches felt, how the tool went and turned, and what it did when it was let go."""
    log, multibody = one.log, virtual.robot.multibody
    led = slice(*(int(np.searchsorted(log.t, t)) for t in (READY, HAND.stop)))
    poses = [multibody.frame_pose(q) for q in log.q[:: round(0.1 * log.rate)]]
    places = np.array([place for _, place in poses])
    turned = [np.arccos(np.clip((np.trace(poses[-1][0].T @ turn) - 1.0) / 2.0, -1.0, 1.0)) for turn, _ in poses]
    start = int(READY * 10.0)
    return {
        "rmse_ride": {name: _rmse(felt[led], log[led]) for name, felt in one.felt.items()},
        "rms_ride": np.sqrt(np.mean(_wrench(log)[led] ** 2, axis=0)),
        "greatest_force": float(np.linalg.norm(_wrench(log)[:, :3], axis=1).max()),
        "tool_way": float(np.linalg.norm(np.diff(places[start:], axis=0), axis=1).sum()),
        "tool_turned": float(max(turned[start:])),
        "travel_after_release": float(np.ptp(log.q[one.untouched & (log.t > HAND.stop)], axis=0).max()),
    }


def _wrench(log: JointLog) -> FloatArray:
    assert log.wrench is not None
    return log.wrench


def _rmse(estimate: FloatArray, log: JointLog) -> FloatArray:
    """Error (6,) of a wrench; rows without an estimate do not count."""
    error = estimate - _wrench(log)
    known = np.isfinite(error).all(axis=1)
    return np.asarray(np.sqrt(np.mean(error[known] ** 2, axis=0)))
