"""The command line: one file a command under ``comparisons.commands``, imported only when it is called."""

from __future__ import annotations

import difflib
import os
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any, NoReturn

from cyclopts import App, CycloptsError

from ident.errors import InputError

DEBUG = "SENSORLESS_DEBUG"
"""Environment variable that makes a fault of the program print its traceback."""

COMMANDS = {
    "compare": "Compare estimators on the same logs: how they err, what they feel, what they cost.",
    "convert": "Convert a log to CSV or Parquet, in the columns and units of the contract.",
    "doctor": "Check that everything the program stands on is there and works.",
    "demo": "The main job on the virtual VS060 in minutes: excite, identify, gap, train, compare, comply.",
    "excite": "Design a motion that shows the robot's parameters and keeps all its limits.",
    "gap": "Find where simulation and measurement disagree, name what is missing and add it to the model.",
    "identify": "Identify a robot's current model from its logs.",
    "observe": "Estimate what the outside world adds to the joints, and find contacts.",
    "train": "Train a network that predicts the motor current, and test it.",
}
"""What each command does, as ``sensorless --help`` says it; ``NAME`` is the function NAME of commands/NAME.py."""


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit: 0 done, 1 a fault of the program, 2 the input or the call is wrong, 130 interrupted.

    Args:
        arguments: words after ``sensorless``; those of the process unless given.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)

    def run() -> int | None:
        _check_command(words)
        status: int | None = build_app()(words)
        return status

    _exit_after(run, _help_for(words))


def run_alone(command: Callable[..., None]) -> NoReturn:
    """Run the command of a module that is called by ``python -m``, and exit as `main` does.

    Args:
        command: its function; the words of the process are its arguments.
    """
    app = _app()
    app.default(command)
    _exit_after(lambda: app(sys.argv[1:]), "--help")


def _exit_after(run: Callable[[], int | None], help_words: str) -> NoReturn:
    # A terminated run leaves through the same doors as an interrupted one, so that nothing half-written stays.
    signal.signal(signal.SIGTERM, _terminate)
    try:
        status = run() or 0
        sys.stdout.flush()
    except InputError as error:
        _say(f"error: {_one_line(str(error))}")
        status = 2
    except CycloptsError as error:
        _say(f"error: {_one_line(str(error)).rstrip('.')}, on the command line, see {help_words}")
        status = 2
    except KeyboardInterrupt:
        _say("interrupted")
        status = 130
    except BrokenPipeError:
        # Whoever read our output has gone, as in ``sensorless ... | head``: Python must not complain of it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    except Exception as error:
        _say(_fault(error))
        status = 1
    sys.exit(status)


def build_app() -> App:
    """Return the cyclopts application; commands are imported when they are called, not before."""
    purpose = "A sense of touch for robot arms from joint positions and motor currents."
    app = _app(name="sensorless", help=purpose, version=_version)
    for name, purpose in COMMANDS.items():
        app.command(f"comparisons.commands.{name}:{name}", name=name, help=purpose)
    return app


def _app(**options: Any) -> App:
    """Return a cyclopts application that leaves errors and exits to us."""
    return App(
        print_error=False,
        exit_on_error=False,
        result_action="return_value",
        help_format="plaintext",
        suppress_keyboard_interrupt=False,
        **options,
    )


def _check_command(words: list[str]) -> None:
    """Refuse an unknown command; cyclopts would import every command to say so."""
    if not words or words[0].startswith("-") or words[0] in COMMANDS:
        return
    near = difflib.get_close_matches(words[0], COMMANDS, n=1)
    how = f"did you mean {near[0]}?" if near else f"give one of {', '.join(COMMANDS)}"
    raise InputError(f"no command {words[0]!r}", "on the command line", how)


def _version() -> str:
    import importlib.metadata

    return importlib.metadata.version("sensorless")


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    sys.exit(128 + number)


def _help_for(words: list[str]) -> str:
    command = words[0] if words and words[0] in COMMANDS else ""
    return " ".join(["sensorless", *filter(None, [command]), "--help"])


def _fault(error: Exception) -> str:
    """Say what broke, with the traceback only where it was asked for."""
    if os.environ.get(DEBUG) == "1":
        return "".join(traceback.format_exception(error)).rstrip()
    kind = f"{type(error).__name__}: {_one_line(str(error))}".rstrip(": ")
    return f"fault of the program: {kind}; run again with {DEBUG}=1 for the traceback and report it"


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _say(line: str) -> None:
    print(line, file=sys.stderr)
