"""A trained model's folder: ``model.json`` for people, ``weights.npz`` for the numbers; nothing in it can run code."""

from __future__ import annotations

import json
import platform
import zipfile
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, FloatArray
from ident.errors import InputError
from learned.motion_discriminator import DiscriminatorSpec
from learned.networks import Architecture
from learned.window import Float32Array, Scaling

FORMAT = 1
MODEL, WEIGHTS, PHYSICS = "model.json", "weights.npz", "physics"


@dataclass(frozen=True, eq=False)
class TrainedModel:
    """Everything a trained network needs to predict again, on the robot it was trained for and no other.

    Attributes:
        robot, joints, unit: name of the robot, its joints in the order of a log's columns, unit of the current.
        rate: sampling rate [Hz] that windows and thresholds belong to.
        cutoff: of the causal low pass on the motion [Hz].
        architecture: sizes of the network.
        discriminator: what it remembers of motion long past.
        frame_scaling: of q, dq, ddq, (3n,).
        held_scaling: of the discriminator values, threshold by threshold, (I n,).
        output_gain: unit of the current per unit of each hierarchy's output, (H, n).
        output_offset: current added to the sum of all hierarchies, (n,).
        weights: of all hierarchies one after another, float32.
        training: what a person wants to know of how it came about: seed, losses, frames, validation figures.
        versions: of Python and the packages it was trained with.
    """

    robot: str
    joints: tuple[str, ...]
    unit: str
    rate: float
    cutoff: float
    architecture: Architecture
    discriminator: DiscriminatorSpec
    frame_scaling: Scaling
    held_scaling: Scaling
    output_gain: FloatArray
    output_offset: FloatArray
    weights: Float32Array
    training: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=lambda: installed_versions())

    def save(self, folder: Path) -> None:
        """Write the model into ``folder``."""
        folder.mkdir(parents=True, exist_ok=True)
        text = {
            "format": FORMAT,
            "kind": "learned",
            "robot": self.robot,
            "joints": list(self.joints),
            "unit": self.unit,
            "rate": self.rate,
            "cutoff": self.cutoff,
            "architecture": asdict(self.architecture),
            "discriminator": asdict(self.discriminator),
            "training": self.training,
            "versions": self.versions,
        }
        with (folder / WEIGHTS).open("wb") as file:
            np.savez(file, **self._arrays())  # type: ignore[arg-type]
        (folder / MODEL).write_text(json.dumps(text, indent=2) + "\n", encoding="utf-8")

    @staticmethod
    def load(folder: Path) -> TrainedModel:
        """Read a model from ``folder``; InputError where it is none, broken or of a later format."""
        try:
            text = json.loads((folder / MODEL).read_text(encoding="utf-8"))
            with np.load(folder / WEIGHTS, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            if text["format"] > FORMAT:
                how = "update sensorless, or train the model again"
                raise InputError(f"model format {text['format']} is newer than this version reads", str(folder), how)
            return _assemble(text, arrays)
        except FileNotFoundError as error:
            what = f"no trained model: {Path(str(error.filename)).name} is missing"
            raise InputError(what, str(folder), "give the output folder of `sensorless train`") from error
        except (KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
            what = f"broken trained model ({type(error).__name__}: {error})"
            raise InputError(what, str(folder), "train it again") from error

    def _arrays(self) -> dict[str, Array]:
        return {
            "frame_mean": self.frame_scaling.mean,
            "frame_gain": self.frame_scaling.gain,
            "held_mean": self.held_scaling.mean,
            "held_gain": self.held_scaling.gain,
            "output_gain": self.output_gain,
            "output_offset": self.output_offset,
            "weights": self.weights,
        }


def is_trained_model(folder: Path) -> bool:
    """Tell whether a folder holds the output of training rather than of identification.

    Args:
        folder: that a command wrote.
    """
    return (folder / WEIGHTS).is_file()


def installed_versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    found = {"python": platform.python_version()}
    for package in ("sensorless", "numpy", "numba", "torch"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _assemble(text: dict[str, Any], arrays: dict[str, Array]) -> TrainedModel:
    shape, spec = dict(text["architecture"]), dict(text["discriminator"])
    shape["groups"] = tuple((first, last) for first, last in shape["groups"])
    spec["thresholds"] = tuple(tuple(t) if isinstance(t, list) else t for t in spec["thresholds"])
    architecture, discriminator = Architecture(**shape), DiscriminatorSpec(**spec)
    n = architecture.n
    frame, held = architecture.frame, discriminator.rows(n) * architecture.frame // 3
    wanted = {"frame_mean": frame, "frame_gain": frame, "held_mean": held, "held_gain": held, "output_offset": n}
    for name, size in wanted.items():
        if arrays[name].shape != (size,):
            raise ValueError(f"{name} has shape {arrays[name].shape} where ({size},) belongs")
    return TrainedModel(
        robot=text["robot"],
        joints=tuple(text["joints"]),
        unit=text["unit"],
        rate=float(text["rate"]),
        cutoff=float(text["cutoff"]),
        architecture=architecture,
        discriminator=discriminator,
        frame_scaling=Scaling(arrays["frame_mean"], arrays["frame_gain"]),
        held_scaling=Scaling(arrays["held_mean"], arrays["held_gain"]),
        output_gain=arrays["output_gain"],
        output_offset=arrays["output_offset"],
        weights=arrays["weights"],
        training=text["training"],
        versions=text["versions"],
    )
