"""Motion protocols: the paper's, those that excite, those that settle one question, and the data sets made of them."""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ident.errors import InputError

if TYPE_CHECKING:
    from comparisons.virtual_robot.motion import Protocol

_HOME = {
    "fourier": "excitation",
    "sinusoid": "excitation",
}
__all__ = ["fourier", "named", "sinusoid"]


def named(protocol: str) -> Callable[..., "Protocol"]:
    """Return the protocol of that name: a function of ``(robot, seconds=..., seed=...)``.

    Raises:
        InputError: there is none.
    """
    key = protocol.replace("-", "_")
    if key not in _HOME:
        raise InputError(f"no protocol {protocol!r}", "protocol", f"name one of {', '.join(sorted(_HOME))}")
    found: Callable[..., Protocol] = __getattr__(key)
    return found


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
