"""The gap workflow: where simulation and measurement disagree, what is missing, and how far that closes the gap."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ident.current_unit import check_unit
from ident.errors import InputError
from ident.gap.clocks import on_one_clock
from ident.gap.naming import Causes, name_causes
from ident.gap.report import GapReport
from ident.gap.reporter import Reporter, Start
from ident.gap.subject import Subject
from ident.gap.threads import in_threads
from ident.gap.torque_constant import wrong_gain
from ident.gap.touch import Touches, undisturbed, unpredicted_touches
from ident.gap.velocity_lag import new_lag
from ident.log import JointLog, LogSource
from ident.log_set import check_together
from ident.model import CurrentModel

Progress = Callable[[str, float], None]

ROUNDS = 3
"""Times at most that contact is cut out: links that were fitted to some of it hide the rest."""


def find_gap(
    model: CurrentModel,
    train: Sequence[LogSource],
    test: Sequence[LogSource] = (),
    refit: bool = True,
    progress: Progress | None = None,
    motions: Mapping[str, JointLog] | None = None,
) -> GapReport:
    """Find what a model lacks.

    Args:
        model: the simulation.
        train: logs to find it in; in the order of recording, if their clocks begin anew.
        test: logs to show it on, which play no part in finding it.
        refit: whether the model's own parameters are fitted again with every candidate: what does its structure lack?
            Without, it is held fixed: what has changed since it was identified?
        progress: told what is being done and the share of it that is done.
        motions: commanded motions by name (their currents are not looked at), among which the one is sought that
            would separate names that the logs leave open; without any, findings only say it in words.

    Raises:
        InputError: no log, logs too short, a current that never changes, or one in another unit than others or the
            model's.
    """
    if not train:
        raise InputError("no log to look at", "--train", "give at least one log")
    check_together(train)
    with threadpool_limits(1, "blas"):
        return _find_gap(model, train, test, refit, progress or (lambda what, share: None), motions or {})


def _find_gap(
    model: CurrentModel,
    train: Sequence[LogSource],
    test: Sequence[LogSource],
    refit: bool,
    tell: Progress,
    motions: Mapping[str, JointLog],
) -> GapReport:
    tell("reading logs", 0.0)
    given = train
    train, clock = on_one_clock(model, train)
    lag = new_lag(model, train, refit)
    subject = Subject(model if lag is None else replace(model, positions_only=True), train, refit, clock)
    subject.look()
    check_unit(subject.model, given, learnt=refit)
    check_unit(subject.model, test)
    start = subject.model
    if lag is not None:
        logged = replace(subject.model, positions_only=False)
        start = subject.fitted(logged, []) if refit else logged
    reporter = Reporter(
        subject, Start(start, lag), test, motions, lambda share: tell("settling names", share)
    )  # fmt: skip
    tell("comparing joints", 0.0)
    while refit and (gain := wrong_gain(subject)) is not None:
        subject.learn(gain)
    contacts: list[Touches] = []
    while True:
        causes = name_causes(subject, lambda share: tell("trying effects", share))
        if causes is None or subject.leave_out(causes.stuck) or subject.turn(causes.lateness(subject.panel)):
            continue
        found = _touches(subject, causes) if len(contacts) < ROUNDS else None
        if found is None:
            return reporter.report(causes, contacts)
        contacts.append(found)
        subject.cut_out(found)


def _touches(subject: Subject, causes: Causes) -> Touches | None:
    """Contact in what names leave, if there is any."""
    panel, survey, rests = subject.panel, subject.survey, subject.rests
    residuals, explained = (np.zeros((len(panel), subject.model.n)) for _ in range(2))
    counts = panel.gather(rests.counts)

    def see(joint: int) -> None:
        gap, names, rest = causes.gaps[joint], causes.named[joint], ~counts[:, joint]
        left = undisturbed(gap, panel, [n.trial for n in names])
        residuals[gap.keep, joint] = left[gap.keep]
        residuals[rest, joint] = rests.beyond(joint, left[rest])
        if names:
            explained[gap.keep, joint] = (undisturbed(gap, panel) - left)[gap.keep]

    in_threads(see, range(subject.model.n))
    found = unpredicted_touches(panel, survey, residuals, explained)
    return found if found.episodes else None
