"""Identifying millions of frames in bounded memory, beside a plain loop of Pinocchio's regressor and one dense QR.

Run ``python benchmarks/streaming.py [--frames 3100000]``. Logs of the built-in arm are written as Parquet by a process
of their own (rigid body, friction, noise; 1000 s a segment at 100 Hz), then identified by ``ident.fit`` from the file,
a growing part of it each time: the peak of the resident memory, the time of each size, and how it grows with frames.
The plain loop builds the same columns row by row, holds them all and factorises them once, in the same process.
"""

from __future__ import annotations

import argparse
import itertools
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pinocchio
from threadpoolctl import threadpool_limits

from ident.arrays import FloatArray
from ident.effects.base import Effect
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import Links, RotorInertia
from ident.fit import Drives, Fit, fit
from ident.log import JointLog
from ident.log_writer import LogWriter
from ident.readers import open_log
from ident.robot import Robot, load_robot
from ident.signals import derive

FRAMES, SHARES = 3_100_000, (0.125, 0.25, 0.5, 1.0)
LOOP_FRAMES = 50_000
SEGMENT, RATE, CUTOFF, SMOOTHING = 100_000, 100.0, 5.0, 5e-3
GAIN = np.array([0.71, 0.81, 0.403, 0.112, 0.144, 0.076])


def segment(robot: Robot, number: int, rows: int) -> JointLog:
    """Return one segment: six sinusoids a joint, rigid body, Coulomb and viscous friction, noise."""
    rng = np.random.default_rng(number)
    t = np.arange(rows) / RATE
    rates = 2 * np.pi * rng.uniform(0.05, 0.4, (6, robot.n))
    phases = rng.uniform(0, 2 * np.pi, (6, robot.n))
    q, dq, ddq = (
        sum(0.25 * w**k * np.sin(w * t[:, None] + p + 0.5 * k * np.pi) for w, p in zip(rates, phases, strict=True))
        for k in range(3)
    )
    torque = robot.rigid_body.inverse_dynamics(q, dq, ddq, robot.multibody.parameters) + 0.1 * ddq
    current = torque / GAIN + 8.0 * np.tanh(dq / SMOOTHING) + 5.0 * dq + rng.normal(size=q.shape)
    return JointLog(t, q + 1e-6 * rng.normal(size=q.shape), current, segment=np.full(rows, number))


def write(path: Path, frames: int) -> None:
    robot = load_robot("vs060")
    with LogWriter(path) as writer:
        for number, start in enumerate(range(0, frames, SEGMENT)):
            writer.write(segment(robot, number, min(SEGMENT, frames - start)))


class Head:
    """The first frames of a log source, read block by block."""

    def __init__(self, path: Path, robot: Robot, frames: int) -> None:
        self.source, self.frames, self.name = open_log(path, robot), frames, path.stem

    def blocks(self, rows: int) -> Iterator[JointLog]:
        """Yield blocks of the log until the frames are used up."""
        left = self.frames
        for block in self.source.blocks(rows):
            yield block[:left]
            left -= len(block)
            if left <= 0:
                return

    def read(self) -> JointLog:
        """Refuse: what is measured is that this is never needed."""
        raise NotImplementedError("a stream is never held whole")


def effects(n: int) -> list[Effect]:
    own = [[CurrentOffset(j), RotorInertia(j), Coulomb(j, SMOOTHING), Viscous(j, SMOOTHING)] for j in range(n)]
    return [Links(None), *itertools.chain(*own)]


def streamed(path: Path, robot: Robot, frames: int) -> tuple[Fit, float, float]:
    """Fit the first frames of a log; return the fit and the seconds it took, of the clock and of all cores."""
    clock, cores = time.perf_counter(), time.process_time()
    found = fit(robot, effects(robot.n), [Head(path, robot, frames)], CUTOFF, Drives(GAIN, "N m"))
    return found, time.perf_counter() - clock, time.process_time() - cores


def plain_loop(log: JointLog, robot: Robot) -> tuple[FloatArray, float, float]:
    """Identify as a short script would, a Pinocchio call a row and one dense QR of all rows, and predict them."""
    clock, cores = time.perf_counter(), time.process_time()
    motion, model = derive(log, CUTOFF), robot.multibody.model
    data, n = model.createData(), robot.n
    base = robot.rigid_body.base_parameters().columns
    own = 4 * n
    matrix = np.zeros((len(log) * n, len(base) + own))
    # The built-in arm's card order is its model's, and so is that of their inertial parameters.
    for k in range(len(log)):
        rows = slice(k * n, (k + 1) * n)
        q, dq, ddq = motion.q[k], motion.dq[k], motion.ddq[k]
        matrix[rows, : len(base)] = pinocchio.computeJointTorqueRegressor(model, data, q, dq, ddq)[:, base]
        for j, row in enumerate((np.ones(n), ddq, np.tanh(dq / SMOOTHING), dq)):
            matrix[rows, len(base) + j * n : len(base) + (j + 1) * n] = np.diag(row)
    factor, upper = np.linalg.qr(matrix)
    # Joint 1 is vertical: its rotor acts as its link does, so the triangle is singular.
    solved = np.linalg.lstsq(upper, factor.T @ (log.current * GAIN).ravel())[0]
    clock, cores = time.perf_counter() - clock, time.process_time() - cores
    return (matrix @ solved).reshape(log.q.shape) / GAIN, clock, cores


def peak() -> float:
    """Peak of the resident memory of this process so far [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--write", type=Path, help="only write the log here")
    parser.add_argument("--log", type=Path, help="a log that --write wrote")
    given = parser.parse_args(arguments)
    if given.write is not None:
        write(given.write, given.frames)
        return
    robot = load_robot("vs060")
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1, "blas"):
        path = given.log or Path(folder) / "frames.parquet"
        if given.log is None:
            call = [sys.executable, __file__, "--write", str(path), "--frames", str(given.frames)]
            subprocess.run(call, check=True)
        streamed(path, robot, 5000)  # compiles
        sizes = [round(share * given.frames) for share in SHARES]
        loop_frames = min(LOOP_FRAMES, given.frames)
        clock: dict[int, float] = {}
        cores: dict[int, float] = {}
        print(f"{'frames':>9}{'clock [s]':>11}{'cores [s]':>11}{'us a frame':>12}{'peak [GB]':>11}")
        for frames in sizes:
            _, clock[frames], cores[frames] = streamed(path, robot, frames)
            each = 1e6 * clock[frames] / frames
            print(f"{frames:>9}{clock[frames]:>11.1f}{cores[frames]:>11.1f}{each:>12.1f}{peak():>11.2f}", flush=True)
        figures = {"peak_gb": peak(), "seconds": clock[sizes[-1]]}
        found, streamed_clock, streamed_cores = streamed(path, robot, loop_frames)
        log = next(Head(path, robot, loop_frames).blocks(loop_frames))
        predicted, loop_clock, loop_cores = plain_loop(log, robot)
    half, full = sizes[-2:]
    residual = np.sqrt(np.mean((log.current - predicted) ** 2))
    figures |= {
        "exponent_of_time_in_frames": float(np.log(cores[full] / cores[half]) / np.log(full / half)),
        "loop_frames": loop_frames,
        "loop_over_streaming": loop_clock / streamed_clock,
        "loop_over_streaming_on_cores": loop_cores / streamed_cores,
        "loop_over_streaming_a_frame": loop_clock / loop_frames * full / clock[full],
        "difference_of_predictions_over_residual": float(
            np.sqrt(np.mean((found.model.predict(log) - predicted) ** 2)) / residual
        ),
    }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
