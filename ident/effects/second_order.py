"""What rings, or filters, by a law of second order, followed exactly while its input runs straight."""

from __future__ import annotations

import numpy as np

from ident.compiled import compiled


@compiled
def followed(value: float, rise: float, last: float, now: float, past: float, damping: float) -> tuple[float, float]:
    """Follow ``y'' + 2 damping y' + y = u`` while its input u runs straight from the last to now.

    Args:
        value: y at the beginning.
        rise: its rate of change, a radian.
        last: input at the beginning.
        now: input at the end.
        past: time between them, in radians of the undamped frequency.
        damping: damping ratio, below one.

    Returns:
        Value and rate of change, a radian, at the end.
    """
    slope = (now - last) / past
    off, faster = value - last + 2.0 * damping * slope, rise - slope
    swing, fade = np.sqrt(1.0 - damping**2), np.exp(-damping * past)
    sine, cosine = np.sin(swing * past) / swing, np.cos(swing * past)
    after = now - 2.0 * damping * slope + fade * (off * cosine + (faster + damping * off) * sine)
    return after, slope + fade * (faster * cosine - (damping * faster + off) * sine)
