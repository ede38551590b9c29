"""The protocols: exact lengths, limits kept, the patterns their names promise, and true contact."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from comparisons.protocols import dataset, named
from comparisons.protocols.calibration import payload_pair, plateaus, reversals, static_poses, torque_ramps
from comparisons.protocols.contact import contact_episodes
from comparisons.protocols.excitation import fourier, sinusoid
from comparisons.protocols.paper import (
    CONTINUOUS_FRAMES,
    HYSTERESIS_FRAMES,
    SEGMENT_FRAMES,
    TEST_FRAMES,
    continuous,
    mixed,
    stop_and_go,
)
from comparisons.virtual_robot.motion import Protocol, ReferenceBlock
from comparisons.virtual_robot.robot import VirtualRobot
from comparisons.virtual_robot.scenario import Scenario, load_scenario
from ident.arrays import FloatArray
from ident.errors import InputError
from ident.readers import open_log
from ident.robot import Robot

SHORT = ("continuous", "contact_episodes", "fourier", "mixed", "sinusoid", "stop_and_go")
PATTERNS = ("plateaus", "reversals", "static_poses", "torque_ramps")


def positions(protocol: Protocol) -> FloatArray:
    return np.concatenate([block.q for block in protocol.blocks()])


def test_paper_preset_has_the_papers_figures(vs060: Robot) -> None:
    assert (CONTINUOUS_FRAMES, HYSTERESIS_FRAMES, TEST_FRAMES) == (1_235_247, 1_865_016, 94_490)
    totals = {}
    for name, (protocol, arguments) in dataset.PRESETS["paper"].items():
        motion = named(protocol)(vs060, **arguments)
        assert motion.rate == 100.0
        totals[name] = sum(len(block.q) for block in motion.blocks())
    assert totals == {"continuous": 1_235_247, "hysteresis": 1_865_016, "test": 94_490}


def test_test_set_is_40_percent_continuous(vs060: Robot) -> None:
    q = positions(mixed(vs060, frames=TEST_FRAMES, seed=3))
    first = round(0.4 * TEST_FRAMES)
    np.testing.assert_array_equal(q[:first], positions(continuous(vs060, frames=first, seed=3)))
    np.testing.assert_array_equal(q[first:], positions(stop_and_go(vs060, frames=TEST_FRAMES - first, seed=3)))
    segments = [block.segment for block in mixed(vs060, frames=TEST_FRAMES).blocks()]
    assert segments == sorted(segments)
    assert set(segments) == {0, 1}


@pytest.mark.parametrize("name", SHORT + PATTERNS)
def test_motion_keeps_the_limits_and_starts_at_rest(vs060: Robot, name: str) -> None:
    blocks = list(named(name)(vs060, seconds=120.0, seed=5).blocks())
    for segment in {block.segment for block in blocks}:
        q = np.concatenate([block.q for block in blocks if block.segment == segment])
        speed, acceleration = np.diff(q, axis=0) * 100.0, np.diff(q, 2, axis=0) * 1e4
        assert np.all(q > vs060.limits.lower)
        assert np.all(q < vs060.limits.upper)
        assert np.all(np.abs(speed) < vs060.limits.velocity)
        assert np.all(np.abs(acceleration) < vs060.limits.acceleration)
        assert np.abs(speed[0]).max() < 0.02
        assert np.ptp(q, axis=0).min() > 0.01


@pytest.mark.parametrize("name", SHORT)
def test_length_is_exact_and_the_seed_decides(vs060: Robot, name: str) -> None:
    once, again, other = (positions(named(name)(vs060, seconds=40.0, seed=seed)) for seed in (1, 1, 2))
    assert len(once) == 4000
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(once, other)


def test_stop_and_go_pauses_3_s_after_every_3_s(vs060: Robot) -> None:
    q = positions(stop_and_go(vs060, frames=SEGMENT_FRAMES, seed=1))
    speed = np.abs(np.diff(q, axis=0)).max(axis=1) * 100.0
    still = np.concatenate([[False], speed < 1e-9, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    pauses, runs = edges[1::2] - edges[::2], edges[2::2] - edges[1:-1:2]
    assert np.all((pauses[1:-1] >= 275) & (pauses[1:-1] <= 300))
    assert np.all((runs >= 300) & (runs <= 330))
    moving = speed > 0.02
    alone = (np.abs(np.diff(q, axis=0)) * 100.0 < 1e-9).any(axis=1) & moving
    assert alone.mean() > 0.1


def test_continuous_motion_does_not_stop(vs060: Robot) -> None:
    q = positions(continuous(vs060, frames=20_000, seed=1))[1000:]
    speed = np.abs(np.diff(q, axis=0)) * 100.0
    assert speed.max(axis=1).min() > 0.02
    assert np.all((speed < 1e-4).mean(axis=0) < 0.01)


def test_plateaus_run_both_ways_at_their_speeds(vs060: Robot) -> None:
    q = positions(plateaus(vs060, seconds=60.0, speeds=(0.05, 0.2), joints=(2, 5)))
    speed = np.diff(q, axis=0) * 100.0
    for joint in (1, 4):
        for wanted in (0.05, 0.2, -0.05, -0.2):
            assert np.sum(np.abs(speed[:, joint] - wanted) < 1e-9) > 100
    assert np.ptp(q[:, [0, 2, 3, 5]], axis=0).max() < 1e-12


def test_poses_are_met_from_both_sides_and_reversals_are_small(vs060: Robot) -> None:
    for motion in (static_poses(vs060, seconds=20.0, seed=4), reversals(vs060, seconds=20.0, seed=4)):
        q = positions(motion)
        speed = np.diff(q[:, 0]) * 100.0
        moving = np.abs(speed) > 1e-9
        stops = np.flatnonzero(moving[:-1] & ~moving[1:])
        signs = {bool(s > 0) for s in speed[stops - 3]}
        assert signs == {True, False}
    amplitude = np.abs(np.diff(q[stops + 1, 0]))
    assert np.sum((amplitude > 2e-4) & (amplitude < 4e-4)) >= 2


def test_torque_ramps_break_every_joint_away(vs060: Robot) -> None:
    virtual = VirtualRobot(vs060, load_scenario("vs060").without("sensors"))
    log = virtual.record(torque_ramps(vs060, seconds=10.0, seed=1), derivatives=True)
    assert log.dq is not None
    creeping = (np.abs(log.dq - 0.0015) < 3e-4) | (np.abs(log.dq + 0.0015) < 3e-4)
    for joint in range(6):
        rows = creeping[:, joint]
        static = virtual.laws.friction.static[joint] / virtual.laws.gain[joint]
        assert np.ptp(log.current[rows, joint]) > 1.5 * static


@pytest.mark.parametrize("make", [sinusoid, fourier])
def test_excitation_rests_at_both_ends(vs060: Robot, make: type) -> None:
    q = positions(make(vs060, seconds=20.0, seed=9))
    np.testing.assert_allclose(q[:90], np.tile(q[0], (90, 1)), atol=1e-12)
    np.testing.assert_allclose(q[-90:], np.tile(q[-1], (90, 1)), atol=1e-12)


def test_contact_log_holds_the_true_torque_and_wrench(vs060: Robot) -> None:
    quiet = Scenario.model_validate({"motors": {"gain": 1.0}})
    virtual = VirtualRobot(vs060, quiet)
    motion = contact_episodes(vs060, seconds=60.0, seed=2, tool_share=0.5)
    pushed = virtual.record(motion)
    free = virtual.record(Protocol("free", 100.0, motion.frames, lambda: map(no_push, motion.blocks())))
    assert pushed.tau_ext is not None
    assert pushed.wrench is not None
    assert free.tau_ext is None
    np.testing.assert_allclose(free.current - pushed.current, pushed.tau_ext, atol=1e-9)
    assert 0.1 < (np.abs(pushed.tau_ext).max(axis=1) > 0.0).mean() < 0.9
    at_tool = np.flatnonzero(np.abs(pushed.wrench[:, :3]).max(axis=1) > 1.0)
    for row in at_tool[::50]:
        jacobian = vs060.multibody.frame_jacobian(pushed.q[row])
        np.testing.assert_allclose(jacobian.T @ pushed.wrench[row], pushed.tau_ext[row], atol=1e-9)
    times = [(p.start, p.start + p.duration) for p in next(iter(motion.blocks())).pushes]
    assert all(0.5 <= stop - start <= 10.0 for start, stop in times)
    assert all(before[1] <= after[0] for before, after in itertools.pairwise(times))


def no_push(block: ReferenceBlock) -> ReferenceBlock:
    return ReferenceBlock(block.q, block.segment)


def test_payload_pair_differs_by_the_load_alone(vs060: Robot) -> None:
    virtual = VirtualRobot(vs060, Scenario.model_validate({"motors": {"gain": 1.0}}))
    empty, loaded = payload_pair(virtual, sinusoid(vs060, seconds=10.0), mass=2.0, com=(0.0, 0.0, 0.1))
    np.testing.assert_array_equal(empty.q, loaded.q)
    row = 0
    jacobian = vs060.multibody.frame_jacobian(empty.q[row], vs060.joints[-1])
    turn, _ = vs060.multibody.frame_pose(empty.q[row], vs060.joints[-1])
    weight = np.array([0.0, 0.0, -2.0 * 9.81])
    wrench = np.concatenate([weight, np.cross(turn @ [0.0, 0.0, 0.1], weight)])
    np.testing.assert_allclose(loaded.current[row] - empty.current[row], -jacobian.T @ wrench, atol=1e-9)


def test_generate_writes_what_can_be_read_again(vs060: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        dataset.PRESETS, "tiny", {"test": ("mixed", {"frames": 1000}), "go": ("stop_and_go", {"frames": 500})}
    )
    told: list[tuple[str, float]] = []
    files = dataset.generate(VirtualRobot(vs060), "tiny", tmp_path, seed=1, progress=lambda *step: told.append(step))
    assert [file.name for file in files] == ["test_000.parquet", "test_001.parquet", "go_000.parquet"]
    assert told[-1] == ("go", 1.0)
    logs = [open_log(file, vs060).read() for file in files]
    assert [len(log) for log in logs] == [400, 600, 500]
    again = VirtualRobot(vs060).record(stop_and_go(vs060, seed=2, frames=500), seed=2)
    np.testing.assert_array_equal(logs[2].current, again.current)
    with pytest.raises(InputError, match="no preset 'huge'"):
        dataset.generate(VirtualRobot(vs060), "huge", tmp_path)
    with pytest.raises(InputError, match="no protocol 'waltz'"):
        named("waltz")
