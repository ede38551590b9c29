"""What the noise of a velocity may be, told from the log alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ident.effects.base import Term
from ident.effects.electrical import TorqueSaturation
from ident.gap.report import Finding
from ident.gap.reporter import nil_warnings
from ident.gap.unsure import velocity_noise
from ident.log import JointLog
from ident.walk import collect

CUTOFF, COUNT = 12.0, 2.0 * np.pi / 2**17


def creeping():
    """A joint that rests, creeps by a few counts, and goes off: its log, and its true velocity."""
    t = np.arange(0.0, 12.0, 0.002)
    dq = np.interp(t, [0.0, 3.0, 3.5, 7.0, 8.0, 12.0], [0.0, 0.0, 4e-4, 4e-4, 0.5, 0.5])
    q = np.concatenate([[0.0], np.cumsum(0.5 * (dq[1:] + dq[:-1]) * np.diff(t))])
    return t, np.round(q / COUNT) * COUNT, dq


def test_counts_that_come_slowly_are_noise_of_the_velocity():
    t, q, true = creeping()
    (block,) = collect([JointLog(t, q[:, None], np.zeros((len(t), 1)))], CUTOFF)
    noise = velocity_noise(SimpleNamespace(cutoff=CUTOFF, positions_only=False), block)[:, 0]
    error = block.motion.dq[:, 0] - true
    for first, last in ((3.5, 7.0), (8.5, 11.5)):
        rows = (t > first) & (t < last)
        assert np.sqrt(np.mean(noise[rows] ** 2)) == pytest.approx(np.sqrt(np.mean(error[rows] ** 2)), rel=0.7)
    resting = (t > 0.5) & (t < 2.5)
    assert noise[resting].max() < 1e-6


def test_a_finding_that_rows_left_out_deny_is_said_to_come_to_nothing():
    def found(excess):
        terms = (Term(TorqueSaturation(5), np.array([2.0]), np.array([excess])),)
        return Finding("torque-saturation", "electrical", (5,), {}, 1e-6, (), None, terms, 0.4)

    assert nil_warnings([found(0.2), replace(found(0.0), terms=())]) == []
    (said,) = nil_warnings([found(0.2), found(0.0)])
    assert said.startswith(
        "Joint 6: torque-saturation shows in rows whose sign of velocity is sure, and comes to nothing"
    )
