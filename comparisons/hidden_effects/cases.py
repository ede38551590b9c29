"""Cases: a robot, logs of its motion, and an effect hidden in them at a severity."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import files
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import label
from scipy.signal import lfilter

from comparisons.hidden_effects import foreign  # noqa: F401  (enters the foreign laws)
from comparisons.hidden_effects.laws import FOREIGN, LAWS, Scene, sign
from comparisons.hidden_effects.severity import unabsorbed
from comparisons.hidden_effects.styles import POOR, STYLES, reference
from comparisons.virtual_robot.figures import usual_torque
from comparisons.virtual_robot.load import perturbed
from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.log import JointLog
from ident.robot import Robot, load_robot
from ident.signals import zero_phase

ROBOTS = {
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
}
PANDA_JOINTS = [f"panda_joint{k}" for k in range(1, 8)]
WHOLE_ROBOT = ("payload", "base-tilt", "delay", "filter-lag")

PARTS = 10
"""Steps between two samples in which friction that yields is simulated: joints turn between them."""

STANDS = 2e-3
"""A joint that is slower [rad/s] stands."""

SLOW, LASTS = 0.4, 0.08
"""Share of the current noise's square that is correlated, and over how many seconds; the rest is white."""

CHANGES = ("payload", "drive-gain", "rotor-inertia", "current-offset")
"""Effects that a refitted baseline absorbs: they show against a model that was identified before the change."""


@dataclass(frozen=True)
class Hidden:
    """An effect to hide: its name, its joint (from 0, None for the whole robot), and its severity.

    The severity is the RMS, on the train logs, of the part that the refitted baseline cannot absorb, over the RMS of
    the noise; of an effect that is a change, the RMS of all of it.
    """

    effect: str
    joint: int | None
    severity: float


@dataclass(frozen=True)
class Case:
    """What is hidden in which robot, moved and logged in a style of `STYLES` or `POOR`.

    ``changed`` asks what changed since a model was identified.
    """

    robot: str
    hidden: tuple[Hidden, ...]
    seed: int
    changed: bool = False
    noise: float = 0.02
    gains_known: bool = False
    style: str = "usual"

    @property
    def name(self) -> str:
        """A name that says all of it."""
        parts = [f"{h.effect}@{'all' if h.joint is None else h.joint + 1}x{h.severity:g}" for h in self.hidden]
        style = [] if self.style == "usual" else [self.style]
        return "-".join([self.robot, *style, *(parts or ["nothing"]), f"s{self.seed}"])


@dataclass(frozen=True, eq=False)
class Made:
    """Logs of a case and the truth behind them.

    Attributes:
        robot: the robot as the workflow sees it.
        train, test: logs.
        clean: logs of the same robot without the hidden effects, for the model of a case that is a change.
        parameters: true parameters of each hidden effect, by the contract's keys, in units of current.
        noise: standard deviation (n,) of the current noise.
        correlation: samples that say as much of what is slow as one would of white noise.
        plain: the train and test logs with what is hidden in them taken away.
        alone: the train logs with only one of the hidden effects in them, for each of these.
    """

    robot: Robot
    train: list[JointLog]
    test: list[JointLog]
    clean: list[JointLog]
    parameters: list[dict[str, float]]
    noise: FloatArray
    correlation: float
    plain: list[JointLog]
    alone: list[list[JointLog]]


@cache
def robot_of(name: str, gains_known: bool = False) -> Robot:
    """Return a built-in robot or one of example-robot-data's, with its gains unknown unless told."""
    if name in ROBOTS:
        wanted = f"example-robot-data/robots/{ROBOTS[name]}"
        urdf = next(Path(str(f.locate())) for f in files("example-robot-data") or [] if str(f).endswith(wanted))
        joints = f"joints = {PANDA_JOINTS}\n" if name == "panda" else ""
        gain = ""
    else:
        builtin = load_robot(name)
        assert builtin.urdf is not None
        urdf, joints, gain = builtin.urdf, "", ""
    card = Path(mkdtemp(prefix="hidden-effects-")) / "robot.toml"
    text = f'name = "{name}"\nurdf = "{urdf}"\n{joints}current_unit = "A"\n{gain}'
    card.write_text(text)
    robot = load_robot(card)
    if gains_known:
        card.write_text(text + f"[drive]\ngain = {_gain(robot).tolist()}\n")
        robot = load_robot(card)
    return robot


