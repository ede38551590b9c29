"""Motion protocols: the paper's, those that excite, those that settle one question, and the data sets made of them."""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ident.errors import InputError

if TYPE_CHECKING:
    from comparisons.virtual_robot.motion import Protocol

_HOME = {
    "PRESETS": "dataset",
    "Recording": "dataset",
    "contact_episodes": "contact",
    "continuous": "paper",
    "fourier": "excitation",
    "generate": "dataset",
    "mixed": "paper",
    "payload_pair": "calibration",
    "plateaus": "calibration",
    "reversals": "calibration",
    "sinusoid": "excitation",
    "static_poses": "calibration",
    "stop_and_go": "paper",
    "torque_ramps": "calibration",
}
_NO_PROTOCOL = ("PRESETS", "Recording", "generate", "payload_pair")
__all__ = [
    "PRESETS",
    "Recording",
    "contact_episodes",
    "continuous",
    "fourier",
    "generate",
    "mixed",
    "named",
    "payload_pair",
    "plateaus",
    "reversals",
    "sinusoid",
    "static_poses",
    "stop_and_go",
    "torque_ramps",
]


def named(protocol: str) -> Callable[..., "Protocol"]:
    """Return the protocol of that name: a function of ``(robot, seconds=..., seed=...)``.

    Args:
        protocol: its name, with hyphens or underscores.

    Raises:
        InputError: there is none.
    """
    key = protocol.replace("-", "_")
    known = [name for name in _HOME if name not in _NO_PROTOCOL]
    if key not in known:
        raise InputError(f"no protocol {protocol!r}", "protocol", f"name one of {', '.join(known)}")
    found: Callable[..., Protocol] = __getattr__(key)
    return found


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
