"""Names of springs."""

import numpy as np
import pytest
from planar_arm import structure


def test_a_hose_that_hangs_slack_about_its_middle_is_a_spring(arm):
    found = structure(arm, hidden=lambda t, q, dq: 0.8 * np.sign(q[:, 1]) * np.maximum(np.abs(q[:, 1]) - 0.25, 0.0))
    (one,) = found.findings
    assert (one.effect, one.joints) == ("cable-spring", (1,))
    assert one.parameters["slack"] == pytest.approx(0.25, rel=0.1)
