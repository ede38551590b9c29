"""The robot, its logs, the physics, identification and the gap workflow.

The names below are imported when they are first used, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ident.drive_gain import gains_from_payload as gains_from_payload
    from ident.drive_gain import shared_gains as shared_gains
    from ident.effects.base import Effect as Effect
    from ident.errors import InputError as InputError
    from ident.identification import Identification as Identification
    from ident.identification import identify as identify
    from ident.log import JointLog as JointLog
    from ident.log import Sample as Sample
    from ident.log_writer import write_log as write_log
    from ident.model import CurrentModel as CurrentModel
    from ident.model_file import load_model as load_model
    from ident.model_file import save_model as save_model
    from ident.predictor import CurrentPredictor as CurrentPredictor
    from ident.readers import open_log as open_log
    from ident.readers import open_logs as open_logs
    from ident.robot import Robot as Robot
    from ident.robot import load_robot as load_robot
    from ident.signals import choose_cutoff as choose_cutoff
    from ident.signals import derive as derive

_HOME = {
    "CurrentModel": "ident.model",
    "CurrentPredictor": "ident.predictor",
    "Effect": "ident.effects.base",
    "Identification": "ident.identification",
    "InputError": "ident.errors",
    "JointLog": "ident.log",
    "Robot": "ident.robot",
    "Sample": "ident.log",
    "choose_cutoff": "ident.signals",
    "derive": "ident.signals",
    "gains_from_payload": "ident.drive_gain",
    "identify": "ident.identification",
    "load_model": "ident.model_file",
    "load_robot": "ident.robot",
    "open_log": "ident.readers",
    "open_logs": "ident.readers",
    "save_model": "ident.model_file",
    "shared_gains": "ident.drive_gain",
    "write_log": "ident.log_writer",
}

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
