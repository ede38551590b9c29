"""Numba with the types kept: the decorator of every compiled loop, and a loop over samples on all cores."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar, cast

import numba
import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

CHUNK = 4096  # rows a thread takes at a time: milliseconds of work, so that handing it over costs nothing


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays and numbers on its first call; kept on disk, and free of Python's lock.

    Division by zero gives inf or NaN, as in numpy. Additions and multiplications may be fused.
    """
    decorate = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
    return cast(Callable[P, R], decorate(function))


def over_rows(kernel: Callable[..., None], fixed: tuple[Any, ...], *arrays: Any) -> None:
    """Call ``kernel(*fixed, *arrays)``, the rows of ``arrays`` split among the cores where there are many.

    Threads rather than numba's own ``prange``: that one cannot be forked or called from two threads at once.
    """
    rows = len(arrays[0])
    cores = int(numba.config.NUMBA_NUM_THREADS) if rows > CHUNK else 1  # type: ignore[attr-defined]
    if cores == 1:
        kernel(*fixed, *arrays)
        return
    bounds = np.arange(0, rows, CHUNK)
    with ThreadPoolExecutor(cores) as pool:
        tasks = [pool.submit(kernel, *fixed, *(a[start : start + CHUNK] for a in arrays)) for start in bounds]
        for task in tasks:
            task.result()
