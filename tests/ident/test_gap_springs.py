"""Names of springs."""

import numpy as np
import pytest
from planar_arm import record, structure

from ident.effects.rigid_body import CableSpring
from ident.gap.baseline import baseline_model
from ident.gap.candidates import Trial, with_errors
from ident.gap.search import Beside
from ident.gap.subject import Subject


@pytest.mark.parametrize(("slack", "inside"), [(0.25, 0.0), (0.5, 0.4)])
def test_a_hose_that_hangs_slack_about_its_middle_is_a_spring(arm, slack, inside):
    def hidden(t, q, dq):
        return 1.2 * np.sign(q[:, 1]) * np.maximum(np.abs(q[:, 1]) - slack, 0.0) + inside * q[:, 1]

    (one,) = structure(arm, hidden=hidden).findings
    assert (one.effect, one.joints) == ("cable-spring", (1,))
    figures = [one.parameters[name] for name in ("slack", "slack_stiffness", "stiffness")]
    np.testing.assert_allclose(figures, [slack, inside, inside + 1.2], rtol=0.15, atol=0.05)


@pytest.mark.parametrize(("stiffness", "is_spring"), [(0.5, True), (0.0, False)])
def test_what_grows_with_the_cube_alone_is_met_as_a_stop_and_is_no_spring(arm, stiffness, is_spring):
    def hidden(t, q, dq):
        angle = q[:, 1] + 1.5
        return stiffness * angle + 0.1 * angle**3

    train = [record(arm, seed, hidden) for seed in (1, 2, 3)]
    subject = Subject(baseline_model(arm, train), train, True)
    subject.look()
    beside = Beside.of(subject.panel, subject.gaps[1], [])
    spring = with_errors(subject.panel, beside.problem, Trial(CableSpring(1), np.array([-1.5]), 0.0), 1)
    assert beside.gains(spring)
    assert beside.passes(subject.panel, spring) is is_spring
