"""Laws of the hidden effects: what is added to a robot's force. None is written as the catalogue writes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, interp1d
from scipy.signal import lfilter

from ident.arrays import FloatArray, IntArray
from ident.compiled import compiled
from ident.rigid_body import RigidBody


class Scene(NamedTuple):
    """What a law sees of one log: stamps (N,), motion (N, n), what links and all known effects need [force], segment.

    ``direction`` (N, n) is that of dry friction, from -1 to 1, as long as nothing holds it, ``held`` (N, n) with what
    it holds of joints at rest. ``coulomb`` and ``viscous`` (n,) are the robot's own, ``body`` and
    ``parameters`` its true links, ``torque`` the links' part of ``known``.
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    torque: FloatArray
    known: FloatArray
    start: FloatArray
    direction: FloatArray
    held: FloatArray
    coulomb: FloatArray
    viscous: FloatArray
    body: RigidBody
    parameters: FloatArray


Law = Callable[[Scene, int, float, np.random.Generator], tuple[FloatArray, dict[str, float]]]
"""Gives the force (N, n) of an effect on a joint at a strength, and its true parameters by the contract's keys.

The random generator is seeded alike for every log of a case, so that figures drawn from it are the same in all.
"""

LARGE = 8.0
"""A joint's larger torques, over its dry friction."""

WINDS = 0.1
"""Angle [rad] that a gear winds up by under them, at most."""

LAWS: dict[str, Law] = {}
FOREIGN: dict[str, Law] = {}
"""Laws of effects that the catalogue does not have."""


def law(name: str, foreign: bool = False) -> Callable[[Law], Law]:
    """Enter a law under the contract's name, or as one that the catalogue lacks."""

    def enter(function: Law) -> Law:
        (FOREIGN if foreign else LAWS)[name] = function
        return function

    return enter


@dataclass(frozen=True)
class Elements:
    """Elasto-plastic elements in parallel whose force falls with speed, unlike the catalogue's Maxwell slip."""

    slip: FloatArray
    share: FloatArray

    def force(self, x: FloatArray, start: FloatArray) -> FloatArray:
        """Return the force (N,) over its largest, relaxed wherever a segment starts; smooth (Dahl) elements."""
        out = np.zeros(len(x))
        for slip, share in zip(self.slip, self.share, strict=True):
            z, last = 0.0, x[0]
            for k, (now, first) in enumerate(zip(x.tolist(), start.tolist(), strict=True)):
                if first:
                    z, last = 0.0, now
                step = (now - last) / slip
                # Dahl: dz/dx = 1 - z sign(dx), exact over the step.
                z = np.sign(step) + (z - np.sign(step)) * np.exp(-abs(step)) if step else z
                last = now
                out[k] += share * z
        return out


def on(scene: Scene, joint: int, force: FloatArray) -> FloatArray:
    """Return a force (N, n) that acts on one joint."""
    everywhere = np.zeros_like(scene.q)
    everywhere[:, joint] = force
    return everywhere


def pieces(scene: Scene) -> list[IntArray]:
    """Return the rows of every segment."""
    return np.split(np.arange(len(scene.t)), np.flatnonzero(scene.start)[1:])


def sign(v: FloatArray, smooth: float = 2e-3) -> FloatArray:
    """Return the sign of a velocity, turning over ``smooth`` by another function than the catalogue's."""
    turned: FloatArray = v / np.sqrt(v**2 + smooth**2)
    return turned


@law("stribeck")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    speed = rng.uniform(0.025, 0.05)
    v = s.dq[:, j]
    # Hess and Soom's curve (1990) instead of an exponential; at this speed 1/e of it is left.
    return on(s, j, a * s.direction[:, j] / (1.0 + (np.e - 1.0) * (v / speed) ** 2)), {"force": a, "speed": speed}


@law("sigmoid")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    speed = rng.uniform(0.05, 0.15)
    v = s.dq[:, j]
    # Part of the dry friction turns slowly.
    return on(s, j, a * v / np.sqrt(v**2 + speed**2)), {"force": a, "speed": speed}


