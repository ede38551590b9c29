"""The main job on the virtual VS060, step by step: excite, identify, gap, train, compare, comply."""

from __future__ import annotations

import dataclasses
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.commands.excite import excite_into
from comparisons.commands.gap import gap_into
from comparisons.commands.identify import identify_into
from comparisons.comparison.entrants import Entrants, Request
from comparisons.comparison.held_out import HeldOut
from comparisons.comparison.kept import Kept
from comparisons.comparison.methods import PHYSICS
from comparisons.comparison.run import Comparison, run_comparison
from comparisons.comparison.workshop import Workshop
from comparisons.experiments.compliant import JointFollower, Ride, ride, ride_figures
from comparisons.output import OutputDirectory
from comparisons.progress import Progress, show_progress
from comparisons.protocols import named
from comparisons.report.comparison import comparison_report
from comparisons.report.training import training_report
from comparisons.virtual_robot import VirtualRobot
from comparisons.virtual_robot.contact import Push
from comparisons.virtual_robot.motion import Protocol, in_blocks
from ident.excitation.design import Designer, Excitation
from ident.excitation.design import Request as Design
from ident.log import JointLog, LogSource
from ident.log_writer import write_log
from ident.model import CurrentModel
from ident.readers import open_logs
from ident.robot import load_robot
from learned.motion_discriminator import PLAY_THRESHOLDS
from learned.options import TrainingOptions
from learned.predictor import LearnedModel
from observers.compliance import JointAdmittance
from observers.deadzone import BAND, Deadzone
from observers.direct import DirectEstimator
from observers.momentum import MomentumObserver
from observers.residual import ResidualEstimator

if TYPE_CHECKING:
    from ident.gap import GapReport
    from ident.identification import Identification
    from ident.signals import Motion

ROBOT = "vs060"
EFFECTS = (
    "coulomb",
    "viscous",
    "rotor-inertia",
    "maxwell-slip",
    "load-friction",
    "coulomb-asymmetry",
    "current-offset",
)
"""What the identified model has besides links; to try them all takes longer than a demonstration should."""

TOOL = {"mass": 1.0}
"""What is hidden in the robot after it was identified, as its scenario's payload holds it: a tool of a kilogram."""

PERIODS = 5
"""Times that the designed motion is driven."""

METHODS = ("coulomb-viscous", "gmo", "hrdl-md")
NETWORK = TrainingOptions(
    epochs=3, batch=512, learning_rate=2e-3, width=64, hierarchies=2, signal="displacement", thresholds=PLAY_THRESHOLDS
)
"""A small HRDL-MD. It remembers displacements, which do not ring as velocities do and need less to learn from."""

PUSH = Push(link=3, point=(0.0, 0.0, 0.25), force=(60.0, 0.0, 0.0), start=3.0, duration=2.0, rise=0.3)
GAIN = 0.02
"""Of the joint admittance [rad/s per %Use]."""
MARGIN = 1.25
"""Where the deadzone's band begins, over the greatest residual of the test logs."""


@dataclass(eq=False)
class Demonstration:
    """What came of the steps; each step's own files and report are in a folder of its name.

    Attributes:
        virtual: the robot.
        folder: of the steps.
        seed: of motion and noise.
        seconds: that each step took, by name.
    """

    virtual: VirtualRobot
    folder: Path
    seed: int
    seconds: dict[str, float] = field(default_factory=dict)
    excitation: Excitation = field(init=False)
    designed: Motion = field(init=False)
    identified: Identification = field(init=False)
    gap: GapReport = field(init=False)
    network: LearnedModel = field(init=False)
    comparison: Comparison = field(init=False)
    boundary: np.ndarray[Any, np.dtype[np.float64]] = field(init=False)
    ride: Ride = field(init=False)

    @property
    def push(self) -> dict[str, Any]:
        """Figures of the ride, see `ride_figures`."""
        return ride_figures(self.virtual, self.ride, [PUSH])

    def logs(self, *names: str) -> list[LogSource]:
        """Open some of the logs by name."""
        return open_logs([self.folder / "logs" / f"{name}.parquet" for name in names], self.virtual.robot)

    @property
    def minutes(self) -> float:
        """Length of all logs together [min]."""
        names = [path.stem for path in sorted((self.folder / "logs").iterdir())]
        logs = [source.read() for source in self.logs(*names)]
        return sum(len(log) / log.rate for log in logs) / 60.0

    def paths(self, *names: str) -> list[str]:
        """Paths of some of the logs."""
        return [str(self.folder / "logs" / f"{name}.parquet") for name in names]


