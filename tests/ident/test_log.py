"""Logs in memory and what is cut out of them."""

import numpy as np
import pytest

from ident.log import JointLog, WithoutStretches


@pytest.mark.parametrize("rows", [1, 3, 100])
def test_what_is_left_around_a_cut_are_segments_of_their_own(rows):
    t = np.array([0.0, 1, 2, 3, 4, 5, 0, 1, 2, 3])
    log = JointLog(t=t, q=t[:, None], current=t[:, None], segment=np.repeat([4, 7], [6, 4]), name="one")
    cut = WithoutStretches(log, ((4, 1.5, 3.0), (7, 2.0, 9.0), (5, 0.0, 9.0)))
    pieces = list(cut.blocks(rows))
    assert max(len(piece) for piece in pieces) <= rows
    assert cut.name == "one"
    for seen_t, seen_segment in (
        (np.concatenate([p.t for p in pieces]), np.concatenate([p.segment for p in pieces])),
        (cut.read().t, cut.read().segment),
    ):
        assert seen_t.tolist() == [0, 1, 4, 5, 0, 1]
        assert seen_segment.tolist() == [0, 0, 1, 1, 2, 2]
