"""``sensorless doctor``: is everything the program stands on there, and does it work?"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import platform
import re
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError

RUN_EXTRAS = ("learned", "cluster")
"""Extras that commands make use of; the others serve those who work on the program."""
IMPORT_NAME = {"scikit-learn": "sklearn", "pin": "pinocchio"}
"""Where the module is not called as the distribution."""
AGREEMENT = 1e-9
"""Greatest difference of two computations of the same torque, relative to the torque."""


def doctor() -> int:
    """Check that everything the program stands on is there and works.

    Prints one line a check; exits with 1 if one failed. What belongs to an optional extra may be absent.
    """
    print(f"sensorless {importlib.metadata.version('sensorless')}")
    print(f"python {platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores")
    print(f"threads: {_threads()}\n")
    passed = []
    for name, extra in _requirements():
        if extra and importlib.util.find_spec(name) is None:
            print(f"absent  {name:<12} optional: pip install 'sensorless[{extra}]'")
        else:
            passed.append(_check(name, partial(_version, name)))
    print()
    passed += [
        _check("numba cache", _numba_cache),
        _check("dynamics", _dynamics),
        _check("feasibility", _semidefinite_solver),
    ]
    print()
    print("all is well" if all(passed) else f"{passed.count(False)} of {len(passed)} checks failed")
    return 0 if all(passed) else 1


def _requirements() -> list[tuple[str, str]]:
    """Distributions that the program stands on, as (name, extra), from its own metadata; extra "" is needed always."""
    found = []
    for line in importlib.metadata.requires("sensorless") or []:
        name = re.match(r"[\w.-]+", line)
        extra = re.search(r"extra == ['\"]([\w-]+)", line)
        if name and (extra is None or extra[1] in RUN_EXTRAS):
            found.append((name[0], extra[1] if extra else ""))
    return found


def _check(name: str, examine: Callable[[], str]) -> bool:
    """Print a line saying what a check found; any exception is what it is there to find."""
    try:
        found = examine()
    except (Exception, SystemExit) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        print(f"failed  {name:<12} {reason}")
        return False
    print(f"ok      {name:<12} {found}")
    return True


def _version(name: str) -> str:
    importlib.import_module(IMPORT_NAME.get(name, name))
    return importlib.metadata.version(name)


def _threads() -> str:
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    given = [f"{name}={os.environ[name]}" for name in names if name in os.environ]
    return ", ".join(given) if given else "as many as cores, no limit set"


def _numba_cache() -> str:
    """Find where the compiled loops are kept: without a writable place each run would compile them anew."""
    from ident import rigid_body_kernels

    kernel = rigid_body_kernels.inverse_dynamics_rows
    folder = Path(kernel._cache.cache_path)  # type: ignore[attr-defined]
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        return str(folder)


def _dynamics() -> str:
    """Compare the compiled inverse dynamics of the built-in arm with Pinocchio's, at random states."""
    from ident.robot import load_robot

    robot = load_robot("vs060")
    random = np.random.default_rng(0)
    q, dq, ddq = random.uniform(-1.0, 1.0, (3, 20, robot.n))
    compiled = robot.rigid_body.inverse_dynamics(q, dq, ddq, robot.multibody.parameters)
    reference = np.array([robot.multibody.inverse_dynamics(*state) for state in zip(q, dq, ddq, strict=True)])
    difference = float(np.max(np.abs(compiled - reference)) / np.max(np.abs(reference)))
    if not difference < AGREEMENT:
        raise InputError(f"torques differ by {difference:.1e}", "vs060 at random states", "reinstall pin and numba")
    return f"inverse dynamics of vs060 agree with Pinocchio's to {difference:.0e}"


def _semidefinite_solver() -> str:
    """Solve a semidefinite programme whose answer is known: the largest eigenvalue of a matrix."""
    import cvxpy

    matrix = np.array([[2.0, 1.0], [1.0, 2.0]])
    bound = cvxpy.Variable()
    problem: Any = cvxpy.Problem(cvxpy.Minimize(bound), [bound * np.eye(2) - matrix >> 0])
    found = float(problem.solve(solver=cvxpy.CLARABEL))
    if not abs(found - 3.0) < 1e-6:
        raise InputError(f"found {found} where 3 is right", "a semidefinite programme", "reinstall clarabel")
    return "Clarabel solves a semidefinite programme"