IDENTIFY, TEST, TOUCHED = ("designed", "fourier", "continuous", "interrupted"), "test", "touched"
CHANGED = ("changed_1", "changed_2", "changed_3")
CHANGED_TEST = "changed_test"

RECORDINGS: dict[str, tuple[str, float]] = {
    "fourier": ("fourier", 120.0),
    "continuous": ("continuous", 180.0),
    "interrupted": ("stop_and_go", 480.0),
    "more_1": ("stop_and_go", 3600.0),
    "more_2": ("stop_and_go", 3600.0),
    TEST: ("stop_and_go", 90.0),
    TOUCHED: ("contact_episodes", 90.0),
}
"""Protocol and seconds of the logs of the robot as it was identified, besides the designed motion."""


def demonstrate(folder: Path, seed: int) -> Demonstration:
    """Run all steps into folders under ``folder``."""
    demo = Demonstration(VirtualRobot(load_robot(ROBOT)), folder, seed)
    steps = {
        "excite": (_excite, "design a motion that shows the parameters"),
        "record": (_record, "drive the virtual robot"),
        "identify": (_identify, "fit its model"),
        "gap": (_gap, "somebody mounts a tool: what does the model lack now?"),
        "train": (_train, "teach a small HRDL-MD"),
        "compare": (_compare, "hold estimators side by side"),
        "comply": (_comply, "push the compliant arm"),
    }
    for number, (name, (step, what)) in enumerate(steps.items(), start=1):
        if sys.stderr.isatty():
            print(f"[{number}/{len(steps)}] {name}: {what}", file=sys.stderr)
        start = time.perf_counter()
        step(demo)
        demo.seconds[name] = time.perf_counter() - start
    return demo


def _excite(demo: Demonstration) -> None:
    designer = Designer(demo.virtual.robot, Design(restarts=1, seed=demo.seed))
    with OutputDirectory(demo.folder / "excite", "excite") as output:
        demo.excitation = excite_into(output, designer, 100.0, "csv", [])
    demo.designed = demo.excitation.trajectory.sample(100.0)


def _record(demo: Demonstration) -> None:
    (demo.folder / "logs").mkdir()
    changed = VirtualRobot(demo.virtual.robot, demo.virtual.scenario.with_effect("payload", **TOOL))
    with show_progress() as progress:
        path = np.tile(demo.designed.q[:-1], (PERIODS, 1))
        designed = Protocol("designed", 100.0, len(path), lambda: in_blocks(path))
        _write(demo, "designed", demo.virtual.record(designed, demo.seed), progress)
        for number, (name, (protocol, seconds)) in enumerate(RECORDINGS.items(), start=1):
            _drive(demo, demo.virtual, name, protocol, seconds, demo.seed + number, progress)
        for number, name in enumerate(CHANGED):
            _drive(demo, changed, name, "fourier", 30.0, demo.seed + 31 + number, progress)
        _drive(demo, changed, CHANGED_TEST, "stop_and_go", 60.0, demo.seed + 41, progress)


def _drive(
    demo: Demonstration, robot: VirtualRobot, name: str, protocol: str, seconds: float, seed: int, progress: Progress
) -> None:
    motion = named(protocol)(robot.robot, seconds=seconds, seed=seed)
    _write(demo, name, robot.record(motion, seed), progress)


