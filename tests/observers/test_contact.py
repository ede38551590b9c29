"""Thresholds keep the rate of false alarms asked for; contacts are found, sized and placed."""

import numpy as np
import pytest
import scipy.signal

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.robot import Robot
from ident.signals import Motion
from observers.contact import ContactDetector, Level
from observers.cusum import Cusum, alarms
from observers.residual import Residual
from observers.sensitivity import smallest_detectable
from observers.thresholds import Threshold, fit_threshold

RATE = 100.0
N = 3


def coloured(hours: float, seed: int, scale: FloatArray | float = 1.0) -> Residual:
    """Residual of unit deviation whose noise is correlated over some tenths of a second."""
    rows = int(hours * 3600 * RATE)
    white = np.random.default_rng(seed).standard_normal((rows, N))
    noise = scipy.signal.lfilter([1.0], [1.0, -0.9], white, axis=0) * np.sqrt(1.0 - 0.81) * scale
    flags = np.zeros(rows, dtype=np.int64)
    return Residual(np.arange(rows) / RATE, noise, None, flags, flags, "A")


def pushed(residual: Residual, joints: FloatArray, rows: slice) -> Residual:
    current = residual.current.copy()
    current[rows] += joints
    return Residual(residual.t, current, None, residual.flags, residual.segment, residual.unit)


@pytest.mark.parametrize("per_hour", [3.0, 20.0])
def test_false_alarms_come_at_the_rate_asked_for(per_hour: float) -> None:
    threshold = fit_threshold([coloured(1.0, 1)], per_hour)
    fresh = coloured(2.0, 2)
    episodes = ContactDetector(threshold).run(fresh).episodes(apart=1.0)
    assert 0.3 * per_hour < len(episodes) / 2.0 < 2.5 * per_hour


def test_level_rarer_than_the_log_is_above_all_it_showed() -> None:
    quiet = coloured(0.05, 3)
    threshold = fit_threshold([quiet], 0.01)
    assert np.all(threshold.constant >= np.abs(quiet.current).max(axis=0))
    assert np.all(threshold.constant < 8.0)


def test_threshold_that_follows_motion_is_lower_at_rest() -> None:
    rows = int(0.5 * 3600 * RATE)
    t = np.arange(rows) / RATE
    speed = np.maximum(np.sin(0.3 * t), 0.0)[:, None] * np.ones(N)
    motion = Motion(t, speed, speed, np.zeros_like(speed))
    residual = coloured(0.5, 4, 0.2 + speed)
    constant, moving = fit_threshold([residual], 2.0), fit_threshold([residual], 2.0, [motion])
    assert moving.moves
    assert not constant.moves
    rest, fast = moving.at(np.zeros(N), np.zeros(N)), moving.at(np.ones(N), np.zeros(N))
    assert np.all(rest < 0.5 * constant.constant)
    assert np.all(fast > 2.0 * rest)
    alarms = ContactDetector(moving).run(coloured(0.5, 5, 0.2 + speed), motion).episodes(1.0)
    assert len(alarms) <= 6


def test_contact_collision_and_link() -> None:
    residual = pushed(coloured(0.01, 6, 0.1), np.array([2.0, -2.0, 0.0]), slice(500, 700))
    residual = pushed(residual, np.array([5.0, 0.0, 8.0]), slice(1500, 1600))
    residual = pushed(residual, np.array([2.0, 0.0, 0.0]), slice(2500, 2700))
    detector = ContactDetector(Threshold.fixed(np.ones(N)))
    episodes = detector.run(residual).episodes()
    assert [(e.level, e.link) for e in episodes] == [(Level.CONTACT, 2), (Level.COLLISION, 3), (Level.CONTACT, 1)]
    # a push on a link behind, without a lever about the joints in between, does the same
    assert [e.links for e in episodes] == [(2, 3), (3,), (1, 2, 3)]
    assert abs(episodes[0].start - 5.0) < 0.02
    assert abs(episodes[0].end - 7.0) < 0.05


def test_detector_steps_as_it_runs() -> None:
    residual = pushed(coloured(0.01, 7), np.array([3.0, 0.0, 0.0]), slice(500, 700))
    detector = ContactDetector(Threshold.fixed(np.full(N, 2.0)), Threshold.fixed(np.full(N, 3.0)))
    whole = detector.run(residual)
    detector.reset()
    stepped = [detector.step(row) for row in residual.current]
    assert [s[0] for s in stepped] == whole.level.tolist()
    assert [s[1] for s in stepped] == whole.link.tolist()


