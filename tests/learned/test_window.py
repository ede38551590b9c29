import numpy as np
import pytest

from ident.errors import InputError
from ident.log import JointLog
from learned.window import Moments, complete, decimation, frames_of, pad, windows


def log_at(rate, rows=400, n=2):
    t = np.arange(rows) / rate
    q = np.sin(t[:, None] * (1.0 + np.arange(n)))
    segment = (np.arange(rows) >= rows // 2).astype(np.int64)
    return JointLog(t, q, q.copy(), segment=segment)


def test_windows_show_the_last_frames_of_each_segment_without_copying():
    values = np.arange(24.0, dtype=np.float32).reshape(12, 2)
    segments = [slice(0, 5), slice(5, 12)]
    padded, place = pad(values, segments, np.ones(12, dtype=bool), 3)
    padded = padded.astype(np.float32)
    shown = windows(padded, 3)
    assert np.shares_memory(shown, padded)
    for segment in segments:
        for k in range(segment.start, segment.stop):
            past = np.maximum(np.arange(k - 2, k + 1), segment.start)
            np.testing.assert_array_equal(shown[place[k] - 2], values[past].ravel())


def test_unknown_rows_spoil_their_window_only():
    values = np.ones((10, 1))
    finite = np.ones(10, dtype=bool)
    finite[[0, 1, 6]] = False
    whole = complete(finite, [slice(0, 10)], 3)
    np.testing.assert_array_equal(np.flatnonzero(~whole), [0, 1, 6, 7, 8])
    values[[0, 1]] = np.nan
    padded, _ = pad(values, [slice(0, 10)], finite, 3)
    assert np.isfinite(padded).all()


def test_moments_of_blocks_are_those_of_the_whole():
    x = np.random.default_rng(0).normal(5.0, 2.0, size=(1000, 3))
    x[:, 2] = 4.0
    moments = Moments(3)
    for block in np.array_split(x, 7):
        moments.add(block)
    np.testing.assert_allclose(moments.mean, x.mean(axis=0))
    np.testing.assert_allclose(moments.deviation, x.std(axis=0), atol=1e-12)
    scaled = moments.scaling().apply(x)
    np.testing.assert_allclose(scaled.std(axis=0), [1.0, 1.0, 0.0], atol=1e-5)


def test_a_whole_multiple_of_the_rate_is_thinned_after_filtering():
    log = log_at(500.0, rows=1001)
    frames = frames_of(log, 100.0, 20.0)
    assert [s.stop - s.start for s in frames.segments] == [100, 101]
    np.testing.assert_array_equal(frames.rows[:3], [0, 5, 10])
    whole = frames_of(log, 500.0, 20.0)
    np.testing.assert_array_equal(frames.motion.dq, whole.motion.dq[frames.rows])


def test_another_rate_is_refused():
    with pytest.raises(InputError, match="125 Hz where the model is for 100 Hz"):
        decimation(log_at(125.0), 100.0)
    with pytest.raises(InputError, match="resample"):
        decimation(log_at(50.0), 100.0)
