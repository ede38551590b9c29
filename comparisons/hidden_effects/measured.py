"""Half measured cases: an effect added to a measured log, and a known term deleted from a model of one.

The logs are other people's and no part of this project (see their README): without their folder there are no such
cases. A case with an added effect keeps the measured motion; its current is a model of the robot, plus what the model
leaves of the measurement, turned by half of its length so that it keeps its size, its bursts and its memory but has
nothing to do with the motion, plus the effect. In a case with a deleted term everything is as measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import files
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from comparisons.hidden_effects.answer import Secret, Truth
from comparisons.hidden_effects.laws import LAWS, Scene, sign
from comparisons.hidden_effects.severity import unabsorbed
from ident.arrays import FloatArray
from ident.effects.friction import Coulomb, Viscous
from ident.fit import Drives, fit
from ident.gap import baseline_model
from ident.log import JointLog
from ident.model import CurrentModel
from ident.readers import open_log
from ident.robot import Robot, load_robot
from ident.signals import derive

FOLDER = "SENSORLESS_MEASURED"
"""Environment variable that holds the folder of the measured logs."""

LOGS = {
    "ur3-measured": ("ur3_aspectum/id1.mat", "ur3_aspectum/id2.mat"),
    "lwr4-measured": ("kuka_lwr4_flobaroid/measurements_1.npz", "kuka_lwr4_flobaroid/measurements_2.npz"),
}
"""Log to find it in, log to test on."""

CARDS = {
    # The torque is logged against the motion.
    "ur3-measured": 'time = "mt"\nposition = "mq"\ncurrent = "mtorque"\nscale = { current = -1.0 }\n',
    "lwr4-measured": 'time = "times"\nposition = "positions"\ncurrent = "torques"\n',
}

ADDED = ("stribeck", "load-friction", "position-friction", "coulomb-asymmetry", "cable-spring", "maxwell-slip")
DELETED = ("coulomb", "viscous")


@dataclass(frozen=True)
class MeasuredTask:
    """A half measured case: the robot of `LOGS`, what is hidden on which joint; severity None deletes a term."""

    robot: str
    effect: str
    joint: int
    severity: float | None
    seed: int
    folder: Path

    @property
    def kind(self) -> str:
        """Set of the case."""
        return "deleted" if self.severity is None else "added"

    @property
    def name(self) -> str:
        """A name unlike that of any other task of a run."""
        strength = "" if self.severity is None else f"x{self.severity:g}"
        return f"{self.kind}-{self.robot}-{self.effect}@{self.joint + 1}{strength}-s{self.seed}"


@dataclass(frozen=True, eq=False)
class MeasuredCase:
    """Logs of a half measured case, the model to begin with, and what is hidden."""

    model: CurrentModel
    train: list[JointLog]
    test: list[JointLog]
    truth: Truth


def measured_tasks(folder: Path | None, seed: int, severities: tuple[float, ...] = (2.0,)) -> list[MeasuredTask]:
    """Return the half measured cases of a run; none without the folder of the logs."""
    if folder is None or not folder.is_dir():
        return []
    return list(_tasks(folder, seed, severities))


def _tasks(folder: Path, seed: int, severities: tuple[float, ...]) -> Iterator[MeasuredTask]:
    for number, robot in enumerate(LOGS):
        if not all((folder / name).is_file() for name in LOGS[robot]):
            continue
        for k, effect in enumerate(ADDED):
            for severity in severities:
                yield MeasuredTask(robot, effect, (2 * k + number + seed) % 6, severity, seed, folder)
        for k, effect in enumerate(DELETED):
            yield MeasuredTask(robot, effect, (1 + 3 * k + seed) % 6, None, seed, folder)


def make_measured(task: MeasuredTask) -> MeasuredCase:
    """Build a half measured case.

    Raises:
        InputError: a log is not there or is not what it was.
    """
    robot = _robot(task.robot, task.folder)
    train, test = ([_log(robot, task.folder / name)] for name in LOGS[task.robot])
    model = baseline_model(robot, train)
    if task.severity is None:
        return _deleted(task, model, train, test)
    return _added(task, model, train, test)


def _deleted(task: MeasuredTask, model: CurrentModel, train: list[JointLog], test: list[JointLog]) -> MeasuredCase:
    kinds = {"coulomb": Coulomb, "viscous": Viscous}
    gone = next(t for t in model.terms if isinstance(t.effect, kinds[task.effect]) and t.effect.joint == task.joint)
    effects = [t.effect for t in model.terms if t is not gone]
    poorer = fit(model.robot, effects, train, model.cutoff, Drives(model.gain, model.force_unit)).model
    key = {"coulomb": "force", "viscous": "damping"}[task.effect]
    motion = derive(train[0], model.cutoff)
    force = gone.effect.current(model.context(motion), gone.shape, gone.coefficients, gone.effect.start())
    # All of the term over what the whole model leaves: the others may absorb part of it.
    severity = _size(np.nan_to_num(force)) / (model.gain * _size(_residual(model, train[0])))[task.joint]
    secret = Secret(task.effect, (task.joint,), round(float(severity), 2), {key: float(gone.coefficients[0])})
    left = _residual(model, test[0])
    least = tuple(_size(left).tolist())
    truth = Truth(task.name, task.robot, task.kind, (secret,), least, least, exact_noise=False)
    return MeasuredCase(poorer, train, test, truth)


def _added(task: MeasuredTask, model: CurrentModel, train: list[JointLog], test: list[JointLog]) -> MeasuredCase:
    assert task.severity is not None
    scenes = [_scene(model, logs[0]) for logs in (train, test)]
    residuals = [np.roll(_residual(model, logs[0]), len(logs[0]) // 2, axis=0) for logs in (train, test)]
    wanted = task.severity * float(_size(residuals[0])[task.joint] * model.gain[task.joint])
    # The laws are linear in their strength.
    strength = wanted / unabsorbed(scenes[:1], [_force(task, scenes[0], 1.0)[0]], task.joint)
    logs: list[JointLog] = []
    figures: dict[str, float] = {}
    for log, scene, left in zip((train[0], test[0]), scenes, residuals, strict=True):
        force, figures = _force(task, scene, strength)
        logs.append(log.replace(current=(scene.known + force) / model.gain + left))
    secret = Secret(task.effect, (task.joint,), task.severity, figures)
    truth = Truth(
        task.name, task.robot, task.kind, (secret,), *2 * (tuple(_size(residuals[1]).tolist()),), exact_noise=False
    )
    return MeasuredCase(baseline_model(model.robot, logs[:1]), logs[:1], logs[1:], truth)


def _force(task: MeasuredTask, scene: Scene, strength: float) -> tuple[FloatArray, dict[str, float]]:
    return LAWS[task.effect](scene, task.joint, strength, np.random.default_rng([task.seed, task.joint]))


def _scene(model: CurrentModel, log: JointLog) -> Scene:
    motion = derive(log, model.cutoff)
    known = np.nan_to_num(model.predict(log)) * model.gain
    dry, damping = np.zeros(model.n), np.zeros(model.n)
    for term in model.terms:
        if isinstance(term.effect, Coulomb):
            dry[term.effect.at] = term.coefficients[0]
        if isinstance(term.effect, Viscous):
            damping[term.effect.at] = term.coefficients[0]
    start = (np.diff(log.segment, prepend=log.segment[0] - 1) != 0).astype(float)
    body, links = model.robot.rigid_body, model.link_parameters
    load = model.load(motion)
    turned = sign(motion.dq)
    return Scene(log.t, motion.q, motion.dq, motion.ddq, load, known, start, turned, turned, dry, damping, body, links)


def _residual(model: CurrentModel, log: JointLog) -> FloatArray:
    return np.asarray(np.nan_to_num(log.current - model.predict(log)))


def _size(residual: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)))


def _log(robot: Robot, path: Path) -> JointLog:
    log = open_log(path, robot).read()
    return log.replace(dq=None, ddq=None)  # derived as everywhere else


@cache
def _robot(name: str, folder: Path) -> Robot:
    """Return the robot of measured logs, with torque for current."""
    if name == "ur3-measured":
        wanted = "example-robot-data/robots/ur_description/urdf/ur3_robot.urdf"
        urdf = next(Path(str(f.locate())) for f in files("example-robot-data") or [] if str(f).endswith(wanted))
    else:
        urdf = folder / "kuka_lwr4_flobaroid" / "kuka_lwr4.urdf"
    card = Path(mkdtemp(prefix="hidden-effects-")) / "robot.toml"
    card.write_text(f'name = "{name}"\nurdf = "{urdf}"\ncurrent_unit = "N*m"\n[log]\n{CARDS[name]}')
    return load_robot(card)
