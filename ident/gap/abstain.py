"""Step 7, abstain: how much of what is left could be explained by anything at all, and on what it depends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ident.arrays import FloatArray, IntArray
from ident.compiled import compiled
from ident.effects.elapsed import elapsed
from ident.effects.survey import Survey
from ident.gap.counts import counted_acceleration, counted_force
from ident.gap.panel import Panel

PLAY = (5e-4, 5e-3, 5e-2)
"""Widths [rad or m] of the play operators whose states tell where a joint came from."""

LEARNT_ROWS = 6_000
"""Rows that are learnt from, up to twice as many: more cost time and change next to nothing."""
STRETCH = 4.0
"""Seconds of a stretch of rows that is held out, or learnt from, as a whole."""

FOLDS = 3
"""Sets that stretches are dealt to."""


@dataclass(frozen=True)
class Explainable:
    """How much of a residual a flexible regressor predicts on stretches held out.

    Attributes:
        share: of the residual's square; nought where nothing is predicted.
        depends_on: signals that it depends on, most important first.
    """

    share: float
    depends_on: tuple[str, ...]


def explainable(panel: Panel, survey: Survey, joint: int, residual: FloatArray, rows: IntArray) -> Explainable:
    """Bound what could be explained of a joint's residual (M,), given in the rows (M,) that count.

    Gradient-boosted trees (Friedman 2001; scikit-learn's histogram form) on positions, velocities, direction, history,
    load and run time predict every third stretch of a few seconds from the others.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    names, features = signals(panel, survey, joint)
    chosen = np.arange(0, len(rows), max(1, len(rows) // LEARNT_ROWS))
    x, y = features[rows[chosen]], residual[chosen]
    t = elapsed(panel.motion.t, 0.0, survey.begins)[rows[chosen]]
    fold = (t // STRETCH).astype(np.int64) % FOLDS
    predicted, weight = np.zeros(len(y)), np.zeros(len(names))
    rng = np.random.default_rng(0)
    with threadpool_limits(1):
        for k in range(FOLDS):
            train, held = fold != k, fold == k
            if not (held.any() and train.sum() > 100):
                continue
            trees = HistGradientBoostingRegressor(
                max_iter=50,
                learning_rate=0.1,
                max_leaf_nodes=16,
                min_samples_leaf=30,
                early_stopping=False,
                random_state=0,
            ).fit(x[train], y[train])
            predicted[held] = trees.predict(x[held])
            if k == 0:
                weight = _importance(trees.predict, x[held], y[held], rng)
    share = float(1.0 - np.sum((y - predicted) ** 2) / max(np.sum(y**2), 1e-300))
    order = [i for i in np.argsort(-weight) if weight[i] > 0.1 * max(weight.max(), 1e-300)]
    return Explainable(max(share, 0.0), tuple(dict.fromkeys(names[i] for i in order))[:4])


def _importance(predict, x: FloatArray, y: FloatArray, rng: np.random.Generator) -> FloatArray:  # type: ignore[no-untyped-def]
    """By how much the squared error rises when a signal is shuffled (Breiman 2001)."""
    few = slice(None, None, max(1, len(y) // 1000))
    x, y = x[few], y[few]
    least, rise = np.mean((y - predict(x)) ** 2), np.zeros(x.shape[1])
    for i in range(x.shape[1]):
        mixed = x.copy()
        mixed[:, i] = rng.permutation(mixed[:, i])
        rise[i] = np.mean((y - predict(mixed)) ** 2) - least
    return rise


def signals(panel: Panel, survey: Survey, joint: int) -> tuple[list[str], FloatArray]:
    """Names and values (N, k) of what a joint's residual may depend on."""
    n, own = panel.robot.n, joint + 1
    q, dq = panel.motion.q, panel.velocity
    ddq = _coarse(panel.motors.ddq[:, joint], counted_acceleration(panel, survey, joint))
    load = _coarse(panel.seen("load")[:, joint], counted_force(panel, survey, joint))
    columns = [(f"q{k + 1}", q[:, k]) for k in range(n)] + [(f"dq{k + 1}", dq[:, k]) for k in range(n)]
    columns += [
        (f"sign(dq{own})", np.tanh(dq[:, joint] / survey.smoothing[joint])),
        (f"ddq{own}", ddq),
        (f"load{own}", load),
        ("t", panel.motion.t),
    ]
    if survey.begins:
        columns.append(("t", elapsed(panel.motion.t, 0.0, survey.begins)))
    for width in PLAY:
        states = [
            _play(np.ascontiguousarray(b.motion.q[:, joint]), width)[r]
            for b, r in zip(panel.blocks, panel.rows, strict=True)
        ]
        columns.append((f"history of q{own}", np.concatenate(states)))
    return [name for name, _ in columns], np.column_stack([values for _, values in columns])


def _coarse(signal: FloatArray, noise: float) -> FloatArray:
    """A signal (N,) in steps beyond its noise, which a residual holds as what the model predicts of it."""
    return np.round(signal / (2.0 * noise)) * (2.0 * noise) if noise > 0.0 else signal


@compiled
def _play(q: FloatArray, width: float) -> FloatArray:
    """Displacement since the last reversal, within plus and minus the width, over the width."""
    out = np.empty(len(q))
    place = q[0]
    for k in range(len(q)):
        if q[k] - place > width:
            place = q[k] - width
        elif q[k] - place < -width:
            place = q[k] + width
        out[k] = (q[k] - place) / width
    return out
