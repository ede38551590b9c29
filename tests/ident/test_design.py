"""Which column belongs to which joint and term, and that memories run on from block to block."""

from dataclasses import replace

import numpy as np
import pytest

from ident.design import Design
from ident.effects.base import initial_term
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb
from ident.effects.friction_curve import Stribeck
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links, RotorInertia
from ident.walk import walk

CUTOFF = 10.0
EFFECTS = (MaxwellSlip(4), Links(None), Coulomb(1), RotorInertia(4), Stribeck(1), CurrentOffset(0))


@pytest.fixture(scope="module")
def design(vs060):
    return Design(vs060, tuple(initial_term(e) for e in EFFECTS), np.full(6, 2.0))


def test_columns_are_numbered_shared_first_then_joint_by_joint(design):
    links = len(Links(None).base(design.robot).names)
    assert design.count == links + 1 + 1 + 1 + 3 + 1
    np.testing.assert_array_equal(design.columns_of_term(1), np.arange(links))
    np.testing.assert_array_equal(design.columns_of_joint(3), np.arange(links))
    np.testing.assert_array_equal(design.columns_of_joint(1), [*range(links), links + 1, links + 2])
    assert [design.columns_of_term(k)[0] for k in (5, 2, 4, 0, 3)] == [links + k for k in (0, 1, 2, 3, 6)]
    every = np.concatenate([design.columns_of_term(k) for k in range(len(EFFECTS))])
    assert sorted(every) == list(range(design.count))
    for number, (term, coefficient) in enumerate(design.coefficients()):
        assert number in design.columns_of_term(term)
        assert coefficient in design.terms[term].effect.coefficients(design.robot)


def test_matrix_columns_stand_where_the_numbers_say(design, vs060, recorded):
    block = next(walk(recorded(10.0), CUTOFF))
    context, keep = design.context(block.motion), block.keep & (np.arange(len(block.log)) % 5 == 0)
    seen = design.seen(replace(block, keep=keep))
    for joint in range(6):
        matrix = design.matrix(seen, design.start(), joint)
        numbers = design.columns_of_joint(joint)
        assert matrix.shape == (keep.sum(), len(numbers))
        for k, term in enumerate(design.terms):
            if term.effect.joint in (None, joint):
                place = np.isin(numbers, design.columns_of_term(k))
                expected = term.effect.row(context, term.shape, term.effect.start(), joint)
                np.testing.assert_array_equal(matrix[:, place], expected[keep])


def test_rows_block_by_block_are_those_of_the_whole(design, recorded):
    log = recorded(20.0)
    (whole,) = design.rows(walk(log, CUTOFF, 10**6))
    pieces = list(design.rows(walk(log, CUTOFF, 300)))
    for j in range(6):
        got = np.concatenate([p.matrices[j] for p in pieces])
        np.testing.assert_allclose(got, whole.matrices[j], rtol=0, atol=1e-6)
    target = np.concatenate([p.target for p in pieces])
    np.testing.assert_array_equal(target, whole.target)
    kept = np.concatenate([b.log.current[b.keep] for b in walk(log, CUTOFF)])
    np.testing.assert_array_equal(whole.target, 2.0 * kept)


def test_a_block_of_which_nothing_is_kept_is_remembered(design, recorded):
    log = recorded(20.0)
    blocks = list(walk(log, CUTOFF, 300))
    blank = replace(blocks[1], keep=np.zeros_like(blocks[1].keep))
    rows, expected = (list(design.rows([blocks[0], one, blocks[2]])) for one in (blank, blocks[1]))
    for j in range(6):
        assert rows[1].matrices[j].shape == (0, len(design.columns_of_joint(j)))
        np.testing.assert_array_equal(rows[2].matrices[j], expected[2].matrices[j])