@law("viscous-nonlinear")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    thinning = rng.uniform(0.3, 0.8)
    v = s.dq[:, j]
    return on(s, j, -a * v * np.abs(v) / (thinning + np.abs(v))), {"force": a}


@law("coulomb-asymmetry")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    return on(s, j, a * np.abs(s.direction[:, j])), {"force": a}


@law("load-friction")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    load = np.sqrt(s.torque[:, j] ** 2 + (0.02 * np.abs(s.torque[:, j]).max()) ** 2)
    return on(s, j, a * s.direction[:, j] * load), {"force": a}


@law("position-friction")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    turns, phase = rng.choice([1.0, 2.0, 3.0]), rng.uniform(-3, 3)
    wave = np.cos(turns * s.q[:, j] + phase)
    return on(s, j, a * s.direction[:, j] * (wave + 0.15 * wave**2)), {"force": a}


@law("thermal-friction")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    seconds = rng.uniform(30.0, 90.0)
    own = s.coulomb[j] * s.direction[:, j] + s.viscous[j] * s.dq[:, j]
    power = np.abs(own * s.dq[:, j])
    dt = np.diff(s.t, prepend=s.t[0])
    heat = np.zeros(len(s.t))
    level, usual = 0.0, s.coulomb[j] + s.viscous[j]  # at 1 rad/s
    for k in range(len(s.t)):
        level += dt[k] / seconds * (power[k] / usual - level)
        heat[k] = level
    a = min(a, 0.7)  # friction is not turned round
    warm = float(power.mean()) / usual
    share = a * warm / (0.5 + 0.5 * warm)
    return on(s, j, -a * own * heat / (0.5 + 0.5 * heat)), {"share": share, "seconds": seconds}


@law("maxwell-slip")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    slip = rng.uniform(0.002, 0.01)
    elements = Elements(slip * np.array([0.5, 1.0, 2.0]), np.array([0.3, 0.4, 0.3]))
    return on(s, j, a * elements.force(s.q[:, j], s.start)), {"force": a, "slip": slip}


@law("cross-joint-hysteresis")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    source = int(rng.choice([k for k in range(s.q.shape[1]) if k != j]))
    slip = rng.uniform(0.01, 0.05)
    force = Elements(np.array([slip]), np.ones(1)).force(s.q[:, source], s.start)
    return on(s, j, a * force), {"force": a, "slip": slip}


@law("backlash")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    if rng.random() < 0.5:
        return _knocks(s, j, a, rng)
    # The link stays behind until the motor has crossed the gap; a share of its load is missing until then.
    gap = rng.uniform(5e-4, 3e-3)
    link, position = np.empty(len(s.q)), s.q[0, j]
    held = 0.5 * gap * np.sign(s.torque[:, j])
    for k, (now, first) in enumerate(zip(s.q[:, j].tolist(), s.start.tolist(), strict=True)):
        resting = abs(s.dq[k, j]) < 1e-3  # the load presses the link against one flank
        position = now - held[k] if first or resting else min(max(position, now - 0.5 * gap), now + 0.5 * gap)
        link[k] = position
    engaged = np.clip(10.0 * np.abs(s.q[:, j] - link) / (0.5 * gap) - 9.0, 0.0, 1.0)
    return on(s, j, -a * s.torque[:, j] * (1.0 - engaged)), {"gap": gap}


LEAST_PLAY, PLAY = 1e-4, 0.02
"""Play [rad] at least, below which it is the flanks' spring that shows, and at most, of a worn joint."""

RUBS = 0.01
"""Speed [rad/s] over which the direction of a link's friction turns."""

FINE = 2e-4
"""Step [s] at which the motion of a link in its play is integrated."""


