"""The super-twisting momentum observer."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.model import CurrentModel
from observers.model_based import ModelBasedObserver, Signals, per_joint


class SlidingModeObserver(ModelBasedObserver):
    """Super-twisting momentum observer (Garofalo et al. 2019), exact in finite time for forces of bounded rate.

    With x = p - p_est: p_est' = drive + k1 sqrt|x| sign(x) + w, w' = k2 sign(x), and w is the external force; gains
    k1 = 1.5 sqrt(L), k2 = 1.1 L for a rate of at most L (Levant 1998). Each step is solved implicitly, the sign at the
    step's end (Brogliato et al. 2020), so that nothing chatters however long the step.

    Args:
        model: identified model.
        force_rate: greatest rate of the external force L [force unit/s], one or (n,).
        filtered, rate: see `ModelBasedObserver`.

    Raises:
        InputError: a force rate is not positive.
    """

    def __init__(
        self, model: CurrentModel, force_rate: float | FloatArray, filtered: bool = True, rate: float | None = None
    ) -> None:
        bound = per_joint(force_rate, model.n, "force rate")
        self._gains = np.stack([1.5 * np.sqrt(bound), 1.1 * bound])
        super().__init__(model, filtered, rate)

    def _advance(self, signals: Signals) -> FloatArray:
        out = np.empty_like(signals.momentum)
        _scan(signals.step, signals.momentum, signals.drive, self._gains, self._state, out)
        return out


@compiled
def _scan(
    step: FloatArray, momentum: FloatArray, drive: FloatArray, gains: FloatArray, state: FloatArray, out: FloatArray
) -> None:
    """Go on over rows; ``state`` (3, n) is x + momentum's estimate, force, and drive of the row before.

    The step's end obeys x + h k1 sqrt|x| s + h^2 k2 s = b with s in the set sign(x): x is nought where |b| <= h^2 k2,
    else sqrt|x| solves a quadratic.
    """
    for k in range(len(step)):
        h = step[k]
        for j in range(momentum.shape[1]):
            if h > 0.0:
                k1, k2 = gains[0, j], gains[1, j]
                estimate = state[0, j] + h * (0.5 * (drive[k, j] + state[2, j]) + state[1, j])
                b = momentum[k, j] - estimate
                if abs(b) <= h * h * k2:
                    state[1, j] += b / h
                    state[0, j] = momentum[k, j]
                else:
                    s = 1.0 if b > 0.0 else -1.0
                    root = 0.5 * (-h * k1 + np.sqrt(h * h * k1 * k1 + 4.0 * (abs(b) - h * h * k2)))
                    state[1, j] += h * k2 * s
                    state[0, j] = momentum[k, j] - s * root * root
            else:
                state[0, j], state[1, j] = momentum[k, j], 0.0
            state[2, j] = drive[k, j]
            out[k, j] = state[1, j]
