"""Arrays of foreign files as numbers."""

from collections.abc import Mapping

import numpy as np

from ident.arrays import Array
from ident.errors import InputError


def numeric(arrays: Mapping[str, Array], where: str) -> dict[str, Array]:
    """Return the arrays as float64, integers as they are.

    Args:
        arrays: by name.
        where: the file, for messages.

    Raises:
        InputError: an array holds no real numbers.
    """
    numbers: dict[str, Array] = {}
    for name, value in arrays.items():
        if value.dtype.kind not in "iufb":
            raise InputError(f"{name} holds {value.dtype}, not real numbers", where, "save it as an array of doubles")
        numbers[name] = value.astype(np.float64) if value.dtype.kind != "i" else value.astype(np.int64)
    return numbers