def _knocks(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    """Play whose link flies through and knocks: flanks that stiffen and lose energy as Hunt and Crossley's (1975).

    Up to three tenths of the joint's dry friction brake the link, at its own speed.
    """
    gap, hertz, loss = float(np.clip(1e-3 * a, LEAST_PLAY, PLAY)), rng.uniform(12.0, 40.0), rng.uniform(0.5, 4.0)
    brake = rng.uniform(0.0, 0.3) * s.coulomb[j]
    inertia = s.body.mass_matrix(s.q, s.parameters)[:, :, j]
    usual = float(np.median(np.abs(s.torque[:, j])))
    # Under the usual load the flanks are as stiff as a spring of that frequency.
    stiff = float(np.mean(inertia[:, j])) * (2.0 * np.pi * hertz) ** 2
    force = np.zeros_like(s.q)
    for piece in pieces(s):
        t, load, motor, moved = s.t[piece], s.torque[piece, j], s.dq[piece, j], inertia[piece]
        braked = load + brake * 2.0 / np.pi * np.arctan(motor / RUBS)
        fine = np.arange(t[0], t[-1], FINE)
        known = CubicSpline(t, load)(fine), np.interp(fine, t, motor), np.interp(fine, t, moved[:, j])
        carried = _carried(*known, brake, 0.5 * gap, stiff, usual, loss)
        # Drives report the mean of a sampling period.
        edges = np.concatenate([[0], np.clip(np.round((t - t[0]) / FINE).astype(int), 1, len(fine))])
        sums = np.concatenate([[0.0], np.cumsum(carried)])
        mean = np.diff(sums[edges]) / np.maximum(np.diff(edges), 1)
        mean[0] = braked[0]
        force[piece] = moved / moved[:, j : j + 1] * (mean - braked)[:, None]
    return force, {"gap": gap}


@compiled
def _carried(
    load: FloatArray,
    motor: FloatArray,
    inertia: FloatArray,
    brake: float,
    half: float,
    stiff: float,
    usual: float,
    loss: float,
) -> FloatArray:
    """Torque through the flanks where a link flies between them."""
    out = np.empty(len(load))
    # A force of stiff wound at the usual load, and with the power of 3/2.
    hard = usual / max(usual / stiff, 1e-9) ** 1.5
    place, speed = (half + (abs(load[0]) / hard) ** (2.0 / 3.0)) * (1.0 if load[0] >= 0.0 else -1.0), 0.0
    for k in range(len(load)):
        side = 1.0 if place > 0.0 else -1.0
        wound = max(side * place - half, 0.0)
        out[k] = side * max(hard * wound**1.5 * (1.0 + loss * side * speed), 0.0)
        # Friction does not turn the link round within a step.
        rub = brake * 2.0 / np.pi * np.arctan((motor[k] - speed) / (RUBS + brake / inertia[k] * FINE))
        speed += (load[k] + rub - out[k]) / inertia[k] * FINE
        place += speed * FINE
    return out


@law("cross-joint-friction")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    source = int(rng.choice([k for k in range(s.q.shape[1]) if k != j]))
    ratio = rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.3)
    part = s.dq[:, j] + ratio * s.dq[:, source]
    return on(s, j, a * 2.0 / np.pi * np.arctan(part / 0.02)), {"force": a}


@law("elasticity")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    compliance = min(1e-4 * a, WINDS / (LARGE * s.coulomb[j]))
    wind = np.zeros_like(s.q)
    wind[:, j] = compliance * s.torque[:, j]
    speed, bend = np.gradient(wind, s.t, axis=0), np.gradient(np.gradient(wind, s.t, axis=0), s.t, axis=0)
    late = s.body.inverse_dynamics(s.q - wind, s.dq - speed, s.ddq - bend, s.parameters)
    return late - s.torque, {"stiffness": 1.0 / compliance}


@law("gear-ripple")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    turns, phase = float(rng.integers(6, 40)), rng.uniform(-3, 3)
    wave = np.sin(turns * s.q[:, j] + phase) + 0.15 * np.sin(2 * turns * s.q[:, j])
    return on(s, j, a * wave * (1.0 + 0.2 * np.abs(s.torque[:, j]) / np.abs(s.torque[:, j]).max())), {
        "force": a, "per_turn": turns,
    }  # fmt: skip


@law("cogging")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    turns, phase = 100.0 * rng.choice([4.0, 6.0]), rng.uniform(-3, 3)
    return on(s, j, a * np.sin(turns * s.q[:, j] + phase)), {"force": a, "per_turn": turns}


