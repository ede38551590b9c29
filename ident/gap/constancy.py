"""Step 7, abstain: whether a name's own coefficients are the same all over the logs, as those of a true cause are."""

from __future__ import annotations

import numpy as np

from ident.effects.survey import Survey
from ident.gap.abstain import signals
from ident.gap.candidates import admissible
from ident.gap.joint_gap import JointGap, Named, gate_of
from ident.gap.panel import Panel

THIRDS = (1 / 3, 2 / 3)


def inconstancy(panel: Panel, survey: Survey, gap: JointGap, named: list[Named]) -> list[float]:
    """How much more would be explained if each name's coefficients could differ between parts of the logs.

    The rows are cut in thirds by the value of one signal at a time, and the coefficients of one name at a time may
    differ between them (a varying-coefficient test, Hastie and Tibshirani 1993). Returned for each name is the largest
    fall of the squared residual, less what the largest of a surrogate usually is, over what all of them explain.
    """
    full, plain = gap.problem(panel, [n.trial for n in named]), gap.problem(panel)
    explained = float(plain.residual @ plain.residual) - float(full.residual @ full.residual)
    gate = gate_of(panel, full, gap.joint)
    _, values = signals(panel, survey, gap.joint)
    parts = [np.digitize(v, np.quantile(v, THIRDS)) for v in values[full.keep].T]
    falls: list[list[tuple[float, float]]] = []
    for one in named:
        others = gap.problem(panel, [n.trial for n in named if n is not one])
        columns = admissible(panel, others, one.effect, one.trial.shape, gap.joint)
        falls.append([])
        for part in parts:
            varying = np.hstack([columns * (part == k)[:, None] for k in (0, 2)])
            drops, statistics = gate.look([varying])
            falls[-1].append((float(drops[0]), float(drops[0] / statistics[0]) if statistics[0] > 0 else 0.0))
    usual = float(np.median(gate.largest))
    most = (max(fall - usual * chance for fall, chance in of_one) for of_one in falls)
    return [max(0.0, fall) / max(explained, 1e-300) for fall in most]
