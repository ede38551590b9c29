"""From logs and a model to the rows that the workflow looks at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Term
from ident.effects.direction import SMOOTHING, VelocityEffect
from ident.effects.survey import Survey
from ident.errors import InputError
from ident.gap.bodies import bodies_of
from ident.gap.edge import edge_columns
from ident.gap.folds import folds_of
from ident.gap.joint_gap import JointGap
from ident.gap.own_errors import own_errors
from ident.gap.panel import Panel
from ident.log import LogSource
from ident.log_set import path_of
from ident.model import NEWTON_METRE, CurrentModel
from ident.walk import collect, kept_rows, slowest_rate

ROWS = 16_000
"""Rows that are looked at, evenly spread; neighbouring rows of a robot's residual say nearly the same."""

DRY = ("coulomb", "sigmoid", "stribeck", "maxwell-slip", "cross-joint-friction")
"""Effects whose force a joint that stands may hold."""

STEPS = ("coulomb", "stribeck")
"""Those that turn as the joint does, at any speed."""

OF_SPEED = ("viscous", "viscous-nonlinear")
"""Effects whose force is nought at rest and grows with speed."""

ALONE, LEAST_MOTOR, MOST_MOTOR = 0.05, 0.05, 0.9
"""Share of a joint's squared acceleration that its load must not follow, to tell a motor's inertia from the links'; and
shares of the joint's inertia from which on that is looked for, and that it is taken for at most."""


