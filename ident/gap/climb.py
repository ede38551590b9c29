"""Search of shape parameters from a start, without derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize

from ident.arrays import FloatArray
from ident.effects.base import Shape

GOLDEN = 0.381966

STEPS, LOOKS = 12, 40
"""Steps of a golden section, and values that a simplex looks at for each parameter."""

EDGE = 0.03
"""Length of the first simplex's edges, as shares of the parameters' ranges."""


def climb(
    value: Callable[[FloatArray], float], shapes: Sequence[Shape], start: FloatArray, at_start: float
) -> tuple[FloatArray, float]:
    """Search shapes (k,) for the largest value around a start; return both.

    Golden sections along one parameter after the other, as far as the neighbouring starts; several, which may be bound
    to one another, are then moved together by a simplex (Nelder and Mead 1965).
    """
    shape, best = start.copy(), at_start

    def along(number: int, x: float) -> float:
        moved = shape.copy()
        moved[number] = shapes[number].value(x)
        return value(moved)

    for _ in range(1 if len(shapes) < 2 else 2):
        for number, parameter in enumerate(shapes):
            low, high = _bracket(parameter, shape[number])
            x, found = _golden(lambda x, number=number: along(number, x), low, high)  # type: ignore[misc]
            if found > best:
                shape[number], best = parameter.value(x), found
    return _together(value, shapes, shape, best) if len(shapes) > 1 and best > 0.0 else (shape, best)


def _together(
    value: Callable[[FloatArray], float], shapes: Sequence[Shape], shape: FloatArray, best: float
) -> tuple[FloatArray, float]:
    """Move all parameters at once from a shape of that value."""

    def at(x: FloatArray) -> FloatArray:
        return np.array([s.value(v) for s, v in zip(shapes, x.tolist(), strict=True)])

    lower, upper = np.array([[s.place(s.lower), s.place(s.upper)] for s in shapes]).T
    first = np.clip([s.place(v) for s, v in zip(shapes, shape.tolist(), strict=True)], lower, upper)
    edge = EDGE * (upper - lower)
    corners = first + np.diag(np.where(first + edge > upper, -edge, edge))
    found = minimize(
        lambda x: -value(at(x)),
        first,
        method="Nelder-Mead",
        bounds=list(zip(lower, upper, strict=True)),
        options={"initial_simplex": np.vstack([first, corners]), "maxfev": LOOKS * len(shapes)},
    )
    return (at(found.x), -float(found.fun)) if -found.fun > best else (shape, best)


def _bracket(parameter: Shape, value: float) -> tuple[float, float]:
    """Search range around a start: to the neighbouring starts, or the bounds."""
    starts = np.array(sorted({parameter.lower, *parameter.starts, parameter.upper}))
    others = starts[~np.isclose(starts, value, rtol=1e-9, atol=1e-12)]
    below, above = others[others < value], others[others > value]
    low = below[-1] if len(below) else parameter.lower
    high = above[0] if len(above) else parameter.upper
    return parameter.place(float(low)), parameter.place(float(high))


def _golden(value: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Golden-section search for a maximum."""
    a, b = low, high
    x, y = a + GOLDEN * (b - a), b - GOLDEN * (b - a)
    fx, fy = value(x), value(y)
    for _ in range(STEPS):
        if fx > fy:
            b, y, fy = y, x, fx
            x = a + GOLDEN * (b - a)
            fx = value(x)
        else:
            a, x, fx = x, y, fy
            y = b - GOLDEN * (b - a)
            fy = value(y)
    return (x, fx) if fx > fy else (y, fy)