@law("torque-saturation")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    # The iron is the same in all logs: it saturates at a torque of the joint's, not of what a log happens to reach.
    known, knee = s.known[:, j], LARGE * s.coulomb[j]
    square = (known / knee) ** 2
    missing = 2.0 * a * square / (1.0 + square)
    return on(s, j, known * missing), {"share": float(missing.max() / (1.0 + missing.max()))}


@law("sensor-drift")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    # It slows down as the sensor warms up; the figure is the mean rate.
    length = float(s.t[-1])
    settled = (1.0 - np.exp(-0.7 * s.t / length)) / (1.0 - np.exp(-0.7))
    return on(s, j, a * length / 3600.0 * settled), {"per_hour": a}


@law("cable-spring")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    neutral, reach = rng.uniform(-0.4, 0.4), 1.5
    return on(s, j, a * reach * np.sinh((s.q[:, j] - neutral) / reach)), {"stiffness": a}


@law("gravity-balancer")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    x, lever = s.q[:, j] - rng.uniform(-0.5, 0.5), 0.6
    length = np.sqrt(1.0 + lever**2 - 2.0 * lever * np.cos(x))
    return on(s, j, -a * (length - 0.3) * lever * np.sin(x) / length), {}


@law("rotor-inertia")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    return on(s, j, a * s.ddq[:, j]), {"inertia": a}


@law("drive-gain")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    return on(s, j, a * s.known[:, j]), {"scale": 1.0 / (1.0 + a)}


@law("current-offset")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    return on(s, j, np.full(len(s.t), a)), {"offset": a}


@law("payload")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    com = np.array([0.02, -0.01, rng.uniform(0.04, 0.1)])
    inertia = 0.002 * np.eye(3) + com @ com * np.eye(3) - np.outer(com, com)
    body = np.array([1.0, *com, *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
    held = np.zeros(s.parameters.size)
    held[10 * int(s.body.multibody.tree.order[-1]) :][:10] = a * body
    return s.body.inverse_dynamics(s.q, s.dq, s.ddq, held), {"mass": a}


@law("base-tilt")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    roll, pitch = a * np.array([np.cos(1.1), np.sin(1.1)])
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    turn = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    gravity = np.asarray(s.body.multibody.gravity, dtype=float)
    moved = s.body.inverse_dynamics(s.q, s.dq, s.ddq, s.parameters, turn.T @ gravity)
    return moved - s.torque, {"roll": float(roll), "pitch": float(pitch)}


@law("delay")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    seconds = 1e-3 * a
    late = np.empty_like(s.known)
    for piece in pieces(s):
        t = s.t[piece]
        late[piece] = between(s, piece, np.maximum(t - seconds, t[0]))
    return late - s.known, {"seconds": seconds}


def between(s: Scene, piece: IntArray, then: FloatArray) -> FloatArray:
    """Return a segment's known force (M, n) at any instants (M,) of it: friction turns between samples, too."""
    t, turned = s.t[piece], sign(s.dq[piece])
    # Friction that builds up is no function of velocity, and has no steps.
    steps = np.all(s.direction[piece] == turned, axis=0)
    smooth: FloatArray = CubicSpline(t, s.known[piece] - s.coulomb * s.held[piece])(then)
    besides: FloatArray = interp1d(t, s.held[piece] - np.where(steps, turned, 0.0), axis=0)(then)  # what is held jumps
    besides += np.where(steps, sign(CubicSpline(t, s.dq[piece])(then)), 0.0)
    return smooth + s.coulomb * besides


@law("filter-lag")
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    hertz = 20.0 / a
    # The drive runs ten times as fast as the log, and its currents do not run straight in between.
    late = np.empty_like(s.known)
    for piece in pieces(s):
        t, count = s.t[piece], 10 * len(piece) - 9
        fine = between(s, piece, np.interp(np.arange(count) / 10.0, np.arange(len(piece)), t))
        pole = np.exp(-2.0 * np.pi * hertz * float(np.median(np.diff(t))) / 10.0)
        # It filters the mean of a period: the newest sample alone would come half a period early.
        taps = np.full(2, 0.5 * (1.0 - pole))
        late[piece] = lfilter(taps, [1.0, -pole], fine, axis=0, zi=0.5 * (1.0 + pole) * fine[:1])[0][::10]
    return late - s.known, {"hertz": hertz}
