"""How often the intervals of an identification hold the truth of the virtual VS060, whose drive gains are given.

Run ``python benchmarks/interval_coverage.py [--seeds 20] [--scenario vs060]``. Every seed is another excitation, with
other sensor noise and other friction left over from before. Compared with the truth are

* the base parameters of the links and the rotor inertias; where two of them act alike (a vertical first axis and its
  rotor) the one that stands for both is compared with their sum, as the columns of the regression say;
* friction at steady speed, half the difference between the directions, at 30, 50 and 70 % of each joint's fastest.
  The true law (elements that slip one by one, drawn to a Stribeck curve, thinning lubricant, load- and position-
  dependent) is no sum of the catalogue's effects, so that single coefficients have no true value; friction at a speed
  has one. Position dependence averages out over a turn, load dependence counts at the mean load of the log.

An interval's half-width is 1.96 standard deviations. Printed are the shares within one and within two half-widths.
"""

from __future__ import annotations

import argparse
import itertools
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from comparisons.protocols import named
from comparisons.virtual_robot import VirtualRobot
from ident.arrays import BoolArray, FloatArray
from ident.effects.base import Context
from ident.effects.friction import VelocityEffect
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links, RotorInertia
from ident.fit import Fit
from ident.identify import Identification, identify
from ident.log import JointLog
from ident.parameters import HALF_WIDTH
from ident.robot import Robot, load_robot
from ident.signals import Motion, derive

SPEEDS = (0.3, 0.5, 0.7)
SECONDS = 60.0
TARGET = 0.93


def with_gains(robot: Robot, gain: Sequence[float], folder: Path) -> Robot:
    """Return the robot with its drive gains in the card."""
    card = f'name = "{robot.name}"\nurdf = "{robot.urdf}"\njoints = {json.dumps(list(robot.joints))}\n'
    card += f'current_unit = "{robot.unit}"\n[drive]\ngain = {list(gain)}\n'
    (folder / "robot.toml").write_text(card)
    return load_robot(folder / "robot.toml")


def true_rigid(fit: Fit, virtual: VirtualRobot) -> tuple[BoolArray, FloatArray]:
    """Which linear parameters are links and rotors that the data determine, (p,), and the truth of those."""
    design = fit.design
    truth, rigid = np.zeros(design.count), np.zeros(design.count, dtype=bool)
    for k, term in enumerate(design.terms):
        columns = design.columns_of_term(k)
        if isinstance(term.effect, Links):
            truth[columns] = term.effect.base(design.robot).projection @ virtual.laws.link_parameters
        elif isinstance(term.effect, RotorInertia):
            truth[columns] = virtual.laws.rotor_inertia[term.effect.at]
        else:
            continue
        rigid[columns] = True
    rows = []
    for j, upper in enumerate(fit.factors.triangles):
        rows.append(np.zeros((len(upper), design.count)))
        rows[-1][:, design.columns_of_joint(j)] = upper[:, :-1]
    matrix, kept = np.vstack(rows), fit.solution.determined
    scale = np.linalg.norm(matrix[:, kept], axis=0)
    regrouped = np.zeros(design.count)
    regrouped[kept] = np.linalg.lstsq(matrix[:, kept] / scale, matrix @ truth)[0] / scale
    return rigid & kept, regrouped[rigid & kept]


def friction_at(found: Identification, joint: int, speed: float, load: float) -> tuple[float, float]:
    """Friction of the model at a steady speed, half the difference of the directions, and its standard deviation."""
    fit, n = found.fit, found.model.n
    dq = np.zeros((2, n))
    dq[:, joint] = speed, -speed
    still = np.zeros((2, n))
    context = Context(found.model.robot, Motion(np.arange(2.0), still, dq, still), np.full((2, n), load))
    slope, value, shape = np.zeros(len(fit.covariance)), 0.0, fit.design.count
    for k, term in enumerate(found.model.terms):
        effect, own = term.effect, fit.design.columns_of_term(k)
        if effect.joint == joint and isinstance(effect, MaxwellSlip):
            slope[own] = 1.0  # every element slips
        elif effect.joint == joint and isinstance(effect, VelocityEffect):
            columns = effect.columns(context, term.shape, effect.start())
            slope[own] = 0.5 * (columns[0] - columns[1])
            if effect.shapes:
                sides = effect.gradient(context, term.shape) @ term.coefficients
                slope[shape : shape + len(term.shape)] = 0.5 * (sides[:, 0] - sides[:, 1])
        value += float(slope[own] @ term.coefficients) if effect.joint == joint else 0.0
        shape += len(term.shape)
    return value, float(np.sqrt(slope @ fit.covariance @ slope))