def test_cusum_finds_a_long_push_below_the_threshold() -> None:
    quiet = coloured(1.0, 8)
    threshold, cusum = fit_threshold([quiet], 1.0), Cusum.fit([quiet], 1.0)
    fresh = coloured(0.5, 9)
    assert np.sum(np.diff((cusum.run(fresh) > 1.0).any(axis=1).astype(int)) > 0) <= 3
    weak = 0.6 * threshold.constant * np.array([1.0, 0.0, 0.0])
    felt = pushed(fresh, weak, slice(1000, 1500))
    assert (cusum.run(felt)[1000:1500, 0] > 1.0).any()
    assert ContactDetector(threshold).run(felt).level[1000:1500].mean() < 0.2


def test_cusum_steps_as_it_runs() -> None:
    residual = pushed(coloured(0.01, 10), np.array([3.0, 0.0, -2.0]), slice(500, 700))
    cusum = Cusum(np.full(N, 1.0), np.full(N, 0.5))
    whole = cusum.run(residual)
    cusum.reset()
    steps = np.diff(residual.t, prepend=0.0)
    stepped = [cusum.step(row, float(dt)) for row, dt in zip(residual.current, steps, strict=True)]
    np.testing.assert_allclose(stepped, whole, atol=1e-12)


def test_alarms_say_when_and_which_joints() -> None:
    residual = pushed(coloured(0.01, 11, 0.1), np.array([2.0, 0.0, -2.0]), slice(1000, 1200))
    residual = pushed(residual, np.array([0.0, 2.0, 0.0]), slice(2500, 2600))
    sums = Cusum(np.full(N, 0.5), np.full(N, 0.5)).run(residual)
    first, second = alarms(residual.t, sums)
    assert (first.joints, second.joints) == ((1, 3), (2,))
    # 1.5 over the allowance takes a third of a second to the limit, and twice the limit 1 s to fall back to it
    assert abs(first.start - 10.33) < 0.1
    assert abs(first.end - 13.0) < 0.3
    assert abs(second.start - 25.33) < 0.1
    assert alarms(residual.t, np.minimum(sums, 1.0)) == []


def test_a_force_along_the_last_axis_looks_like_one_nearer_to_the_base(vs060: Robot) -> None:
    q = np.array([0.2, 0.4, 1.0, 0.3, 0.5, 0.1])
    rotation, jacobian = vs060.multibody.frame_pose(q)[0], vs060.multibody.frame_jacobian(q)[:3]
    torque = jacobian.T @ (20.0 * rotation[:, 2])
    quiet = Residual(
        np.arange(300) / RATE, np.zeros((300, 6)), None, np.zeros(300, dtype=int), np.zeros(300, dtype=int), "N m"
    )
    (episode,) = (
        ContactDetector(Threshold.fixed(np.full(6, 0.5))).run(pushed(quiet, torque, slice(100, 200))).episodes()
    )
    assert episode.link < 6
    assert 6 in episode.links


def test_too_little_is_refused() -> None:
    with pytest.raises(InputError, match="above 0"):
        fit_threshold([coloured(0.1, 1)], 0.0)
    with pytest.raises(InputError, match="too few"):
        fit_threshold([coloured(0.001, 1)], 1.0)
    with pytest.raises(InputError, match="too few"):
        Cusum.fit([coloured(0.001, 1)], 1.0)


def test_smallest_contact_at_a_pose(vs060: Robot, rng: np.random.Generator) -> None:
    q, level, gain = np.array([0.2, 0.4, 1.0, 0.3, 0.5, 0.1]), np.full(6, 5.0), np.linspace(0.8, 0.1, 6)
    found = smallest_detectable(vs060, q, level, gain)
    np.testing.assert_allclose(found.torque, level * gain)
    jacobian = vs060.multibody.frame_jacobian(q)[:3]

    def seen(force: FloatArray) -> bool:
        return bool(np.any(np.abs(jacobian.T @ force) >= found.torque))

    for axis in range(3):
        unit = np.eye(3)[axis]
        assert seen(1.001 * found.along_axes[axis] * unit)
        assert not seen(0.999 * found.along_axes[axis] * unit)
    for direction in rng.standard_normal((200, 3)):
        unit = direction / np.linalg.norm(direction)
        assert seen(1.03 * found.worst * unit)
        assert not seen(0.97 * found.best * unit)
    with pytest.raises(InputError, match="gains are unknown"):
        smallest_detectable(vs060, q, level)


def test_force_across_the_plane_is_never_seen(two_link: Robot) -> None:
    found = smallest_detectable(two_link, np.array([0.3, 0.5]), np.ones(2))
    assert found.along_axes[2] == np.inf
    assert np.isfinite(found.along_axes[:2]).all()
