"""Networks that predict motor current, with memory of motion.

The names below are imported when they are first used, so that importing the package costs nothing.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# Threads that spin for one another make a step of a small network many times slower beside other work. It is read when
# Torch is first imported, so it stands here; what the user says goes first.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

if TYPE_CHECKING:
    from learned.adaptation import adapt_payload as adapt_payload
    from learned.motion_discriminator import DiscriminatorSpec as DiscriminatorSpec
    from learned.motion_discriminator import MotionDiscriminator as MotionDiscriminator
    from learned.onnx_export import export as export
    from learned.options import TrainingOptions as TrainingOptions
    from learned.predictor import LearnedModel as LearnedModel
    from learned.training import train as train
    from learned.wrench import WrenchModel as WrenchModel
    from learned.wrench import train_wrench as train_wrench

_HOME = {
    "DiscriminatorSpec": "learned.motion_discriminator",
    "LearnedModel": "learned.predictor",
    "MotionDiscriminator": "learned.motion_discriminator",
    "TrainingOptions": "learned.options",
    "WrenchModel": "learned.wrench",
    "adapt_payload": "learned.adaptation",
    "export": "learned.onnx_export",
    "train": "learned.training",
    "train_wrench": "learned.wrench",
}

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
