"""Training frames: compact float32 arrays, in memory or mapped from files, from which windows are read on the fly.

A frame is stored once, not M times, and its discriminator once; a batch is gathered from a strided view. With a folder
the arrays are files, so logs may be larger than memory: one log at a time is read whole.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.errors import InputError
from ident.log import JointLog, LogSource
from ident.predictor import CurrentPredictor
from learned.motion_discriminator import DiscriminatorSpec, MotionDiscriminator, known_history
from learned.window import Float32Array, Moments, Scaling, complete, frames_of, pad

BLOCK = 1 << 16
"""Rows scaled at a time."""


@dataclass(frozen=True)
class FrameSpec:
    """How frames are made of logs: joints, rate [Hz], cutoff [Hz], frames M, and the discriminator."""

    n: int
    rate: float
    cutoff: float
    memory: int
    discriminator: DiscriminatorSpec
    unknown_history_weight: float
    zero_start_every: float | None
    seed: int


@dataclass(frozen=True, eq=False)
class Dataset:
    """Frames ready for training; segments lie one after another, each behind M - 1 copies of its first frame.

    Attributes:
        frames: scaled q, dq, ddq (P, 3n).
        held: scaled discriminator (P, I n).
        target: current to learn, in its own unit (P, n).
        weight: weight of each target in the loss, zero where there is none (P, n).
        rows: rows that have a target, (K,).
    """

    frames: Float32Array
    held: Float32Array
    target: Float32Array
    weight: Float32Array
    rows: IntArray


class _Store:
    """Arrays that grow row by row, in memory or as files of a folder."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._parts: dict[str, list[Float32Array]] = {}
        self._columns: dict[str, int] = {}
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            for old in folder.glob("*.f32"):
                old.unlink()

    def append(self, name: str, rows: FloatArray | Float32Array) -> None:
        values = np.ascontiguousarray(rows, dtype=np.float32)
        self._columns[name] = values.shape[1]
        if self._folder is None:
            self._parts.setdefault(name, []).append(values)
            return
        with (self._folder / f"{name}.f32").open("ab") as file:
            values.tofile(file)

    def array(self, name: str) -> Float32Array:
        columns = self._columns[name]
        if self._folder is None:
            return np.concatenate(self._parts.pop(name))
        path = self._folder / f"{name}.f32"
        if columns == 0:
            return np.zeros((0, 0), dtype=np.float32)
        return np.memmap(path, dtype=np.float32, mode="r+").reshape(-1, columns)


def build(
    logs: Sequence[LogSource],
    spec: FrameSpec,
    physics: CurrentPredictor | None = None,
    scalings: tuple[Scaling, Scaling] | None = None,
    folder: Path | None = None,
) -> tuple[Dataset, tuple[Scaling, Scaling]]:
    """Make a data set of logs.

    Args:
        logs: logs of one robot.
        spec: how frames are made.
        physics: predictor whose residual is to be learned; None learns the current itself.
        scalings: of frames and discriminator; None finds them in these logs.
        folder: where to keep the arrays as files; None keeps them in memory.

    Returns:
        the data set, and the scalings used.

    Raises:
        InputError: a log has other joints or does not fit the rate, or no row of any log can be used.
    """
    store = _Store(folder)
    moments = Moments(3 * spec.n), Moments(spec.discriminator.rows(spec.n) * spec.n)
    rows: list[IntArray] = []
    first = 0
    for number, source in enumerate(logs):
        log = source.read()
        if log.n != spec.n:
            raise InputError(
                f"{log.n} joints where the robot has {spec.n}", f"log {log.name}", "give logs of one robot"
            )
        arrays, usable = _of_log(log, spec, physics, number)
        for name, values in arrays.items():
            store.append(name, values)
        moments[0].add(arrays["frames"][usable])
        moments[1].add(arrays["held"][usable])
        rows.append(usable + first)
        first += len(arrays["frames"])
    used = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
    if len(used) == 0:
        raise InputError("no row can be used", "training logs", "give logs with positions and currents")
    scaled = scalings or (moments[0].scaling(), moments[1].scaling())
    frames, held = (_scale(store.array(name), s) for name, s in zip(("frames", "held"), scaled, strict=True))
    return Dataset(frames, held, store.array("target"), store.array("weight"), used), scaled


def blocks(rows: int) -> Iterator[slice]:
    """Slices of at most ``BLOCK`` rows."""
    for start in range(0, rows, BLOCK):
        yield slice(start, min(start + BLOCK, rows))


def _of_log(
    log: JointLog, spec: FrameSpec, physics: CurrentPredictor | None, number: int
) -> tuple[dict[str, FloatArray], IntArray]:
    """Frames, discriminator, target and weight of one log, padded; and the padded rows that have a target."""
    frames = frames_of(log, spec.rate, spec.cutoff)
    q, dq = frames.motion.q, frames.motion.dq
    starts = _zero_starts(frames.segments, spec, number)
    held = MotionDiscriminator(spec.discriminator, spec.n).run(q, dq, starts).reshape(len(q), -1)
    target = log.current[frames.rows]
    if physics is not None:
        target = target - physics.predict(log, causal=True)[frames.rows]
    usable = complete(frames.finite, frames.segments, spec.memory) & np.isfinite(target).all(axis=1)
    weight = np.where(known_history(q, starts), 1.0, spec.unknown_history_weight) * usable[:, None]
    channels, place = pad(frames.channels, frames.segments, frames.finite, spec.memory)
    arrays = {"frames": np.nan_to_num(channels)}
    for name, values in {"held": held, "target": target, "weight": weight}.items():
        spread = np.zeros((len(channels), values.shape[1]))
        spread[place] = np.nan_to_num(values)
        arrays[name] = spread
    return arrays, place[usable]


def _zero_starts(segments: list[slice], spec: FrameSpec, number: int) -> list[slice]:
    """Segments, broken further at random moments so that the network also learns to know nothing of the past."""
    if spec.zero_start_every is None:
        return segments
    rng = np.random.default_rng([spec.seed, number])
    pieces = []
    for rows in segments:
        length = rows.stop - rows.start
        cuts = rng.random(length) < 1.0 / max(spec.zero_start_every * spec.rate, 1.0)
        edges = [rows.start, *(rows.start + 1 + np.flatnonzero(cuts[1:])).tolist(), rows.stop]
        pieces += [slice(a, b) for a, b in itertools.pairwise(edges) if b > a]
    return pieces


def _scale(values: Float32Array, scaling: Scaling) -> Float32Array:
    """Scale an array in place, block by block."""
    if values.size:
        for part in blocks(len(values)):
            values[part] = scaling.apply(values[part].astype(np.float64))
    return values
