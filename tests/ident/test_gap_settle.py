"""Which of the names that logs cannot tell apart comes first."""

from dataclasses import replace

import numpy as np
from planar_arm import structure

from ident.effects.attached import GravityBalancer
from ident.effects.rigid_body import CableSpring
from ident.effects.timing import Delay
from ident.gap.candidates import Trial
from ident.gap.joint_gap import Named
from ident.gap.settle import plainest


def test_of_springs_alike_the_one_with_fewest_parameters_comes_first():
    balancer = Trial(GravityBalancer(1), np.array([0.5, 0.1]), 3.0, columns=2)
    hose = Trial(CableSpring(1), np.array([0.2]), 2.99, columns=2)
    delay = Trial(Delay(1), np.array([0.01]), 2.98)
    one = Named(balancer, 1e-6, 3.0)
    first, others = plainest(one, {"delay": delay, "cable-spring": hose})
    assert first.trial is hose
    assert others == {"gravity-balancer": balancer, "delay": delay}
    for rivals in ({"delay": delay}, {"cogging": None}, {}):
        assert plainest(one, rivals) == (one, rivals)
    other = replace(one, trial=hose)
    assert plainest(other, {"gravity-balancer": balancer}) == (other, {"gravity-balancer": balancer})


def test_a_hose_that_hangs_slack_about_its_middle_is_a_spring(arm):
    found = structure(arm, hidden=lambda t, q, dq: 0.8 * np.sign(q[:, 1]) * np.maximum(np.abs(q[:, 1]) - 0.25, 0.0))
    (one,) = found.findings
    assert (one.effect, one.joints) == ("cable-spring", (1,))
