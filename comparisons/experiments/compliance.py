"""Joint and task compliance of the paper on the virtual VS060 (section VI, its figures of both).

Run it by ``python -m comparisons.experiments.compliance --out DIR``; a run that was killed goes on when it is started
again. It writes ``compliance.json``, ``compliance.md`` and the two figures into DIR, and keeps logs and models there.

Joint compliance: each link is pushed by itself, then two at once, while the joints follow the residuals of HRDL-MD; the
momentum observer with the paper's model, which has no memory, and one with Maxwell slip look on, then lead in their
turn. Task compliance: a hand leads the tool, and the arm follows the wrench that a network makes of HRDL-MD's residuals
(compound); one of the same size that reads currents (single) looks on.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.cli import run_alone
from comparisons.experiments.compliance_page import compliance_page
from comparisons.experiments.compliance_work import NETWORK, PLAIN, SLIP, Sizes, Work
from comparisons.experiments.compliant import CUTOFF, PUSHES, READY, JointFollower, ride, ride_figures
from comparisons.experiments.task_compliance import task_experiment
from comparisons.output import to_json
from comparisons.progress import show_progress
from comparisons.report.compliance_figures import joint_compliance, save
from comparisons.report.provenance import provenance
from comparisons.virtual_robot import VirtualRobot
from ident.arrays import FloatArray
from ident.causal import CausalButterworth
from ident.robot import load_robot
from learned.motion_discriminator import Signal
from learned.predictor import LearnedModel
from observers.compliance import JointAdmittance
from observers.deadzone import Deadzone
from observers.direct import DirectEstimator
from observers.residual import ResidualEstimator

ROBOT = "vs060"
GAIN = 0.02
"""Kp of the joint admittance [rad/s per %Use]."""

FREE_SECONDS = 300.0
"""Seconds of the log that deadzones are taken from."""


def compliance(
    *,
    out: Path,
    seconds: float = 7200.0,
    epochs: int = 3,
    width: int = 64,
    wrench_seconds: float = 7200.0,
    wrench_epochs: int = 5,
    wrench_width: int = 128,
    signal: Signal = "velocity",
    model: Path | None = None,
    seed: int = 0,
    device: str | None = None,
) -> None:
    """Make the paper's experiments of joint and task compliance on the virtual VS060.

    Args:
        out: directory for figures, figures' values, logs and models.
        seconds: of stop-and-go motion to learn from.
        epochs: of HRDL-MD.
        width: of its hidden layers; the paper's is 256.
        wrench_seconds: of motion with pushes at the tool, to learn the wrench from.
        wrench_epochs: of the two networks that tell the wrench.
        wrench_width: of their hidden layers.
        signal: that tells HRDL-MD of motion past; the paper's is velocity.
        model: HRDL-MD trained before, by train or table_two.
        seed: of motion, noise and weights.
        device: that networks learn on: cpu or cuda.
    """
    sizes = Sizes(seconds, epochs, width, wrench_seconds, wrench_epochs, wrench_width, seed, signal, device)
    out.mkdir(parents=True, exist_ok=True)
    with show_progress() as progress:
        work = Work(VirtualRobot(load_robot(ROBOT)), out, sizes, progress)
        network = work.network() if model is None else LearnedModel.load(model, work.virtual.robot)
        result: dict[str, Any] = {"joint": joint_experiment(work, network), "task": task_experiment(work, network)}
    words = ["python", "-m", "comparisons.experiments.compliance", *sys.argv[1:]]
    note = provenance([out / "logs"], seed=seed, command=words, libraries=("torch",))
    result |= {
        "unit": work.virtual.robot.unit,
        "sizes": dataclasses.asdict(sizes),
        "trained_before": model is not None,
        "provenance": note.to_dict(),
    }
    (out / "compliance.json").write_text(to_json(result), encoding="utf-8")
    (out / "compliance.md").write_text(compliance_page(result), encoding="utf-8")
    print(out / "compliance.md")


def joint_experiment(work: Work, network: LearnedModel) -> dict[str, Any]:
    """Push the arm led by each estimator in turn, and draw the ride that HRDL-MD leads."""
    virtual = work.virtual
    estimators: dict[str, ResidualEstimator] = {NETWORK: DirectEstimator(network, 100.0), **work.observers()}
    free = work.log("stop_and_go", FREE_SECONDS, 6).read()
    boundary = {name: _peak(estimator.run(free).current, free.rate) for name, estimator in estimators.items()}
    rides = {
        f"{NETWORK} leads": (NETWORK, NETWORK),
        f"{PLAIN} leads, deadzone of {NETWORK}": (PLAIN, NETWORK),
        f"{PLAIN} leads, its own deadzone": (PLAIN, PLAIN),
        f"{SLIP} leads, its own deadzone": (SLIP, SLIP),
    }
    result: dict[str, Any] = {"deadzone": boundary, "rides": {}}
    for number, (name, (leader, zone)) in enumerate(rides.items()):
        work.progress("joint compliance", number / len(rides))
        law = JointAdmittance(GAIN, Deadzone.of(boundary[zone]), virtual.robot.limits, cutoff=CUTOFF)
        end = PUSHES[-1].start + PUSHES[-1].duration + 2.0
        one = ride(virtual, JointFollower(estimators, leader, law), end, PUSHES, work.sizes.seed)
        result["rides"][name] = ride_figures(virtual, one, PUSHES)
        if leader == NETWORK:
            save(joint_compliance(virtual.robot, one, boundary[zone], PUSHES), work.out / "joint_compliance")
    work.progress("joint compliance", 1.0)
    return result


def _peak(values: FloatArray, rate: float) -> FloatArray:
    """Greatest size (n,) of a low-passed signal after its first seconds: the deadzone that nothing passes."""
    passed = CausalButterworth(rate, CUTOFF, order=2, channels=values.shape[1]).run(np.nan_to_num(values))
    return np.asarray(np.abs(passed[round(READY * rate) :]).max(axis=0))


if __name__ == "__main__":
    run_alone(compliance)
