"""Refuses logs whose current is in another unit than that of a model."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ident.errors import InputError
from ident.log import LogSource
from ident.log_set import path_of
from ident.model import CurrentModel

FACTOR = 20.0
"""Measured current over predicted from which on the unit must differ: no load and no wear changes a robot as much."""
ALIKE, ROUGHLY_ALIKE = 0.8, 0.5
"""Correlations of measured and predicted current from which on one is the other in another unit: with a model that has
not learnt from the log, which may err by as much where it extrapolates, and one that has, and was spoilt by it."""
VARIES = 1e-6
"""Share of its mean square by which a prediction must vary to be told from a constant."""
CLOSE = 0.2
"""A ratio whose common logarithm is this close to a whole number is told as that power of ten."""


def check_unit(model: CurrentModel, logs: Iterable[LogSource], learnt: bool = False) -> None:
    """Refuse the first log in which most joints measure what the model predicts, many times larger or smaller.

    Args:
        model: predicts the currents.
        logs: to check.
        learnt: whether the model has learnt from these logs.

    Raises:
        InputError: the log, by how much it differs, and how to mend it.
    """
    for source in logs:
        ratio = _ratio(model, source, ROUGHLY_ALIKE if learnt else ALIKE)
        if 1.0 / FACTOR < ratio < FACTOR:
            continue
        power = np.log10(ratio)
        if abs(power - np.round(power)) < CLOSE:
            ratio = float(10.0 ** np.round(power))
        columns = "i1" if model.n == 1 else f"i1 to i{model.n}"
        what = f"{columns} hold about {ratio:.3g} times what the model predicts: another unit than its {model.unit}"
        where = f"{path_of(source)} row 1"
        how = f"multiply scale current in [log] of its card by {1.0 / ratio:.3g}"
        raise InputError(what, where, "give all logs in one unit" if learnt else how)


def _ratio(model: CurrentModel, source: LogSource, alike: float) -> float:
    """Measured current over predicted, the median of joints; 1 unless most joints' follow the prediction."""
    rows, sums, squares, both = 0, np.zeros((2, model.n)), np.zeros((2, model.n)), np.zeros(model.n)
    for log, predicted in model.predict_blocks(source):
        known = np.isfinite(predicted).all(axis=1)
        pair = np.stack([predicted[known], log.current[known]])
        rows += pair.shape[1]
        sums += pair.sum(axis=1)
        squares += np.sum(pair**2, axis=1)
        both += np.prod(pair, axis=0).sum(axis=0)
    spread = squares - sums**2 / max(rows, 1)
    common = both - np.prod(sums, axis=0) / max(rows, 1)
    varies = np.all(spread > VARIES * squares, axis=0)
    like = varies & (common > alike * np.sqrt(np.prod(np.where(varies, spread, 0.0), axis=0)))
    return float(np.median(common[like] / spread[0, like])) if 2 * np.sum(like) > model.n else 1.0