def _gain(robot: Robot) -> FloatArray:
    gain: FloatArray = usual_torque(robot) * 0.2
    return gain


def make(case: Case) -> Made:
    """Build the logs of a case."""
    return Maker(case).make()


class Maker:
    """Builds a case, step by step.

    Args:
        case: what is hidden where.
    """

    def __init__(self, case: Case) -> None:
        self.case = case
        self.style = {**STYLES, **POOR}[case.style]
        self.robot = robot_of(case.robot, case.gains_known)
        self.seed = int(hashlib.sha256(case.name.encode()).hexdigest()[:8], 16)
        rng = np.random.default_rng(self.seed)
        self.usual = usual_torque(self.robot)
        self.gain = _gain(self.robot)
        self.parameters = perturbed(self.robot.multibody.parameters, 0.07, case.seed)
        n = self.robot.n
        self.coulomb = self.usual * rng.uniform(0.08, 0.2, n)
        self.viscous = self.usual * rng.uniform(0.05, 0.2, n)
        self.rotor = 0.08 * self.usual / 10.0 * rng.uniform(0.5, 1.5, n)
        self.offset = 0.02 * self.usual * rng.standard_normal(n)
        self.rng = rng

    def make(self) -> Made:
        """Build its logs."""
        scenes = [self.scene(self.paths(k)) for k in range(4)]
        clean_scenes = [self.scene(self.paths(10 + k)) for k in range(3)] if self.case.changed else []
        noise, strengths = self.measure(scenes[:3])
        forces, parameters = zip(*(self.hidden(s, strengths) for s in scenes), strict=True)
        logs = [self.log(s, f.sum(axis=0), noise, k) for k, (s, f) in enumerate(zip(scenes, forces, strict=True))]
        clean = [self.log(s, np.zeros_like(s.q), noise, 10 + k) for k, s in enumerate(clean_scenes)]
        plain = [self.log(s, np.zeros_like(s.q), noise, k) for k, s in enumerate(scenes)]
        alone = [
            [self.log(s, f[i], noise, k) for k, (s, f) in enumerate(zip(scenes[:3], forces[:3], strict=True))]
            for i in range(len(self.case.hidden))
        ]
        correlation = 1.0 - SLOW + SLOW * (1.0 + self._pole) / (1.0 - self._pole)
        return Made(
            self.robot, logs[:3], logs[3:], clean, parameters[0], noise / self.gain, correlation, plain, alone
        )  # fmt: skip

    def record(self, commanded: JointLog) -> JointLog:
        """Log a commanded motion on the same robot, with the same effects hidden at the same strength."""
        noise, strengths = self.measure([self.scene(self.paths(k)) for k in range(3)])
        scene = self.scene([commanded.q], commanded.rate)
        return replace(self.log(scene, self.hidden(scene, strengths)[0].sum(axis=0), noise, 20), name=commanded.name)

    def measure(self, scenes: Sequence[Scene]) -> tuple[FloatArray, list[float]]:
        """Standard deviation of the noise (n,) in force units, and the strength of each hidden effect."""
        usual = np.sqrt(np.mean(np.concatenate([s.known for s in scenes]) ** 2, axis=0))
        noise = self.case.noise * usual
        return noise, [self.strength(hidden, scenes, noise) for hidden in self.case.hidden]

    def hidden(self, scene: Scene, strengths: Sequence[float]) -> tuple[FloatArray, list[dict[str, float]]]:
        """Force (k, N, n) of each hidden effect, and their true parameters."""
        forces, parameters = np.zeros((len(strengths), *scene.q.shape)), []
        for k, (hidden, strength) in enumerate(zip(self.case.hidden, strengths, strict=True)):
            forces[k], truth = self.effect(hidden, scene, strength)
            parameters.append(self.in_current(hidden, truth))
        return forces, parameters

    def effect(self, hidden: Hidden, scene: Scene, strength: float) -> tuple[FloatArray, dict[str, float]]:
        """Force (N, n) of a hidden effect at a strength, and its true parameters."""
        found = {**LAWS, **FOREIGN}[hidden.effect]
        rng = np.random.default_rng([self.seed, len(hidden.effect), 0 if hidden.joint is None else hidden.joint])
        return found(scene, 0 if hidden.joint is None else hidden.joint, strength, rng)

    def in_current(self, hidden: Hidden, truth: dict[str, float]) -> dict[str, float]:
        """Forces in the card's unit: N m where gains are known, else current."""
        if self.case.gains_known or hidden.joint is None:
            return truth
        per_gain = ("force", "damping", "inertia", "stiffness", "offset", "per_hour")
        scaled = {k: v / self.gain[hidden.joint] if k in per_gain else v for k, v in truth.items()}
        if hidden.effect == "load-friction":
            scaled["force"] = truth["force"]
        return scaled

    def strength(self, hidden: Hidden, scenes: Sequence[Scene], noise: FloatArray) -> float:
        """Find the strength that has the severity; secant steps on the logarithm.

        Raises:
            ValueError: no strength has it: friction does not turn round, gears do not wind up by radians, and what is
                to show in a creep is no more than the joint usually carries when it moves as fast as others do.
        """
        joints = range(self.robot.n) if hidden.joint is None else [hidden.joint]

        def severity(a: float) -> float:
            forces = [self.effect(hidden, s, a)[0] for s in scenes]
            return max(self.unmodelled(scenes, forces, j) / float(noise[j]) for j in joints)

        a: float = 1.0
        for _ in range(12):
            now = severity(a)
            if abs(now / hidden.severity - 1.0) < 0.02:
                break
            a *= float((hidden.severity / max(now, 1e-12)) ** 0.9)
        else:
            if abs(severity(a) / hidden.severity - 1.0) > 0.2:
                raise ValueError(f"{hidden.effect} does not reach severity {hidden.severity:g} in these logs")
        if self.case.style in POOR:
            fast = self.scene([reference(self.robot, "fourier", 20.0, self.case.seed, self.style.rate)])
            there = np.sqrt(np.mean(self.effect(hidden, fast, a)[0] ** 2, axis=0))
            if any(there[j] > self.usual[j] for j in joints):
                raise ValueError(f"{hidden.effect} in severity {hidden.severity:g} would be more than joints carry")
        return a

    def unmodelled(self, scenes: Sequence[Scene], forces: Sequence[FloatArray], j: int) -> float:
        """RMS of the part of a joint's hidden force that the baseline leaves, refitted unless it is held fixed."""
        if self.case.changed:
            return float(np.sqrt(np.mean(np.concatenate([f[:, j] for f in forces]) ** 2)))
        return unabsorbed(scenes, forces, j)

    def scene(self, paths: Sequence[FloatArray], rate: float | None = None) -> Scene:
        """What laws see of a log of those paths, one after the other."""
        rate = rate or self.style.rate
        q, dq, ddq, t, start = _motion(paths, rate)
        torque = self.robot.rigid_body.inverse_dynamics(q, dq, ddq, self.parameters)
        dry = direction = self.direction(q, dq, rate, start)
        if self.style.holds:
            # The same motion finds the same levels, whatever is hidden in it.
            dry = held(dry, dq, np.random.default_rng([self.seed, len(q), int(1e6 * np.abs(q[0]).sum())]))
        known = torque + self.rotor * ddq + self.coulomb * dry + self.viscous * dq + self.offset
        return Scene(
            t, q, dq, ddq, torque, known, start, direction, dry,
            self.coulomb, self.viscous, self.robot.rigid_body, self.parameters,
        )  # fmt: skip

    def direction(self, q: FloatArray, dq: FloatArray, rate: float, start: FloatArray) -> FloatArray:
        """Direction (N, n) of dry friction, at samples of that rate."""
        if self.style.yields is None:
            return sign(dq)
        shortest, longest = np.log(self.style.yields)
        lengths = np.exp(np.random.default_rng([self.seed, 7]).uniform(shortest, longest, q.shape[1]))
        way = dq / rate
        return np.stack([built_up(q[:, j] / x, way[:, j] / x, start) for j, x in enumerate(lengths)], axis=1)

    def paths(self, number: int) -> list[FloatArray]:
        """Commanded positions (N, n) of the pieces of the log of that number."""
        seeds = (1000 * self.case.seed + 10 * number + k for k in range(len(self.style.pieces)))
        return [
            reference(self.robot, kind, seconds, seed, self.style.rate)
            for (kind, seconds), seed in zip(self.style.pieces, seeds, strict=True)
        ]

    @property
    def _pole(self) -> float:
        """Of the slow part of the noise."""
        return float(np.exp(-1.0 / (self.style.rate * LASTS)))

    def log(self, s: Scene, force: FloatArray, noise: FloatArray, number: int) -> JointLog:
        """Log a scene as the robot's sensors see it, with a hidden force."""
        rng = np.random.default_rng([self.seed, number, 5])
        white = rng.standard_normal(s.q.shape)
        pole = self._pole
        slow = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(s.q.shape), axis=0)
        current = (s.known + force + noise * (np.sqrt(1.0 - SLOW) * white + np.sqrt(SLOW) * slow)) / self.gain
        style = self.style
        noisy = s.q + (style.position_noise * rng.standard_normal(s.q.shape) if style.position_noise else 0.0)
        seen = np.round(noisy / style.count) * style.count
        speed = None if style.velocity_noise is None else s.dq + style.velocity_noise * rng.standard_normal(s.q.shape)
        t = s.t + np.clip(style.jitter * rng.standard_normal(len(s.t)), -0.4, 0.4) / style.rate
        segment = np.cumsum(s.start).astype(np.int64) - 1
        return JointLog(t=t, q=seen, current=current, dq=speed, segment=segment, name=f"log_{number}")


