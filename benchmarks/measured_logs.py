"""Identify the measured logs beside the project: errors on held-out data, with and without the chosen friction terms.

Run ``python benchmarks/measured_logs.py [emps ur10 ur3 lwr4 panda]``; prints a Markdown table.
"""

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio

from comparisons.predictions import errors_on
from ident.identification import Identification, identify
from ident.log import JointLog, LogSource
from ident.readers import open_log
from ident.robot import Robot, load_robot

DATA = Path(__file__).parents[2] / "shared" / "data"
URDFS = Path(pinocchio.__file__).parents[4] / "share" / "example-robot-data" / "robots"
TRAIN_SHARE = 0.7
"""Where one recording is all there is, its first part trains and the rest tests."""

EMPS_URDF = """<robot name="emps"><link name="rail"/><link name="carriage"><inertial><mass value="95"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-0.5" upper="0.5" velocity="1" effort="500"/></joint></robot>"""


@dataclass(frozen=True)
class Case:
    """A robot with logs to learn from and logs to be judged by."""

    name: str
    robot: Robot
    train: list[LogSource]
    test: list[LogSource]


def card(folder: Path, name: str, urdf: str | Path, rest: str) -> Robot:
    path = folder / f"{name}.toml"
    path.write_text(f'name = "{name}"\nurdf = "{urdf}"\n{rest}')
    return load_robot(path)


def split(log: JointLog) -> tuple[list[LogSource], list[LogSource]]:
    border = int(TRAIN_SHARE * len(log))
    return [log[:border]], [log[border:]]


def cases(folder: Path) -> Iterator[Case]:
    (folder / "emps.urdf").write_text(EMPS_URDF)
    mapping = '[log]\ntime = "t"\nposition = ["qm"]\ncurrent = ["vir"]\nscale = { current = 35.150651188248105 }\n'
    robot = card(folder, "emps", "emps.urdf", f'current_unit = "N"\n{mapping}')
    free, pulses = (open_log(DATA / f"emps/DATA_EMPS{k}.mat", robot) for k in ("", "_PULSES"))
    yield Case("emps", robot, [free], [free])
    # The motor itself gives the pulses, so they are part of what the model has to predict.
    yield Case("emps-pulses", robot, [free], [pulses])

    robot = card(folder, "ur10", URDFS / "ur_description/urdf/ur10_robot.urdf", 'current_unit = "N*m"\n')
    yield Case("ur10", robot, *split(open_log(DATA / "ur10_unisa/ur10_exciting_trajectory.db3", robot).read()))

    mapping = '[log]\ntime = "mt"\nposition = "mq"\ncurrent = "mtorque"\nscale = { current = -1.0 }\n'
    robot = card(folder, "ur3", URDFS / "ur_description/urdf/ur3_robot.urdf", f'current_unit = "N*m"\n{mapping}')
    yield Case("ur3", robot, *([open_log(DATA / f"ur3_aspectum/id{k}.mat", robot)] for k in (1, 2)))

    mapping = '[log]\ntime = "times"\nposition = "positions"\ncurrent = "torques"\n'
    urdf = DATA / "kuka_lwr4_flobaroid/kuka_lwr4.urdf"
    robot = card(folder, "lwr4", urdf, f'current_unit = "N*m"\n{mapping}')
    one, two, three = (open_log(DATA / f"kuka_lwr4_flobaroid/measurements_{k}.npz", robot) for k in (1, 2, 3))
    yield Case("lwr4", robot, [one, three], [two])

    joints = [f"panda_joint{k}" for k in range(1, 8)]
    robot = card(
        folder, "panda", URDFS / "panda_description/urdf/panda.urdf", f'current_unit = "N*m"\njoints = {joints}\n'
    )
    yield Case("panda", robot, *split(panda_log()))


def panda_log() -> JointLog:
    """The flat text files as a log; the logged velocity lags, so it is left out."""
    stem = DATA / "panda_inria/exciting_traj_"
    t = np.loadtxt(f"{stem}time.txt").ravel()
    q, tau = (np.loadtxt(f"{stem}{what}.txt").reshape(-1, 7) for what in ("positions", "torques"))
    return JointLog(t - t[0], q, tau, name="panda_inria")


def row(case: Case, kind: str, found: Identification) -> str:
    figures = errors_on(found.model, case.test, False, found.cutoff.hertz).as_dict()
    per_joint = " ".join(f"{x:.3g}" for x in figures["rmse_filtered"])
    raw, filtered = (figures[f"relative_error_percent{key}_overall"] for key in ("", "_filtered"))
    return f"| {case.name} | {kind} | {found.cutoff.hertz:.3g} | {raw:.2f} | {filtered:.2f} | {per_joint} |"


def main() -> None:
    wanted = sys.argv[1:]
    print("| log | friction | cut-off [Hz] | error, raw [%] | error below the cut-off [%] | RMSE below it, by joint |")
    print("|---|---|---|---|---|---|", flush=True)
    details = []
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(Path(folder)):
            if wanted and case.name not in wanted:
                continue
            plain = identify(case.robot, case.train, effects=["coulomb", "viscous"])
            print(row(case, "Coulomb, viscous", plain))
            chosen = identify(case.robot, case.train)
            print(row(case, "chosen", chosen), flush=True)
            usual = ("links", "rotor-inertia", "current-offset", "coulomb", "viscous")
            for j in range(case.robot.n):
                extra = [
                    t.effect.name for t in chosen.model.terms if t.effect.joint == j and t.effect.name not in usual
                ]
                details.append(f"| {case.name} | {j + 1} | {', '.join(extra)} |")
            if case.name == "emps":
                values = ", ".join(f"{p.name} {p.value:.4f} ± {1.96 * p.std:.4f} {p.unit}" for p in plain.parameters)
                print(f"\nEMPS, Coulomb and viscous: {values}\n")
    print("\n| log | joint | terms besides Coulomb and viscous |\n|---|---|---|")
    print("\n".join(details))


if __name__ == "__main__":
    main()
