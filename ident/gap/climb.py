"""Search of shape parameters from starts, without derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from ident.arrays import FloatArray
from ident.effects.base import Shape

GOLDEN = 0.618034
"""Share of its range that a step of a golden section leaves."""

NOWHERE = -1e30
"""In place of a value of minus infinity, through which no parabola goes."""

COARSE, STEPS = 6, 12
"""Steps of a golden section as narrow as a search that tells which of several starts, or parameters, leads where; and
as one that is kept."""

LOOKS, SETTLED = 40, 1e-5
"""Values that a simplex looks at for each parameter, and share of the largest by which its corners may differ."""

EDGE = 0.03
"""Length of the first simplex's edges, as shares of the parameters' ranges."""


def climb(
    value: Callable[[FloatArray], float],
    shapes: Sequence[Shape],
    starts: Sequence[tuple[FloatArray, float]],
    least: float = 0.0,
) -> tuple[FloatArray, float]:
    """Search shapes (k,) for the largest value around starts, each with its own; return both.

    Sections along one parameter after the other, as far as the neighbouring starts. Several, which may be bound
    to one another, are searched so once more from the best, and then moved together by a simplex (Nelder and Mead
    1965), unless the first sections lead to less than ``least``.
    """
    alone = len(shapes) < 2
    steps = STEPS if alone else COARSE
    best = max((_along_each(value, shapes, *start, steps) for start in starts), key=lambda one: one[1])
    if alone or best[1] < least:
        return best
    best = _along_each(value, shapes, *best, STEPS)
    return together(value, shapes, *best) if best[1] > 0.0 else best


def _along_each(
    value: Callable[[FloatArray], float], shapes: Sequence[Shape], start: FloatArray, best: float, steps: int
) -> tuple[FloatArray, float]:
    """Search one parameter after the other from a start of that value."""
    shape = start.copy()

    def along(number: int, x: float) -> float:
        moved = shape.copy()
        moved[number] = shapes[number].value(x)
        return value(moved)

    for number, parameter in enumerate(shapes):
        low, high = _bracket(parameter, shape[number])
        x, found = _section(lambda x, number=number: along(number, x), low, high, steps)  # type: ignore[misc]
        if found > best:
            shape[number], best = parameter.value(x), found
    return shape, best


def together(
    value: Callable[[FloatArray], float], shapes: Sequence[Shape], shape: FloatArray, best: float
) -> tuple[FloatArray, float]:
    """Move all parameters at once from a shape of that value, as long as that gains anything."""

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
        options={
            "initial_simplex": np.vstack([first, corners]),
            "maxfev": LOOKS * len(shapes),
            "xatol": np.inf,
            "fatol": SETTLED * best,
        },
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


def _section(value: Callable[[float], float], low: float, high: float, steps: int) -> tuple[float, float]:
    """Search a maximum by parabolas and golden sections (Brent 1973), as narrowly as so many golden sections would."""
    narrow = GOLDEN**steps * (high - low)
    found = minimize_scalar(
        lambda x: -max(value(x), NOWHERE),
        bounds=(low, high),
        method="bounded",
        options={"xatol": narrow, "maxiter": steps + 2},
    )
    return float(found.x), -float(found.fun)
