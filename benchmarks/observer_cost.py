"""Cost of the observers: a step against the Pinocchio calls it stands for, a log against stepping through filterpy.

Run ``python benchmarks/observer_cost.py`` (a minute). Everything is timed in one process on one core, in turn, the best
of several rounds; the ratios are what counts. The last table runs each observer's core over ten million samples.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.effects.base import Term
from ident.effects.friction import Coulomb, Viscous
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links
from ident.log import JointLog
from ident.model import CurrentModel
from ident.robot import Robot, load_robot
from observers.disturbance import DisturbanceObserver
from observers.filtered_dynamics import FilteredDynamicsObserver
from observers.kalman import KalmanObserver
from observers.model_based import ModelBasedObserver
from observers.momentum import MomentumObserver
from observers.noise import MomentumNoise
from observers.sliding_mode import SlidingModeObserver

FRAMES = 94_490
NAIVE_FRAMES = 2_000  # of the loop through filterpy, which is too slow for all
STEPS = 10_000_000
PENDULUM = """<robot name="pendulum"><link name="base"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="10" effort="100"/></joint>
<link name="l1"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
<inertia ixx="0.3" iyy="0.3" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def model_of(robot: Robot, friction: bool) -> CurrentModel:
    base = robot.rigid_body.base_parameters()
    terms = [Term(Links(None), coefficients=base.projection @ robot.multibody.parameters)]
    for j in range(robot.n if friction else 0):
        terms += [Term(kind(j), coefficients=np.ones(1)) for kind in (Coulomb, Viscous)]
        terms.append(Term(MaxwellSlip(j), np.array([1e-3]), np.full(3, 0.3)))
    return CurrentModel(robot, tuple(terms), 10.0, 100.0, np.ones(robot.n), "N m")


def makers(n: int) -> dict[str, Callable[[CurrentModel], ModelBasedObserver]]:
    noise = MomentumNoise(np.full(n, 0.3), np.full(n, 0.01))
    return {
        "gmo": MomentumObserver,
        "kalman": lambda m: KalmanObserver(m, noise),
        "disturbance": DisturbanceObserver,
        "sliding-mode": lambda m: SlidingModeObserver(m, 30.0),
        "filtered-dynamics": FilteredDynamicsObserver,
    }


def best(*calls: Callable[[], object], rounds: int = 5) -> list[float]:
    """Shortest time of each [s], all called once a round, so that whatever slows the machine slows them alike."""
    times = np.empty((rounds, len(calls)))
    for times_of_round in times:
        for k, call in enumerate(calls):
            start = time.perf_counter()
            call()
            times_of_round[k] = time.perf_counter() - start
    return [float(x) for x in times.min(axis=0)]


def swing(rows: int, n: int) -> JointLog:
    t = np.arange(rows) / 100.0
    q = 0.5 * np.sin(t[:, None] * np.linspace(0.5, 1.5, n))
    dq = np.gradient(q, t, axis=0)
    return JointLog(t=t, q=q, dq=dq, current=np.random.default_rng(0).standard_normal((rows, n)))


def stepping(observer: ModelBasedObserver, log: JointLog) -> Callable[[], object]:
    samples = list(log.samples())

    def all_steps() -> None:
        observer.reset()
        for sample in samples:
            observer.step(sample)

    all_steps()
    return all_steps


def steps(robot: Robot) -> None:
    rows = 2000
    log = swing(rows, robot.n)
    mechanism = robot.multibody
    model, data = mechanism.model, mechanism.data

    def bare() -> None:
        for q, dq in zip(log.q, log.dq, strict=True):  # type: ignore[arg-type]
            pin.crba(model, data, q)
            pin.computeCoriolisMatrix(model, data, q, dq)
            pin.computeGeneralizedGravity(model, data, q)

    def adapter() -> None:
        for q, dq in zip(log.q, log.dq, strict=True):  # type: ignore[arg-type]
            _ = mechanism.mass_matrix(q) @ dq, mechanism.coriolis_matrix(q, dq).T @ dq, mechanism.gravity_torque(q)

    cases = {
        "links, measured velocity": MomentumObserver(model_of(robot, False), filtered=False),
        "links, filtered": MomentumObserver(model_of(robot, False)),
        "links and 18 friction terms, measured velocity": MomentumObserver(model_of(robot, True), filtered=False),
        "links and 18 friction terms, filtered": MomentumObserver(model_of(robot, True)),
    }
    known, plain, *taken = best(bare, adapter, *(stepping(observer, log) for observer in cases.values()), rounds=25)
    print(f"bare calls crba, computeCoriolisMatrix, computeGeneralizedGravity: {1e6 * known / rows:.1f} us; ")
    print(f"M dq, C^T dq, g through ident.multibody: {plain / known:.1f} x that\n")
    print("| step of gmo | over the bare calls | over M dq, C^T dq, g |\n|---|---|---|")
    for name, own in zip(cases, taken, strict=True):
        print(f"| {name} | {own / known:.2f} | {own / plain:.2f} |")


def whole_log(robot: Robot) -> None:
    model, log = model_of(robot, True), swing(FRAMES, robot.n)
    naive = KalmanObserver(model, MomentumNoise(np.full(robot.n, 0.3), np.full(robot.n, 0.01)), gain="full")
    loop = best(stepping(naive, log[:NAIVE_FRAMES]), rounds=2)[0] * FRAMES / NAIVE_FRAMES
    print(f"\n{FRAMES} frames, links and 18 friction terms; the step loop through filterpy: {loop:.1f} s\n")
    print("| run of | times faster |\n|---|---|")
    for name, make in makers(robot.n).items():
        observer = make(model)
        observer.run(log[:1000])
        print(f"| {name} | {loop / best(partial(observer.run, log), rounds=2)[0]:.0f} |")


def long_run() -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "pendulum.urdf").write_text(PENDULUM)
        (Path(folder) / "robot.toml").write_text('name = "pendulum"\nurdf = "pendulum.urdf"\ncurrent_unit = "N*m"\n')
        robot = load_robot(folder)
        model = model_of(robot, False)
    period = 1000
    phase = 2.0 * np.pi * np.arange(period) / period
    rate = 2.0 * np.pi / (0.01 * period)
    q, dq, ddq = (x[:, None] for x in (np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase)))
    torque = robot.rigid_body.inverse_dynamics(q, dq, ddq, robot.multibody.parameters) - 0.5
    torque += 0.1 * np.random.default_rng(0).standard_normal(torque.shape)
    times = STEPS // period
    log = JointLog(t=np.arange(STEPS) / 100.0, q=np.tile(q, (times, 1)), current=np.tile(torque, (times, 1)))
    print(f"\n{STEPS} steps of a periodic motion, seventh period against the last\n")
    print("| observer | greatest difference [N m] | of residuals about [N m] |\n|---|---|---|")
    for name, make in makers(1).items():
        residual = make(model).run(log).current[:, 0]
        early, late = residual[6 * period : 7 * period], residual[-period:]
        print(f"| {name} | {np.abs(late - early).max():.1e} | {early.mean():.2f} |")


def main() -> None:
    robot = load_robot("vs060")
    steps(robot)
    whole_log(robot)
    long_run()


if __name__ == "__main__":
    main()
