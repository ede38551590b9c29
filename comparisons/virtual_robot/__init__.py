"""A robot whose truth is known, with friction that remembers: the stand-in for hardware."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from comparisons.virtual_robot.closed_loop import ClosedLoop, run_closed_loop
    from comparisons.virtual_robot.contact import Hand, Push
    from comparisons.virtual_robot.motion import Protocol, ReferenceBlock
    from comparisons.virtual_robot.robot import VirtualRobot, simulate
    from comparisons.virtual_robot.scenario import Scenario, built_in_scenarios, load_scenario

_HOME = {
    "ClosedLoop": "closed_loop",
    "run_closed_loop": "closed_loop",
    "Hand": "contact",
    "Push": "contact",
    "Protocol": "motion",
    "ReferenceBlock": "motion",
    "VirtualRobot": "robot",
    "simulate": "robot",
    "Scenario": "scenario",
    "built_in_scenarios": "scenario",
    "load_scenario": "scenario",
}
__all__ = [
    "ClosedLoop",
    "Hand",
    "Protocol",
    "Push",
    "ReferenceBlock",
    "Scenario",
    "VirtualRobot",
    "built_in_scenarios",
    "load_scenario",
    "run_closed_loop",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