def _write(demo: Demonstration, name: str, log: JointLog, progress: Progress) -> None:
    write_log(log, demo.folder / "logs" / f"{name}.parquet")
    done = len(list((demo.folder / "logs").iterdir()))
    progress("recording", done / (len(RECORDINGS) + len(CHANGED) + 2))


def _identify(demo: Demonstration) -> None:
    with OutputDirectory(demo.folder / "identify", "identify") as output:
        options = {"effects": EFFECTS}
        demo.identified = identify_into(output, ROBOT, demo.paths(*IDENTIFY), demo.paths(TEST), options)


def _gap(demo: Demonstration) -> None:
    with OutputDirectory(demo.folder / "gap", "gap") as output:
        train, test, model = demo.paths(*CHANGED), demo.paths(CHANGED_TEST), demo.folder / "identify"
        demo.gap = gap_into(output, ROBOT, train, test, model, None)


def _train(demo: Demonstration) -> None:
    from comparisons.predictions import errors_on, write_predictions
    from learned.training import train

    logs, held_out = demo.logs(*IDENTIFY, "more_1", "more_2"), demo.logs(TEST)
    options = dataclasses.replace(NETWORK, seed=demo.seed)
    with OutputDirectory(demo.folder / "train", "train") as output, show_progress() as progress:
        demo.network = train(
            demo.virtual.robot, logs, None, "hrdl-md", options, None,
            lambda stand: progress(f"network {stand.stage} of {stand.stages}", stand.epoch / stand.epochs),
        )  # fmt: skip
        demo.network.save(output.path)
        errors = {
            "train": errors_on(demo.network, logs[:1]),
            "test": write_predictions(demo.network, held_out, output.path),
        }
        figures = {name: one.as_dict() for name, one in errors.items()}
        training_report(demo.network, demo.virtual.robot.joints, figures, held_out).write(output.path / "report.html")
        output.result({"unit": demo.virtual.robot.unit, "method": "hrdl-md", **figures})


def _compare(demo: Demonstration) -> None:
    robot = demo.virtual.robot
    with OutputDirectory(demo.folder / "compare", "compare") as output, show_progress() as progress:
        workshop = Workshop(demo.folder / ".models", robot, demo.logs(*IDENTIFY), progress)
        given: dict[str, CurrentModel | LearnedModel] = {PHYSICS: demo.identified.model, "hrdl-md": demo.network}
        kept = Kept(demo.folder / ".residuals")
        kept.folder.mkdir()
        tests = HeldOut.of(demo.logs(TEST, TOUCHED))
        request = Request((PHYSICS, *METHODS), "quick")
        demo.comparison = run_comparison(Entrants(request, workshop, given), tests, kept, progress)
        kept.write(tests, output.path)
        comparison_report(robot, demo.comparison).write(output.path / "report.html")
        output.result({"unit": robot.unit, "joints": list(robot.joints), "methods": demo.comparison.methods})


def _comply(demo: Demonstration) -> None:
    robot, model = demo.virtual.robot, demo.identified.model
    greatest = np.asarray(demo.comparison.methods["gmo"]["smoothed"]["peak"], dtype=np.float64)
    demo.boundary = MARGIN / (1.0 - 0.5 * BAND) * greatest
    law = JointAdmittance(GAIN, Deadzone.of(demo.boundary), robot.limits)
    watcher = DirectEstimator(demo.network, 100.0)
    estimators: dict[str, ResidualEstimator] = {"gmo": MomentumObserver(model, 5.0), "hrdl-md": watcher}
    with show_progress() as progress:
        progress("pushing", 0.0)
        demo.ride = ride(demo.virtual, JointFollower(estimators, "gmo", law), 7.0, [PUSH], demo.seed)
        progress("pushing", 1.0)


@contextmanager
def swept(folder: Path) -> Iterator[None]:
    """Take away what the steps kept for themselves in ``folder`` when the block ends."""
    try:
        yield
    finally:
        for name in (".models", ".residuals"):
            shutil.rmtree(folder / name, ignore_errors=True)
