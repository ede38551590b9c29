"""Walking a log in blocks: the derivatives of the whole, segments apart, bounded and thinned collections."""

import numpy as np
import pytest

from ident.log import JointLog, concatenate
from ident.signals import derive
from ident.walk import EDGE_PERIODS, collect, thin, walk

CUTOFF = 5.0


@pytest.fixture(scope="module")
def log(swinging):
    motion = swinging(40.0)
    noise = 1e-5 * np.random.default_rng(0).normal(size=motion.q.shape)
    return JointLog(motion.t, motion.q + noise, np.zeros_like(motion.q))


def joined(blocks, name):
    return np.concatenate([getattr(block.motion, name) for block in blocks])


@pytest.mark.parametrize("rows", [50, 400, 1777, 3999])
@pytest.mark.parametrize("reports_velocity", [False, True])
def test_blocks_derive_what_the_whole_log_does(log, rows, reports_velocity):
    if reports_velocity:
        log = log.replace(dq=derive(log, 20.0).dq)
    whole = derive(log, CUTOFF)
    blocks = list(walk(log, CUTOFF, rows))
    assert len(blocks) > 1
    np.testing.assert_array_equal(np.concatenate([b.log.t for b in blocks]), log.t)
    for name in ("q", "dq", "ddq"):
        expected = getattr(whole, name)
        np.testing.assert_allclose(joined(blocks, name), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    assert [b.first for b in blocks] == [True] + [False] * (len(blocks) - 1)


def test_only_the_ends_of_a_segment_are_not_kept(log):
    keep = np.concatenate([b.keep for b in walk(log, CUTOFF, 700)])
    edge = EDGE_PERIODS / CUTOFF
    inside = (log.t >= log.t[0] + edge) & (log.t <= log.t[-1] - edge)
    np.testing.assert_array_equal(keep, inside)


@pytest.mark.parametrize("rows", [300, 100_000])
def test_segments_are_apart(log, rows):
    cut = 1500
    both = concatenate([log[:cut], log[cut:]])
    blocks = list(walk(both, CUTOFF, rows))
    assert sum(b.first for b in blocks) == 2
    parts = [derive(log[:cut], CUTOFF).ddq, derive(log[cut:], CUTOFF).ddq]
    np.testing.assert_allclose(joined(blocks, "ddq"), np.concatenate(parts), rtol=0, atol=1e-8)
    for block in blocks:
        assert len(set(block.log.segment)) == 1


@pytest.mark.parametrize("length", [1, 2, 5, 19])
@pytest.mark.parametrize("place", ["before", "between", "after"])
def test_a_segment_too_short_to_filter_is_passed_over(log, length, place):
    short = log[:length]
    parts = {"before": [short, log], "between": [log, short, log], "after": [log, short]}[place]
    blocks = list(walk(concatenate(parts), CUTOFF, 900))
    assert sum(len(b.log) for b in blocks) == sum(map(len, parts))
    for block in blocks:
        if len(block.log) == length:
            assert not block.keep.any()
            assert np.isnan(block.motion.ddq).all()
    assert sum(int(b.keep.sum()) for b in blocks) > 0.9 * len(log)


@pytest.mark.parametrize("rows", [1, 2, 20])
def test_blocks_may_be_smaller_than_the_filter_needs(log, rows):
    log = log[:600]
    expected = derive(log, CUTOFF).ddq
    got = joined(list(walk(log, CUTOFF, rows)), "ddq")
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_jittering_stamps_block_by_block(log):
    t = log.t + 1e-3 * np.random.default_rng(5).uniform(-1, 1, len(log.t))
    jittered = log.replace(t=t)
    whole = derive(jittered, CUTOFF)
    got = joined(list(walk(jittered, CUTOFF, 900)), "ddq")
    # Each block has a uniform grid of its own between the stamps.
    away = slice(50, -50)
    scale = np.abs(whole.ddq).max()
    np.testing.assert_allclose(got[away], whole.ddq[away], rtol=0, atol=2e-2 * scale)


def test_collect_spreads_what_it_holds_over_all_logs(swinging):
    motion = swinging(3000.0)
    long = JointLog(motion.t, motion.q, np.zeros_like(motion.q))
    everything = collect([long[:2000]], CUTOFF)
    assert sum(len(b.keep) for b in everything) == 2000
    held = collect([long, long.replace(name="other")], CUTOFF, limit=60_000)
    rows = sum(len(b.keep) for b in held)
    assert 60_000 <= rows <= 2 * 60_000 + 16384
    assert {b.log.name for b in held} == {"log", "other"}
    assert all(b.first for b in held)
    begun = next(b for b in held if b.log.t[0] > 0.0)
    assert not begun.keep[: len(begun.keep) // 10].any()


def test_collect_holds_segments_whole_so_that_memories_last(swinging):
    motion = swinging(400.0)
    long = JointLog(motion.t, motion.q, np.zeros_like(motion.q), segment=(motion.t >= 300.0).astype(int))
    assert len(list(walk(long, CUTOFF))) > 2
    held = collect([long], CUTOFF)
    assert [int(b.log.segment[0]) for b in held] == [0, 1]
    whole = derive(long[: len(held[0].log)], CUTOFF)
    settled = held[0].keep
    assert settled.mean() > 0.99
    scale = np.abs(whole.ddq).max()
    np.testing.assert_allclose(held[0].motion.ddq[settled], whole.ddq[settled], rtol=0, atol=1e-8 * scale)


def test_thin_keeps_every_kth_row(log):
    blocks = list(walk(log, CUTOFF, 1000))
    few = thin(blocks, 500)
    assert 0.4 * 500 < sum(int(b.keep.sum()) for b in few) <= 500 * 1.05
    assert all(not (f.keep & ~b.keep).any() for f, b in zip(few, blocks, strict=True))
    assert thin(blocks, 10**6) == blocks


def test_rows_that_came_late_are_not_learnt_from(log):
    q = log.q.copy()
    q[1000] = q[999]
    late = log.replace(
        q=q, current=np.where(np.arange(len(log)) == 1000, 999, np.arange(len(log)))[:, None] * np.ones(6)
    )
    keep, before = (np.concatenate([b.keep for b in walk(one, CUTOFF, 700)]) for one in (late, log))
    np.testing.assert_array_equal(np.flatnonzero(keep != before), [1000])