def true_friction(virtual: VirtualRobot, joint: int, speed: float, load: float) -> float:
    law = virtual.laws.friction
    excess = (law.static - law.coulomb)[joint] * law.share[joint] @ np.exp(-speed / law.stribeck[joint])
    viscous = law.viscous[joint] * speed / (1.0 + speed / law.thinning[joint])
    return float(law.coulomb[joint] + law.load[joint] * load + excess + viscous)


def deviations(seed: int, scenario: str, protocol: str, effects: list[str] | None) -> dict[str, list[list[float]]]:
    """Error, standard deviation and truth of everything that is compared, by kind, for one seed."""
    virtual = VirtualRobot(load_robot("vs060"), scenario)
    motion = named(protocol)(virtual.robot, seconds=SECONDS, seed=seed)
    log = virtual.record(motion, seed)
    with tempfile.TemporaryDirectory() as folder:
        robot = with_gains(virtual.robot, virtual.laws.gain.tolist(), Path(folder))
    found = identify(robot, [log], effects=effects)
    chosen, truth = true_rigid(found.fit, virtual)
    std = np.sqrt(np.diag(found.fit.covariance))[: found.fit.design.count]
    rows = np.stack([found.fit.solution.parameters[chosen] - truth, std[chosen], truth], axis=1)
    rotors = np.concatenate(
        [
            found.fit.design.columns_of_term(k)
            for k, term in enumerate(found.model.terms)
            if isinstance(term.effect, RotorInertia)
        ]
    )
    rotor = np.isin(np.flatnonzero(chosen), rotors)
    friction = [friction_row(found, virtual, log, j, share) for j, share in itertools.product(range(robot.n), SPEEDS)]
    return {"base parameters": rows[~rotor].tolist(), "rotor inertias": rows[rotor].tolist(), "friction": friction}


def friction_row(found: Identification, virtual: VirtualRobot, log: JointLog, joint: int, share: float) -> list[float]:
    motion = derive(log, found.cutoff.hertz)
    torque = virtual.rigid_torque(motion.q, motion.dq, motion.ddq)
    speed, load = share * float(np.max(np.abs(motion.dq[:, joint]))), float(np.mean(np.abs(torque[:, joint])))
    truth = true_friction(virtual, joint, speed, load)
    value, std = friction_at(found, joint, speed, load)
    return [value - truth, std, truth]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--scenario", default="vs060")
    parser.add_argument("--protocol", default="fourier")
    parser.add_argument("--effects", nargs="+", help="instead of those that predict held-out rows best")
    given = parser.parse_args()
    calls = (
        delayed(deviations)(seed, given.scenario, given.protocol, given.effects) for seed in range(1, given.seeds + 1)
    )
    found = Parallel(n_jobs=2)(calls)
    print(f"{'':<18}{'compared':>9}{'in 1 half-width':>17}{'in 2 half-widths':>18}{'|error|/std':>13}")
    shares = {}
    for kind in [*found[0], "all"]:
        rows = np.array([row for one in found for name in ([kind] if kind != "all" else one) for row in one[name]])
        ratio = np.abs(rows[:, 0]) / rows[:, 1]
        inside = [float(np.mean(ratio <= k * HALF_WIDTH)) for k in (1, 2)]
        shares[kind] = inside[1]
        print(f"{kind:<18}{len(rows):>9}{100 * inside[0]:>15.1f} %{100 * inside[1]:>16.1f} %{np.median(ratio):>13.2f}")
    print(json.dumps({"seeds": given.seeds, "scenario": given.scenario, "within_two_half_widths": shares}))


if __name__ == "__main__":
    main()
