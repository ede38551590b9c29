"""Contacts on the virtual VS060: an hour without, 500 pushes, every estimator, friction with and without memory.

Run ``python benchmarks/contact_detection.py``, or with ``--minutes 10 --pushes 80`` for a look. Models are
identified in %Use, drive gains unknown, from 15 minutes of stop-and-go motion. Thresholds come from an hour without
contact and are tried on another. "in set": the link pushed is among those told, the nearest that can have been pushed
and all behind it; "links": how many those are on average; "nearest": the nearest is the one pushed; "last felt": it is
that of the last joint at which the push's true torque passes the share of the threshold that isolation takes.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from comparisons.protocols import named
from comparisons.virtual_robot import VirtualRobot
from comparisons.virtual_robot.contact import Push
from ident.arrays import BoolArray, FloatArray, IntArray
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.friction_curve import Stribeck
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links, RotorInertia
from ident.fit import Drives, fit
from ident.log import JointLog
from ident.model import CurrentModel
from ident.robot import load_robot
from observers.contact import ISOLATING, ContactDetector, Contacts
from observers.methods import METHODS, make_estimator
from observers.residual import Residual
from observers.thresholds import Threshold, fit_threshold

BANDWIDTH = 2.0  # [Hz]
FALSE_ALARMS = 1.0  # [1/h] asked for
FIRST = 20.0  # [s] until every joint has moved: before, nobody knows the friction it stores
STRONG = 1.5  # times the threshold of some joint
COLUMNS = (
    *("method", "false alarms/h", "missed", "strong missed", "delay [s]", "p95 [s]"),
    *("in set", "links", "nearest", "last felt", "AUROC"),
)
PUSHES_A_SECOND = 1.0 / 11.0  # about what contact_episodes draws
MODELS = {
    "with memory": (Links, RotorInertia, MaxwellSlip, Viscous, CurrentOffset),
    "without": (Links, RotorInertia, Coulomb, Viscous, Stribeck, CurrentOffset),
}


@dataclass(frozen=True)
class Logs:
    """Two logs without contact, one with, and its pushes."""

    calibrate: JointLog
    free: JointLog
    pushed: JointLog
    pushes: list[Push]


def record(virtual: VirtualRobot, minutes: float, pushes: int) -> Logs:
    def motion(seed: int) -> JointLog:
        return virtual.record(named("stop_and_go")(virtual.robot, seconds=60.0 * minutes, seed=seed), seed)

    episodes = named("contact_episodes")(virtual.robot, seconds=pushes / PUSHES_A_SECOND, seed=14)
    drawn = next(iter(episodes.blocks())).pushes
    pushed = virtual.record(episodes, 14)
    return Logs(motion(12), motion(13), pushed, in_log_time(drawn, pushed)[:pushes])


def in_log_time(pushes: Sequence[Push], log: JointLog) -> list[Push]:
    """Move pushes, counted by rows, to the log's time; without those at a segment's beginning or across its end."""
    kept = []
    since = since_segment(log.t, log.segment)
    for push in pushes:
        first, last = (round(when * log.rate) for when in (push.start, push.start + push.duration))
        if last < len(log) and log.segment[first] == log.segment[last] and since[first] > FIRST:
            kept.append(replace(push, start=float(log.t[first])))
    return kept


def since_segment(t: FloatArray, segment: IntArray) -> FloatArray:
    """Time since the beginning of each row's segment [s], (N,)."""
    begins = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1))
    return t - t[begins][np.searchsorted(begins, np.arange(len(t)), side="right") - 1]


def identify(virtual: VirtualRobot, kinds: tuple[type, ...]) -> CurrentModel:
    log = virtual.record(named("stop_and_go")(virtual.robot, seconds=900.0, seed=1), 1)
    effects = [kind(j) for j in range(virtual.robot.n) for kind in kinds]
    return fit(virtual.robot, effects, [log], 10.0, Drives(np.ones(virtual.robot.n), virtual.robot.unit)).model


def settled(residual: Residual) -> Residual:
    rows = since_segment(residual.t, residual.segment) > FIRST
    return Residual(
        residual.t[rows], residual.current[rows], None, residual.flags[rows], residual.segment[rows], residual.unit
    )


