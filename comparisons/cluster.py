"""Where joblib's parallel work is done: processes of this machine, or the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ident.errors import InputError


@contextmanager
def workers(scheduler: str | None, jobs: int | None = None) -> Iterator[None]:
    """Let joblib's parallel work in the block be done by a Dask cluster, or by processes of this machine.

    Args:
        scheduler: Address of the Dask scheduler, ``tcp://HOST:PORT``; None stays on this machine.
        jobs: How many processes of this machine, each with one thread for linear algebra; None leaves joblib's choice.

    Raises:
        InputError: Dask is not installed, or nobody answers at the address; no process at all is asked for.
    """
    from joblib import parallel_config

    if jobs == 0:
        raise InputError("no process at all", "--jobs 0", "give how many, or -1 for one a core")

    if scheduler is not None:
        with _client(scheduler), parallel_config(backend="dask", n_jobs=-1):
            yield
    elif jobs is None:
        yield
    elif jobs == 1:
        with parallel_config(backend="sequential"):
            yield
    else:
        with parallel_config(backend="loky", n_jobs=jobs, inner_max_num_threads=1):
            yield


def _client(scheduler: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("no Dask", "--scheduler", 'pip install "sensorless[cluster]"') from error
    try:
        return Client(scheduler, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError("no scheduler answers", f"--scheduler {scheduler}", "start dask scheduler there") from error
