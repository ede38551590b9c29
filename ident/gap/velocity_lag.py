"""Step 1, preflight: whether the velocity that a robot logs comes later than the derivative of its position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import FloatArray
from ident.gap.baseline import WORTH
from ident.gap.rows import left_by, panel_of
from ident.log import LogSource, PositionsOnly
from ident.model import CurrentModel
from ident.walk import walk

LEAST = 2e-3
"""Seconds of lag below which nothing is said: a filter's rounding."""

AGREEMENT = 3.0
"""The joints' lags must agree: their median over its spread between joints."""


@dataclass(frozen=True)
class VelocityLag:
    """How late [s] the logged velocities are, by the median joint, and each joint (n,)."""

    seconds: float
    joints: FloatArray


def velocity_lag(sources: Sequence[LogSource], cutoff: float) -> VelocityLag | None:
    """Estimate the lag of logged velocities behind the derivative of the positions; None where there is none to see.

    To first order ``dq_logged = dq - lag ddq``, fitted joint by joint, both sides behind the same zero-phase filter.
    """
    products, squares = None, None
    for source in sources:
        for true, logged in zip(walk(PositionsOnly(source), cutoff), walk(source, cutoff), strict=True):
            if logged.log.dq is None:
                break
            known = np.isfinite(true.motion.ddq).all(axis=1) & np.isfinite(logged.motion.dq).all(axis=1)
            ddq = true.motion.ddq[known]
            behind = np.sum((true.motion.dq - logged.motion.dq)[known] * ddq, axis=0)
            size = np.sum(ddq**2, axis=0)
            products = behind if products is None else products + behind
            squares = size if squares is None else squares + size
    if products is None or squares is None:
        return None
    lags = products / np.maximum(squares, 1e-300)
    middle = float(np.median(lags))
    spread = float(np.median(np.abs(lags - middle))) * 1.4826
    return VelocityLag(middle, lags) if middle > max(LEAST, AGREEMENT * spread) else None


def new_lag(model: CurrentModel, sources: Sequence[LogSource], refit: bool) -> VelocityLag | None:
    """The lag of logged velocities for which a model does better on positions alone, if there is any.

    That of a model held fixed is new only if its own logs had none: positions must suit it better now.
    """
    lag = velocity_lag(sources, model.cutoff)
    return lag if lag is not None and (refit or _lags_more(model, sources)) else None


def _lags_more(model: CurrentModel, sources: Sequence[LogSource]) -> bool:
    """Whether velocities lag now and did not when a model held fixed was identified: positions suit it better."""
    if model.positions_only:
        return False
    models = [replace(model, positions_only=only) for only in (False, True)]
    left = [left_by(model, panel_of(model, sources)) for model in models]
    logged, derived = (float(np.sum(np.log(np.maximum(np.mean(x**2, axis=0), 1e-300)))) for x in left)
    return derived <= logged - WORTH * model.n
