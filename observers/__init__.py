"""From model and measurement to residual, contact, wrench and compliance.

The names below are imported when they are first used, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from observers.direct import DirectEstimator as DirectEstimator
    from observers.disturbance import DisturbanceObserver as DisturbanceObserver
    from observers.filtered_dynamics import FilteredDynamicsObserver as FilteredDynamicsObserver
    from observers.kalman import KalmanObserver as KalmanObserver
    from observers.methods import METHODS as METHODS
    from observers.methods import make_estimator as make_estimator
    from observers.momentum import MomentumObserver as MomentumObserver
    from observers.residual import Residual as Residual
    from observers.residual import ResidualEstimator as ResidualEstimator
    from observers.sliding_mode import SlidingModeObserver as SlidingModeObserver

_HOME = {
    "DirectEstimator": "observers.direct",
    "DisturbanceObserver": "observers.disturbance",
    "FilteredDynamicsObserver": "observers.filtered_dynamics",
    "KalmanObserver": "observers.kalman",
    "METHODS": "observers.methods",
    "MomentumObserver": "observers.momentum",
    "Residual": "observers.residual",
    "ResidualEstimator": "observers.residual",
    "SlidingModeObserver": "observers.sliding_mode",
    "make_estimator": "observers.methods",
}

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