def panel_of(model: CurrentModel, sources: Sequence[LogSource], limit: int = ROWS) -> Panel:
    """Gather rows of logs, with what effects see of them under the model; folds are logs, or parts of few logs.

    Raises:
        InputError: the logs have no row to learn from.
    """
    blocks = collect([model.view(source) for source in sources], model.cutoff)
    if not blocks:
        raise InputError("no row to learn from", ", ".join(path_of(source) for source in sources), "give longer logs")
    slowest = slowest_rate(blocks)
    every = max(1, -(-kept_rows(blocks) // limit))
    # Of logs that were sampled faster fewer rows: the step is one for all.
    rows = [np.flatnonzero(block.keep)[:: max(1, round(every * block.log.rate / slowest))] for block in blocks]
    contexts = [model.context(block.motion, total=True) for block in blocks]
    return Panel(model, blocks, contexts, rows, folds_of(blocks, rows))


def survey_of(model: CurrentModel, panel: Panel, begins: tuple[float, ...] = (), held: bool = False) -> Survey:
    """Facts about the logs that candidates are built from, and whether the model is held fixed."""
    robot = model.robot
    speed = np.abs(panel.velocity)
    dry, viscous = _dry(model, DRY), np.zeros(robot.n)
    for term in model.terms:
        if term.effect.name in OF_SPEED:
            force = panel.columns(term.effect, term.shape, term.effect.at) @ term.coefficients
            viscous[term.effect.at] += np.abs(force).mean()
    nominal, bodies = panel.bodies_load, bodies_of(model)
    stamps = [(float(block.motion.t[0]), float(block.motion.t[-1])) for block in panel.blocks]
    since, last = min(start for start, _ in stamps), max(end for _, end in stamps)
    return Survey(
        robot=robot,
        smoothing=np.array([_smoothing(model, j) for j in range(robot.n)]),
        presliding=model.presliding,
        presliding_exponent=model.presliding_exponent,
        pace=speed.mean(axis=0),
        friction=dry + viscous,
        viscous=np.clip(viscous / np.maximum(dry + viscous, 1e-12), 0.0, 1.0),
        weight=np.abs(_weight(panel)).max(axis=0) * bodies.per_newton_metre,
        largest=np.abs(panel.seen("total")).max(axis=0),
        per_newton_metre=bodies.per_newton_metre,
        links=bodies.parameters,
        load_ratio=_load_ratio(model, panel, nominal),
        since=since,
        lasts=last - since,
        logged=min(sum(end - start for start, end in stamps) / max(last - since, 1e-9), 1.0),
        begins=begins,
        rate=slowest_rate(panel.blocks),
        reach=np.ptp(panel.motion.q, axis=0),
        middle=0.5 * (panel.motion.q.min(axis=0) + panel.motion.q.max(axis=0)),
        holds=dry,
        steps=_dry(model, STEPS),
        cutoff=model.cutoff,
        inertia=panel.inertia,
        motor=_motor(panel, nominal),
        held=held,
    )


def _dry(model: CurrentModel, laws: Sequence[str]) -> FloatArray:
    """Force (n,) of all that a model knows of dry friction by some laws."""
    force = np.zeros(model.n)
    for term in model.terms:
        if term.effect.name in laws:
            told = term.effect.summary(model.robot, term.shape, term.coefficients)
            force[term.effect.at] += abs(float(np.sum(told["force"]))) + float(np.sum(told.get("dry", 0.0)))
    return force


def gap_of(model: CurrentModel, panel: Panel, joint: int) -> JointGap:
    """A joint's rows with the model's columns, which are fitted again, and those by which its sign may turn."""
    own, columns = _own(model, panel, joint)
    edge = edge_columns(panel, own, joint)
    everything = np.ones(len(panel), dtype=bool)
    present = tuple(t.effect for t in own)
    return JointGap(joint, np.hstack([*columns, edge]), panel.force[:, joint], everything, present, edge.shape[1])


def held_of(model: CurrentModel, panel: Panel, joint: int) -> JointGap:
    """A joint's rows as the model, held fixed, leaves them, with the errors that its parameters may have."""
    own, columns = _own(model, panel, joint)
    edge = edge_columns(panel, own, joint)
    forces = [c @ t.coefficients for c, t in zip(columns, own, strict=True)]
    left = panel.force[:, joint] - np.sum(forces, axis=0)
    friction = [force for t, force in zip(own, forces, strict=True) if t.effect.family == "friction"]
    everything = np.ones(len(panel), dtype=bool)
    known = [c @ t.errors for c, t in zip(columns, own, strict=True) if t.errors.shape[1] > 0]
    every = np.sum(known, axis=0) if known else np.zeros((len(panel), 0))
    errors, prior = own_errors(every, left, edge, panel.fold)
    return JointGap(
        joint,
        np.hstack([errors, edge]),
        left,
        everything,
        (),
        edge.shape[1],
        np.column_stack(friction) if friction else None,
        prior=prior,
    )


def left_by(model: CurrentModel, panel: Panel) -> FloatArray:
    """What a model as it is leaves of all rows, (N, n)."""
    left = panel.force.copy()
    for j in range(model.n):
        left[:, j] -= np.sum([c @ t.coefficients for t, c in zip(*_own(model, panel, j), strict=True)], axis=0)
    return left


def _own(model: CurrentModel, panel: Panel, joint: int) -> tuple[list[Term], list[FloatArray]]:
    """A model's terms that act on a joint, and the columns of each."""
    own = [t for t in model.terms if t.effect.acts_on in (None, joint)]
    return own, [panel.columns(t.effect, t.shape, joint) for t in own]


def _smoothing(model: CurrentModel, joint: int) -> float:
    """Speed over which a joint's friction turns: of a rise that stands for dry friction, that of the rise."""
    own = [term for term in model.terms if term.effect.joint == joint]
    return max((t.effect.turns_over(t.shape) for t in own if isinstance(t.effect, VelocityEffect)), default=SMOOTHING)


def _load_ratio(model: CurrentModel, panel: Panel, nominal: FloatArray) -> FloatArray:
    """One where gains are known, else how the links' load compares with the URDF's (N, n)."""
    ratio, load = np.ones(model.n), panel.seen("load")
    if model.force_unit != NEWTON_METRE:
        for j in range(model.n):
            square = float(nominal[:, j] @ nominal[:, j])
            ratio[j] = float(nominal[:, j] @ load[:, j]) / square if square > 0 else 1.0
    return ratio


def _weight(panel: Panel) -> FloatArray:
    """What the links of the URDF load each joint with (N, n) that stands where the rows are [N m or N]."""
    q, arm = panel.motion.q, panel.robot.multibody
    rest = np.zeros_like(q)
    return panel.robot.rigid_body.inverse_dynamics(q, rest, rest, arm.parameters)


def _motor(panel: Panel, nominal: FloatArray) -> FloatArray:
    """What of each joint's inertia (n,) is its motor's: a force by its acceleration that the URDF's links lack.

    Their load (N, n) is taken to be right but for the gain. Nought where it is too little, and of a joint whose load is
    little but its inertia, of which the gain is not told apart.
    """
    load, motor = panel.seen("load"), np.zeros(panel.robot.n)
    for j in np.flatnonzero(panel.inertia > 0.0).tolist():
        ddq, links = panel.motors.ddq[:, j], nominal[:, j]
        alone = ddq - links * (links @ ddq) / max(float(links @ links), 1e-300)
        if alone @ alone > ALONE * (ddq @ ddq):
            motor[j] = (alone @ load[:, j]) / (alone @ alone)
    return np.where(motor > LEAST_MOTOR * panel.inertia, np.minimum(motor, MOST_MOTOR * panel.inertia), 0.0)
