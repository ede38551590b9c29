"""A compliant arm: the virtual robot led by what an estimator feels, while others look on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from comparisons.virtual_robot.closed_loop import ClosedLoop
from comparisons.virtual_robot.contact import Hand, Push
from comparisons.virtual_robot.robot import VirtualRobot
from ident.arrays import BoolArray, FloatArray
from ident.causal import CausalButterworth
from ident.log import JointLog, Sample
from learned.wrench import WrenchModel
from observers.compliance import JointAdmittance, TaskAdmittance
from observers.residual import ResidualEstimator

POSE = (0.0, 0.3, 1.0, 0.0, 0.4, 0.0)
"""Where the arm stands when it begins [rad]: bent, so that every joint feels a push somewhere."""

STIR, STIR_SPEED = 1.0, 0.3
"""Every joint first moves to and fro for this long [s], at most this fast [rad/s]: it must be known how it stopped."""

READY = 2.0
"""Time [s] from which the arm yields: filters have settled after the stirring."""

CUTOFF = 5.0
"""Low pass on residuals and wrenches [Hz], that of the admittance law."""

CALM = 1.0
"""Time [s] after a release from which the arm should stand still, and its residuals count as untouched."""


def _push(link: int, point: tuple[float, float, float], force: tuple[float, float, float], start: float) -> Push:
    return Push(link, point, force, start, duration=1.6, rise=0.5)


PUSHES = (
    _push(2, (0.0, 0.0, 0.3), (90.0, 0.0, 0.0), 3.0),
    _push(3, (0.0, 0.0, 0.25), (0.0, 60.0, 0.0), 6.5),
    _push(3, (0.0, 0.0, 0.25), (-70.0, 0.0, 0.0), 10.0),
    _push(4, (0.0, 0.08, 0.1), (50.0, 0.0, 0.0), 13.5),
    _push(5, (0.0, 0.0, 0.08), (40.0, 0.0, 0.0), 17.0),
    _push(6, (0.08, 0.0, 0.05), (0.0, 40.0, 0.0), 20.5),
    _push(2, (0.0, 0.0, 0.3), (-90.0, 0.0, 0.0), 24.0),
    _push(6, (0.0, 0.0, 0.05), (0.0, -40.0, 20.0), 24.0),
)
"""Pushes at one link after the other, then at two together."""


@dataclass(frozen=True, eq=False)
class Ride:
    """What happened to a compliant arm.

    Attributes:
        log: samples with the true ``tau_ext`` and ``wrench``.
        felt: what each estimator felt, low-passed: residual currents (N, n) or wrenches (N, 6).
        command: joint velocities commanded, (N, n).
        untouched: rows in which nobody touches the arm, nor did a moment before, (N,).
    """

    log: JointLog
    felt: dict[str, FloatArray]
    command: FloatArray
    untouched: BoolArray


class JointFollower:
    """A controller that stirs the joints, then yields to the residual of one of several estimators.

    Args:
        estimators: by name; all are run.
        leader: name of the one that the law follows.
        law: from residual to joint velocities.
        rate: samples a second [Hz].
    """

    def __init__(
        self, estimators: Mapping[str, ResidualEstimator], leader: str, law: JointAdmittance, rate: float = 100.0
    ) -> None:
        n = len(law.gain)
        self.estimators, self.leader, self.law = estimators, leader, law
        self._filters = {name: CausalButterworth(rate, CUTOFF, order=2, channels=n) for name in estimators}
        self.felt: dict[str, list[FloatArray]] = {name: [] for name in estimators}
        self.command: list[FloatArray] = []
        law.reset()
        for estimator in estimators.values():
            estimator.reset()

    def __call__(self, sample: Sample) -> FloatArray:
        """Return the joint velocities to command after a sample."""
        residuals = {name: estimator.step(sample) for name, estimator in self.estimators.items()}
        for name, residual in residuals.items():
            self.felt[name].append(self._filters[name].step(residual))
        wanted = self.law.step(sample.q, residuals[self.leader])
        command = stirred(sample, wanted)
        self.command.append(command)
        return command


class TaskFollower:
    """A controller that stirs the joints, then leads the tool by the wrench of one of several models; see above."""

    def __init__(
        self, models: Mapping[str, WrenchModel], leader: str, law: TaskAdmittance, rate: float = 100.0
    ) -> None:
        self.models, self.leader, self.law = models, leader, law
        self._filters = {name: CausalButterworth(rate, CUTOFF, order=2, channels=6) for name in models}
        self.felt: dict[str, list[FloatArray]] = {name: [] for name in models}
        self.command: list[FloatArray] = []
        for model in models.values():
            model.reset()

    def __call__(self, sample: Sample) -> FloatArray:
        """Return the joint velocities to command after a sample."""
        for name, model in self.models.items():
            self.felt[name].append(self._filters[name].step(np.nan_to_num(model.step(sample))))
        command = stirred(sample, self.law.step(sample.q, self.felt[self.leader][-1]))
        self.command.append(command)
        return command


def stirred(sample: Sample, wanted: FloatArray) -> FloatArray:
    """Return the command (n,): first to and fro, then rest, then what is wanted."""
    if sample.t < STIR:
        return np.full(len(wanted), STIR_SPEED * np.sin(2.0 * np.pi * sample.t / STIR))
    return wanted if sample.t >= READY else np.zeros(len(wanted))


def ride(
    virtual: VirtualRobot,
    follower: JointFollower | TaskFollower,
    seconds: float,
    disturbances: Sequence[Push | Hand],
    seed: int = 0,
) -> Ride:
    """Let a follower command the virtual robot from `POSE` while it is pushed or led by a hand."""
    loop = ClosedLoop(virtual, np.array(POSE), disturbances=disturbances, seed=seed)
    log = loop.run(follower, seconds)[:-1]  # the last sample is commanded nothing
    assert log.tau_ext is not None
    busy = np.abs(log.tau_ext).max(axis=1) > 0.0
    last = np.maximum.accumulate(np.where(busy, log.t, -np.inf))
    untouched = ~busy & (log.t - last > CALM) & (log.t >= READY)
    felt = {name: np.array(rows) for name, rows in follower.felt.items()}
    return Ride(log, felt, np.array(follower.command), untouched)


def ride_figures(virtual: VirtualRobot, one: Ride, pushes: Sequence[Push]) -> dict[str, Any]:
    """Judge a ride on pushes that do not begin while another lasts; pushes that begin together are one.

    Returns:
        episodes: one a group of pushes: ``links``; ``yielded`` [m], how far each pushed point went along its force;
            ``force_at_start`` [N], the sum of the forces when the arm began to move (None: it did not);
            ``stopped_after`` [s], time from the release to the last command of the pause that follows.
        untouched: ``peak`` of each estimator's residual (n,) with nobody near, ``travel`` [rad], the greatest way of a
            joint while untouched between two touches, ``moving_share``, the share of untouched time with a command.
    """
    groups: dict[float, list[Push]] = {}
    for push in sorted(pushes, key=lambda p: p.start):
        groups.setdefault(push.start, []).append(push)
    starts = [*groups, float(one.log.t[-1])]
    episodes = [_episode(virtual, one, together, starts[number + 1]) for number, together in enumerate(groups.values())]
    still = one.untouched
    peaks = {name: np.abs(values[still]).max(axis=0) for name, values in one.felt.items()}
    moving = np.abs(one.command).max(axis=1) > 1e-9
    share = float(np.mean(moving[still])) if still.any() else 0.0
    return {
        "episodes": episodes,
        "untouched": {"peak": peaks, "travel": _travel(one), "moving_share": share},
    }


def _episode(virtual: VirtualRobot, one: Ride, together: list[Push], until: float) -> dict[str, Any]:
    log = one.log
    start, end = together[0].start, max(push.start + push.duration for push in together)
    first, last = (int(np.searchsorted(log.t, t)) for t in (start, end))
    pause = slice(last, int(np.searchsorted(log.t, until)))
    commanded = np.abs(one.command).max(axis=1) > 1e-9
    begun = np.flatnonzero(commanded[first:last])
    force = None
    if len(begun):
        at = log.t[first + begun[:1]]
        force = float(sum(np.linalg.norm(push.force_at(at)[0]) for push in together))
    going = np.flatnonzero(commanded[pause])
    return {
        "links": [push.link for push in together],
        "yielded": [_along(virtual, push, log.q[first], log.q[last]) for push in together],
        "force_at_start": force,
        "stopped_after": float(log.t[pause][going[-1]] - end) if len(going) else 0.0,
    }


def _along(virtual: VirtualRobot, push: Push, before: FloatArray, after: FloatArray) -> float:
    """Way [m] of a pushed point along the push."""
    force = np.array(push.force)
    places = []
    for q in (before, after):
        turn, origin = virtual.robot.multibody.frame_pose(q, virtual.robot.joints[push.link - 1])
        places.append(origin + turn @ np.array(push.point))
    return float((places[1] - places[0]) @ force / np.linalg.norm(force))


def _travel(one: Ride) -> float:
    """Greatest way [rad] of a joint in an untouched stretch."""
    rows = np.flatnonzero(one.untouched)
    if len(rows) == 0:
        return 0.0
    stretches = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return max(float(np.ptp(one.log.q[stretch], axis=0).max()) for stretch in stretches)
