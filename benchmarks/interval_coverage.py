"""How often the intervals of an identification hold the truth of the virtual VS060, whose drive gains are given.

Run ``python benchmarks/interval_coverage.py [--seeds 20] [--protocol sinusoid]``. Every seed is another excitation,
with other sensor noise and other friction left over from before. Compared with the truth are

* the base parameters of the links and the rotor inertias; where two of them act alike (a vertical first axis and its
  rotor) the one that stands for both is compared with their sum, as the columns of the regression say;
* friction at a speed: half the difference between the two directions, averaged over the rows of the log on which the
  joint runs at 30, 50 or 70 % of its fastest, by 5 % of it. The true law (elements that slip one by one, drawn to a
  Stribeck curve, thinning lubricant, dependence on load and position) is no sum of the catalogue's effects, so that
  single coefficients have no true value; the friction over given rows has one, with their loads and positions.

An interval's half-width is 1.96 standard deviations. Printed are the shares within one and within two half-widths.
"""

from __future__ import annotations

import argparse
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
from ident.effects.direction import VelocityEffect
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links, RotorInertia
from ident.fit import Fit
from ident.identification import Identification, identify
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


def friction_rows(motion: Motion, joint: int) -> list[tuple[BoolArray, BoolArray]]:
    """Rows on which a joint runs at each speed, forwards and backwards; speeds it does not hold both ways are left."""
    dq = motion.dq[:, joint] / np.max(np.abs(motion.dq[:, joint]))
    pairs = [(np.abs(dq - share) < 0.05, np.abs(dq + share) < 0.05) for share in SPEEDS]
    return [(plus, minus) for plus, minus in pairs if plus.sum() > 20 and minus.sum() > 20]


def odd(values: FloatArray, plus: BoolArray, minus: BoolArray) -> FloatArray:
    """Half the difference of the means over two sets of rows."""
    return np.asarray(0.5 * (values[plus].mean(axis=0) - values[minus].mean(axis=0)))


def friction_columns(found: Identification, context: Context, joint: int) -> FloatArray:
    """Derivative (N, p) of the model's friction at a joint by all linear parameters, then all shape parameters."""
    fit = found.fit
    columns, shape = np.zeros((len(context.motion), len(fit.covariance))), fit.design.count
    for k, term in enumerate(found.model.terms):
        effect, own = term.effect, fit.design.columns_of_term(k)
        if effect.joint == joint and isinstance(effect, VelocityEffect | MaxwellSlip):
            columns[:, own] = effect.columns(context, term.shape, effect.start())
            if effect.shapes:
                slope = effect.gradient(context, term.shape) @ term.coefficients
                columns[:, shape : shape + len(term.shape)] = slope.T
        shape += len(term.shape)
    return columns


def true_friction(virtual: VirtualRobot, motion: Motion, load: FloatArray, joint: int) -> FloatArray:
    """Friction (N,) of the true law at a joint that has slipped long enough for its elements to be on their curves."""
    law = virtual.laws.friction
    q, dq = motion.q[:, joint], motion.dq[:, joint]
    speed = np.abs(dq)[:, None]
    level = 1.0 + law.position[joint] * np.cos(q - law.phase[joint])
    level *= 1.0 + law.asymmetry[joint] * np.sign(dq)
    excess = (law.static - law.coulomb)[joint] * np.exp(-speed / law.stribeck[joint]) @ law.share[joint]
    viscous = law.viscous[joint] * dq / (1.0 + np.abs(dq) / law.thinning[joint])
    dry = level * (law.coulomb[joint] + excess) + law.load[joint] * np.abs(load[:, joint])
    return np.asarray(np.sign(dq) * dry + level * viscous)


def friction_deviations(found: Identification, virtual: VirtualRobot, log: JointLog) -> list[list[float]]:
    motion = derive(log, found.cutoff.hertz)
    load = virtual.rigid_torque(motion.q, motion.dq, motion.ddq)
    context = Context(found.model.robot, motion, found.model.load(motion))
    theta = found.fit.solution.parameters
    rows = []
    for joint in range(found.model.n):
        columns, truth = friction_columns(found, context, joint), true_friction(virtual, motion, load, joint)
        for plus, minus in friction_rows(motion, joint):
            slope, true = odd(columns, plus, minus), float(odd(truth, plus, minus))
            std = float(np.sqrt(slope @ found.fit.covariance @ slope))
            rows.append([float(slope[: len(theta)] @ theta) - true, std])
    return rows


def deviations(
    seed: int, scenario: str, protocol: str, series: dict[str, float], effects: list[str] | None
) -> dict[str, list[list[float]]]:
    """Error and standard deviation of everything that is compared, by kind, for one seed."""
    virtual = VirtualRobot(load_robot("vs060"), scenario)
    motion = named(protocol)(virtual.robot, seconds=SECONDS, seed=seed, **series)
    log = virtual.record(motion, seed)
    with tempfile.TemporaryDirectory() as folder:
        robot = with_gains(virtual.robot, virtual.laws.gain.tolist(), Path(folder))
    found = identify(robot, [log], effects=effects)
    chosen, truth = true_rigid(found.fit, virtual)
    std = np.sqrt(np.diag(found.fit.covariance))[: found.fit.design.count]
    rows = np.stack([found.fit.solution.parameters[chosen] - truth, std[chosen]], axis=1)
    rotors = np.concatenate(
        [
            found.fit.design.columns_of_term(k)
            for k, term in enumerate(found.model.terms)
            if isinstance(term.effect, RotorInertia)
        ]
    )
    rotor = np.isin(np.flatnonzero(chosen), rotors)
    friction = friction_deviations(found, virtual, log)
    return {"base parameters": rows[~rotor].tolist(), "rotor inertias": rows[rotor].tolist(), "friction": friction}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--scenario", default="vs060")
    parser.add_argument("--protocol", default="sinusoid")
    parser.add_argument("--base", type=float, help="base frequency of a Fourier series [Hz]")
    parser.add_argument("--harmonics", type=int, help="of a Fourier series")
    parser.add_argument("--effects", nargs="+", help="instead of those that predict held-out rows best")
    given = parser.parse_args()
    series = {key: value for key in ("base", "harmonics") if (value := getattr(given, key)) is not None}
    calls = (
        delayed(deviations)(seed, given.scenario, given.protocol, series, given.effects)
        for seed in range(1, given.seeds + 1)
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
