import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.errors import InputError
from learned.motion_discriminator import TABLE_I, DiscriminatorSpec, MotionDiscriminator, known_history

SPECS = [
    DiscriminatorSpec(tuple(sum(TABLE_I, ()))),
    DiscriminatorSpec((0.003, 0.01), hold="threshold"),
    DiscriminatorSpec((0.003, 0.01), signal="median-velocity"),
    DiscriminatorSpec((0.003, 0.01), signal="median-velocity", hold="threshold"),
    DiscriminatorSpec((0.0005, 0.01), signal="displacement"),
    DiscriminatorSpec((0.0005, 0.01), signal="displacement-and-travel"),
    DiscriminatorSpec(((0.003, 0.02), (0.01, 0.03))),
]


def algorithm_1(dq, thresholds):
    """The paper's loop, word for word."""
    md = np.zeros((len(thresholds), dq.shape[1]))
    out = []
    for row in dq:
        for i, t in enumerate(thresholds):
            for k in range(len(row)):
                if abs(row[k]) >= t:
                    md[i, k] = row[k]
        out.append(md.copy())
    return np.array(out)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_velocity_is_algorithm_1(seed, rows):
    rng = np.random.default_rng(seed)
    dq = rng.normal(scale=0.01, size=(rows, 3)) * (rng.random((rows, 3)) < 0.5)
    spec = DiscriminatorSpec(TABLE_I[0])
    held = MotionDiscriminator(spec, 3).run(np.zeros_like(dq), dq, [slice(0, rows)])
    np.testing.assert_array_equal(held, algorithm_1(dq, TABLE_I[0]))


@pytest.mark.parametrize("spec", SPECS)
def test_step_equals_run_to_the_bit(spec):
    rng = np.random.default_rng(3)
    q = np.cumsum(rng.normal(scale=1e-3, size=(300, 2)), axis=0)
    dq = rng.normal(scale=0.01, size=(300, 2))
    q[100], dq[100] = np.nan, np.nan
    segments = [slice(0, 120), slice(120, 300)]
    held = MotionDiscriminator(spec, 2).run(q, dq, segments)
    online = MotionDiscriminator(spec, 2)
    for rows in segments:
        online.reset()
        for k in range(rows.start, rows.stop):
            np.testing.assert_array_equal(online.step(q[k], dq[k]), held[k])
    assert np.isfinite(held).all()


@pytest.mark.parametrize("spec", SPECS)
def test_zero_before_the_first_motion_and_after_each_start(spec):
    q = np.zeros((30, 2))
    q[5:15] = 0.1
    dq = np.zeros((30, 2))
    dq[5:15] = 0.1
    held = MotionDiscriminator(spec, 2).run(q, dq, [slice(0, 20), slice(20, 30)])
    assert (held[:5] == 0.0).all()
    assert (held[19] != 0.0).all()
    assert (held[20:] == 0.0).all()


def test_displacement_is_a_play_operator():
    q = np.array([[0.0], [0.002], [0.02], [0.019], [0.0185], [0.0]])
    held = MotionDiscriminator(DiscriminatorSpec((0.005,), "displacement"), 1).run(q, q * 0.0, [slice(0, 6)])
    np.testing.assert_allclose(held[:, 0, 0], [0.0, 0.002, 0.005, 0.004, 0.0035, -0.005], atol=1e-15)


def test_travel_is_the_way_of_others_since_a_joint_stopped():
    # joint 1 moves and stops; then joint 2 goes 0.3 rad there and 0.15 back; then joint 1 moves again
    first = np.r_[np.linspace(0.0, 1.0, 11), np.full(45, 1.0), 1.1]
    second = np.r_[np.zeros(11), np.linspace(0.01, 0.3, 30), np.linspace(0.29, 0.15, 15), 0.15]
    q = np.stack([first, second], axis=1)
    spec = DiscriminatorSpec((0.001, 0.002), "displacement-and-travel")
    held = MotionDiscriminator(spec, 2).run(q, q * 0.0, [slice(0, len(q))])
    assert held.shape == (57, 4, 2)
    assert (held[0, 2:] == 0.0).all()  # nobody knows how long joints have stood before they first move
    np.testing.assert_allclose(held[[10, 40, 55, 56], 3, 0], np.exp([0.0, -1.0, -1.5, 0.0]), rtol=1e-9)
    np.testing.assert_allclose(held[[10, 40, 55, 56], 2, 1], [0.0, 1.0, 1.0, np.exp(-0.1 / 0.3)], rtol=1e-5)
    # the play operators are those without travel
    plain = MotionDiscriminator(DiscriminatorSpec(spec.thresholds, "displacement"), 2).run(q, q * 0.0, [slice(0, 57)])
    np.testing.assert_array_equal(held[:, :2], plain)


def test_trembling_is_no_travel():
    q = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.3]])
    noise = 1e-4 * np.random.default_rng(0).normal(size=(1000, 2)).clip(-1.0, 1.0)
    q = np.concatenate([q, q[-1] + noise])
    spec = DiscriminatorSpec((0.0005, 0.01), "displacement-and-travel")
    held = MotionDiscriminator(spec, 2).run(q, q * 0.0, [slice(0, len(q))])
    np.testing.assert_allclose(held[2:, 3, 0], held[2, 3, 0], atol=0.02)


def test_median_keeps_the_sign_through_ringing():
    dq = np.r_[np.zeros(10), np.full(50, 0.2), [-0.05, 0.02, -0.01], np.zeros(40)][:, None]
    run = {}
    for signal in ("velocity", "median-velocity"):
        spec = DiscriminatorSpec((0.008,), signal)
        run[signal] = MotionDiscriminator(spec, 1).run(dq * 0.0, dq, [slice(0, len(dq))])[-1, 0, 0]
    assert run["velocity"] < 0.0 < run["median-velocity"]


def test_threshold_hold_stores_the_signed_threshold():
    dq = np.array([[0.0], [-0.3], [0.001]])
    held = MotionDiscriminator(DiscriminatorSpec((0.01,), hold="threshold"), 1).run(dq, dq, [slice(0, 3)])
    np.testing.assert_array_equal(held[:, 0, 0], [0.0, -0.01, -0.01])


def test_known_history_begins_with_motion():
    q = np.zeros((10, 2))
    q[4:, 0] = 0.01
    known = known_history(q, [slice(0, 6), slice(6, 10)])
    np.testing.assert_array_equal(known[:, 0], [False] * 4 + [True] * 2 + [False] * 4)
    assert not known[:, 1].any()


def test_bad_specs_are_refused():
    with pytest.raises(InputError, match="not positive"):
        DiscriminatorSpec((0.0, 0.1))
    with pytest.raises(InputError, match="2 joints where the robot has 3"):
        MotionDiscriminator(DiscriminatorSpec(((0.1, 0.1),)), 3)
    with pytest.raises(InputError, match="no threshold"):
        DiscriminatorSpec((), "displacement-and-travel")
    with pytest.raises(InputError, match="unknown signal"):
        DiscriminatorSpec((0.1,), "speed")  # type: ignore[arg-type]