def found(pushes: list[Push], contacts: Contacts) -> tuple[FloatArray, list[int]]:
    """Delay of each push's detection [s], NaN where it was missed, and the nearest link told."""
    delays, links = np.full(len(pushes), np.nan), [0] * len(pushes)
    for k, push in enumerate(pushes):
        rows = slice(*np.searchsorted(contacts.t, [push.start, push.start + push.duration]))
        alarms = np.flatnonzero(contacts.level[rows] > 0)
        if len(alarms):
            delays[k] = contacts.t[rows][alarms[0]] - push.start
            links[k] = int(np.argmax(np.bincount(contacts.link[rows][alarms])))
    return delays, links


def felt(pushes: list[Push], log: JointLog, gain: FloatArray, threshold: Threshold) -> FloatArray:
    """Largest true torque of each push at each joint, as current and over the threshold, (pushes, n)."""
    assert log.tau_ext is not None
    largest = []
    for push in pushes:
        rows = slice(*np.searchsorted(log.t, [push.start, push.start + push.duration]))
        largest.append(np.max(np.abs(log.tau_ext[rows]) / gain / threshold.constant, axis=0))
    return np.array(largest)


def isolation(links: list[int], pushes: list[Push], truth: FloatArray, hit: BoolArray) -> list[str]:
    """Share of the detected pushes whose link is in the set told, its mean size, and shares of the nearest link."""
    n = truth.shape[1]
    real, said = np.array([push.link for push in pushes])[hit], np.array(links)[hit]
    last = np.array([(np.flatnonzero(row > ISOLATING)[-1] + 1) if (row > ISOLATING).any() else 0 for row in truth])[hit]
    shares = [np.mean(said <= real), np.mean(n + 1 - said), np.mean(said == real), np.mean(said == last)]
    return [f"{share:.2f}" for share in shares]


def auroc(during: FloatArray, without: FloatArray) -> float:
    """Chance that a row under a push ranks above one without."""
    values = np.concatenate([during, without])
    rank = np.empty(len(values))
    rank[np.argsort(values)] = np.arange(1, len(values) + 1)
    return float((rank[: len(during)].mean() - 0.5 * (len(during) + 1)) / len(without))


def row(method: str, model: CurrentModel, logs: Logs, gain: FloatArray) -> list[str]:
    estimator = make_estimator(method, model, [logs.calibrate], BANDWIDTH)
    calibrate, free = settled(estimator.run(logs.calibrate)), settled(estimator.run(logs.free))
    threshold = fit_threshold([calibrate], FALSE_ALARMS)
    detector = ContactDetector(threshold)
    hours = len(free) / logs.free.rate / 3600.0
    alarms = len(detector.run(free).episodes(1.0)) / hours
    residual = estimator.run(logs.pushed)
    contacts = detector.run(residual)
    delays, links = found(logs.pushes, contacts)
    hit, truth = np.isfinite(delays), felt(logs.pushes, logs.pushed, gain, threshold)
    strong = truth.max(axis=1) > STRONG
    under = np.zeros(len(residual), dtype=bool)
    for push in logs.pushes:
        under |= (residual.t > push.start + push.rise) & (residual.t < push.start + push.duration - push.rise)
    score = auroc(contacts.ratio[under].max(axis=1), detector.run(free).ratio.max(axis=1))
    median, late = np.quantile(delays[hit], [0.5, 0.95])
    cells = [f"{alarms:.1f}", f"{np.mean(~hit):.2f}", f"{np.mean(~hit[strong]):.2f}", f"{median:.2f}", f"{late:.2f}"]
    return [method, *cells, *isolation(links, logs.pushes, truth, hit), f"{score:.3f}"]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--pushes", type=int, default=500)
    arguments = parser.parse_args()
    virtual = VirtualRobot(load_robot("vs060"))
    logs = record(virtual, arguments.minutes, arguments.pushes)
    print(f"{len(logs.pushes)} pushes; a push is strong where its torque is 1.5 times the threshold of some joint")
    peaks = {}
    for name, kinds in MODELS.items():
        model = identify(virtual, kinds)
        print(f"\nfriction {name}\n\n| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
        for method in METHODS:
            print("| " + " | ".join(row(method, model, logs, virtual.laws.gain)) + " |", flush=True)
        quiet = settled(make_estimator("gmo", model, [logs.free], BANDWIDTH).run(logs.free))
        peaks[name] = np.abs(quiet.current).max(axis=0)
        print("gmo, peak residual without contact [%Use]:", peaks[name].round(1))
    print(
        "\nfall of the peak by memory of friction [%]:", (100 * (1 - peaks["with memory"] / peaks["without"])).round(0)
    )


if __name__ == "__main__":
    main()
