"""How much of a hidden force is there to be found: what a refitted baseline cannot absorb."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comparisons.hidden_effects.laws import Scene, sign
from ident.arrays import FloatArray
from ident.gap.smoothing import SMOOTHINGS


def unabsorbed(scenes: Sequence[Scene], forces: Sequence[FloatArray], joint: int) -> float:
    """RMS [force unit] of what links, friction, rotor inertia and offset, refitted, leave of a hidden force.

    Args:
        scenes: the logs.
        forces: the hidden force (N, n) in each, in the same unit.
        joint: number of the joint, from 0.
    """
    target = np.concatenate([f[:, joint] for f in forces])
    rows = []
    for s in scenes:
        links = s.body.regressor(s.q, s.dq, s.ddq)[:, joint, s.body.base_parameters(joint).columns]
        v = s.dq[:, joint]
        # The baseline chooses over which speed its sign of velocity turns.
        own = [s.direction[:, joint], sign(v, float(SMOOTHINGS[-1])), v, s.ddq[:, joint], np.ones(len(s.t))]
        rows.append(np.column_stack([links, *own]))
    matrix = np.vstack(rows)
    matrix /= np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    left = target - matrix @ np.linalg.lstsq(matrix, target, rcond=1e-9)[0]
    return float(np.sqrt(np.mean(left**2)))
