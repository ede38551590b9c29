"""Names of springs."""

import numpy as np
import pytest
from planar_arm import record, structure

from ident.effects.rigid_body import CableSpring
from ident.gap.baseline import baseline_model
from ident.gap.candidates import Trial, with_errors
from ident.gap.search import Beside
from ident.gap.subject import Subject


def test_a_hose_that_hangs_slack_about_its_middle_is_a_spring(arm):
    found = structure(arm, hidden=lambda t, q, dq: 0.8 * np.sign(q[:, 1]) * np.maximum(np.abs(q[:, 1]) - 0.25, 0.0))
    (one,) = found.findings
    assert (one.effect, one.joints) == ("cable-spring", (1,))
    assert one.parameters["slack"] == pytest.approx(0.25, rel=0.1)


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