@compiled
def built_up(x: FloatArray, way: FloatArray, start: FloatArray) -> FloatArray:
    """Direction (N,) of friction that yields (Bouc 1967, Wen 1976), over a path in units of its displacement.

    It builds up by dz/dx = 1 - z^2, and goes back along a straight line. Between samples the path is Hermite's cubic.

    Args:
        x: positions (N,).
        way: velocities (N,) times the time between samples.
        start: (N,), above nought where a path begins.
    """
    out, z = np.zeros(len(x)), 0.0
    for k in range(len(x)):
        if k == 0 or start[k] > 0.0:
            z = 0.0
            continue
        last, bend = x[k - 1], way[k - 1] + way[k] - 2.0 * (x[k] - x[k - 1])
        for part in range(1, PARTS + 1):
            s = part / PARTS
            at = x[k - 1] + s * (way[k - 1] + s * (x[k] - x[k - 1] - way[k - 1] - (1.0 - s) * bend))
            steps = max(1, int(np.ceil(abs(at - last) / 0.02)))
            step = (at - last) / steps
            for _ in range(min(steps, 500)):  # ten displacements on, it slips
                z += step * (1.0 - z * z if z * step > 0.0 else 1.0)
            last = at
        out[k] = z
    return out


def held(dry: FloatArray, dq: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Dry friction (N, n) over its force in motion, with a level drawn anew for every rest of a joint.

    Args:
        dry: the same without.
        dq: velocities (N, n) [rad/s].
        rng: draws the levels.
    """
    holding = dry.copy()
    for j in range(dry.shape[1]):
        pieces, count = label(np.abs(dq[:, j]) < STANDS)
        levels = rng.uniform(-1.0, 1.0, count + 1)
        holding[:, j] = np.where(pieces > 0, levels[pieces], dry[:, j])
    return holding


def _motion(paths: Sequence[FloatArray], rate: float) -> tuple[FloatArray, ...]:
    """Positions, velocities, accelerations (N, n), time stamps (N,), and one where a segment starts (N,)."""
    parts, clock = [], 0.0
    for path in paths:
        t = np.arange(len(path)) / rate
        smooth = zero_phase(path, rate, 4.0)
        spline = CubicSpline(t, smooth)
        velocity = CubicSpline(t, spline(t, 1))
        start = np.zeros(len(t))
        start[0] = 1.0
        parts.append((smooth, velocity(t), velocity(t, 1), t + clock, start))
        clock += float(t[-1]) + 2.0
    return tuple(np.concatenate([p[k] for p in parts]) for k in range(5))
