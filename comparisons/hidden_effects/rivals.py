"""What people do today to find out what a model lacks: four rules of choice on the catalogue's columns.

None of them states a p-value or an alternative, and none can say that something is there that it has no name for: a
term that is added is a name that is given. pysindy, which builds terms of its own, is handed the catalogue's columns
at their starting shapes instead, and only its optimisers FROLS and STLSQ are used. Effects of the whole robot enter
each joint's row with coefficients of their own; one that is chosen on two joints or more is reported once, for the
whole robot.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from comparisons.hidden_effects.answer import Answer, Name, plain_figures
from comparisons.hidden_effects.cases import WHOLE_ROBOT
from comparisons.hidden_effects.library import Candidate, JointLibrary, Library
from ident.arrays import FloatArray, IntArray
from ident.effects.base import Term
from ident.fit import Drives, fit
from ident.gap.evidence import evidence
from ident.gap.problem import JointProblem
from ident.log import LogSource
from ident.model import CurrentModel

MOST = 4
"""Effects at most that one joint is given, as in the gap workflow."""

TERMS = 10
"""Sizes of model that FROLS weighs by its information criterion (its usual number)."""

THRESHOLDS = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
"""Thresholds of STLSQ, as shares of the residual's length; the one that predicts held-out rows best is taken."""

DEPENDENT = 1e-6
"""Length that columns before it must leave of a column of length one, or it says the same as they."""

Chooser = Callable[[JointLibrary], list[int]]
"""Chooses candidates of a joint by number, the most important first."""


def best_mae(joint: JointLibrary) -> list[int]:
    """Choose the model with the least mean absolute error on held-out folds (as BAM compares friction models).

    Duclusaud et al. 2024, "Extended Friction Models for the Physics Simulation of Servo Actuators". One effect more as
    long as that error falls at all.
    """
    return _forward(joint, lambda problem, columns: float(np.mean(np.abs(problem.held_out(columns)))))


def stepwise_bic(joint: JointLibrary) -> list[int]:
    """Add the effect that lowers Schwarz's criterion most, as long as one does (Schwarz 1978, rows independent)."""
    rows = len(joint.problem)

    def criterion(problem: JointProblem, columns: FloatArray) -> float:
        squares = float(np.sum(problem.left(columns) ** 2))
        return float(rows * math.log(max(squares, 1e-300) / rows) + columns.shape[1] * math.log(rows))

    return _forward(joint, criterion)


def frols(joint: JointLibrary) -> list[int]:
    """Choose terms by their error reduction ratio, as many as Akaike's criterion asks for.

    Billings 2013, "Nonlinear System Identification", ch. 3, as pysindy implements it: of sysidentpy, better known for
    it, the newest release that pip accepts beside numpy 2.4 (0.2.0) fails on it. Columns of one effect count as one;
    a column that others before it make up is left out, for pysindy breaks down on it.
    """
    from pysindy.optimizers import FROLS

    used, y = _usable(joint)
    length = float(np.linalg.norm(y))
    if not used or length == 0.0:
        return []
    own = np.abs(np.diag(np.linalg.qr(joint.matrix[:, used], mode="r"))) > DEPENDENT
    used = np.array(used)[own].tolist()
    psi, target = joint.matrix[:, used], y / length
    chooser = FROLS(max_iter=min(TERMS, len(used) - 1), alpha=0.0, unbias=False) if len(used) > 1 else None
    order = [0] if chooser is None else _order(chooser, psi, target)
    criteria = [_akaike(psi[:, order[:k]], target) for k in range(len(order) + 1)]
    terms = order[: int(np.argmin(criteria))]
    return list(dict.fromkeys(joint.owner[used[k]] for k in terms))


def sparse_regression(joint: JointLibrary) -> list[int]:
    """Choose terms by sequentially thresholded least squares (pysindy's STLSQ), the threshold on held-out folds.

    Brunton, Proctor and Kutz 2016. Columns have length one, so that one threshold fits all of them.
    """
    from pysindy.optimizers import STLSQ

    used, y = _usable(joint)
    length = float(np.linalg.norm(y))
    if not used or length == 0.0:
        return []
    psi = joint.matrix[:, used]

    def regress(rows: IntArray, threshold: float) -> FloatArray:
        optimiser = STLSQ(threshold=threshold * length, alpha=1e-6)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            optimiser.fit(psi[rows], y[rows, None])
        return np.asarray(optimiser.coef_[0], dtype=np.float64)

    everything = np.arange(len(y))
    errors = [_held_out_squares(joint, psi, y, lambda rows, t=t: regress(rows, t)) for t in THRESHOLDS]  # type: ignore[misc]
    if min(errors) >= float(y @ y):
        return []
    found = regress(everything, THRESHOLDS[int(np.argmin(errors))])
    weight = np.zeros(len(joint.candidates))
    for k, coefficient in zip(used, found, strict=True):
        weight[joint.owner[k]] += coefficient**2
    return [int(k) for k in np.argsort(-weight) if weight[k] > 0]


RIVALS: dict[str, Chooser] = {
    "best MAE": best_mae,
    "stepwise BIC": stepwise_bic,
    "FROLS (pysindy)": frols,
    "STLSQ (pysindy)": sparse_regression,
}


def ask_rival(name: str, shared: Library, train: Sequence[LogSource], test: Sequence[LogSource]) -> Answer:
    """Ask a rival method what a model lacks.

    Args:
        name: of `RIVALS`.
        shared: the model and the candidates.
        train: logs that the extended model is fitted to.
        test: logs on which errors before and after are taken.
    """
    started = time.perf_counter()
    chosen = {joint.joint: [joint.candidates[k] for k in RIVALS[name](joint)] for joint in shared.joints}
    terms = {joint: _terms(shared.joints[joint], picked) for joint, picked in chosen.items()}
    seconds = time.perf_counter() - started
    extended = _extended(shared, [t for own in terms.values() for t in own], train)
    errors = evidence([shared.model, extended], test)
    names = _names(shared, terms)
    return Answer(names, (), tuple(errors.before.tolist()), tuple(errors.after.tolist()), seconds)


def _forward(joint: JointLibrary, criterion: Callable[[JointProblem, FloatArray], float]) -> list[int]:
    chosen: list[int] = []
    columns = np.zeros((len(joint.problem), 0))
    best = criterion(joint.problem, columns)
    while len(chosen) < MOST:
        tried = {
            k: criterion(joint.problem, np.hstack([columns, c.columns]))
            for k, c in enumerate(joint.candidates)
            if k not in chosen
        }
        number = min(tried, key=lambda k: tried[k], default=None)
        if number is None or tried[number] >= best:
            break
        best = tried[number]
        chosen.append(number)
        columns = np.hstack([columns, joint.candidates[number].columns])
    return chosen


def _usable(joint: JointLibrary) -> tuple[list[int], FloatArray]:
    """Columns of the library that the baseline does not absorb, and the residual."""
    if not joint.candidates:
        return [], joint.problem.residual
    return np.flatnonzero(np.any(joint.matrix != 0.0, axis=0)).tolist(), joint.problem.residual


def _order(chooser: Any, psi: FloatArray, y: FloatArray) -> list[int]:
    """Return the columns that FROLS took, in the order in which it took them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        chooser.fit(psi, y[:, None])
    order: dict[int, None] = {}
    for coefficients in chooser.history_:
        order.update(dict.fromkeys(np.flatnonzero(coefficients[0]).tolist()))
    return list(order)


def _akaike(columns: FloatArray, y: FloatArray) -> float:
    left = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(len(y) * math.log(max(float(left @ left), 1e-300) / len(y)) + 2.0 * columns.shape[1])


def _held_out_squares(
    joint: JointLibrary, psi: FloatArray, y: FloatArray, regress: Callable[[IntArray], FloatArray]
) -> float:
    squares = 0.0
    for fold in joint.problem.folds:
        rest = np.setdiff1d(np.arange(len(y)), fold)
        left = y[fold] - psi[fold] @ regress(rest)
        squares += float(left @ left)
    return squares


def _terms(joint: JointLibrary, picked: Sequence[Candidate]) -> list[Term]:
    """Return the chosen effects with the coefficients that fit the joint's rows."""
    if not picked:
        return []
    found = joint.problem.fit(np.hstack([c.columns for c in picked]))[joint.problem.matrix.shape[1] :]
    terms, k = [], 0
    for c in picked:
        count = c.columns.shape[1]
        terms.append(Term(c.effect, c.shape, found[k : k + count]))
        k += count
    return terms


def _names(shared: Library, terms: dict[int, list[Term]]) -> tuple[Name, ...]:
    """Return findings, those that explain most of their joint's residual first."""
    found: list[tuple[float, Name]] = []
    for joint, own in terms.items():
        problem = shared.joints[joint].problem
        size = float(problem.residual @ problem.residual)
        for term in own:
            columns = shared.panel.columns(term.effect, term.shape, joint)[problem.keep]
            figures = plain_figures(term.effect.summary(shared.model.robot, term.shape, term.coefficients))
            joints = () if term.effect.joint is None else (term.effect.joint,)
            found.append((problem.drop(columns) / max(size, 1e-300), Name(term.effect.name, joints, (), figures)))
    found.sort(key=lambda pair: -pair[0])
    return tuple(_merged([name for _, name in found]))


def _merged(names: Sequence[Name]) -> list[Name]:
    """Return names in order, those of whole-robot effects on two joints or more once."""
    merged: dict[tuple[str, tuple[int, ...]], Name] = {}
    for name in names:
        many = name.effect in WHOLE_ROBOT and sum(n.effect == name.effect for n in names) > 1
        one = replace(name, joints=()) if many else name
        merged.setdefault((one.effect, one.joints), one)
    return list(merged.values())


def _extended(shared: Library, terms: Sequence[Term], train: Sequence[LogSource]) -> CurrentModel:
    """Return the model with what was chosen, refitted, or with the terms added to it."""
    single = [t for t in terms if t.effect.acts_on is not None]
    whole = {t.effect: t for t in terms if t.effect.acts_on is None}
    model = shared.model
    everything = [*model.terms, *single, *(_shared_fit(shared, t) for t in whole.values())]
    if not shared.refit:
        return replace(model, terms=tuple(everything))
    effects, shapes = [t.effect for t in everything], [t.shape for t in everything]
    return fit(model.robot, effects, train, model.cutoff, Drives(model.gain, model.force_unit), shapes=shapes).model


def _shared_fit(shared: Library, term: Term) -> Term:
    """Return an effect of the whole robot with the one set of coefficients that fits all joints, each by its noise."""
    normal, right = np.zeros((len(term.coefficients),) * 2), np.zeros(len(term.coefficients))
    for joint in shared.joints:
        problem = joint.problem
        columns = problem.away(shared.panel.columns(term.effect, term.shape, joint.joint)[problem.keep])
        weight = len(problem) / max(float(problem.residual @ problem.residual), 1e-300)
        normal += weight * columns.T @ columns
        right += weight * columns.T @ problem.residual
    return replace(term, coefficients=np.asarray(np.linalg.lstsq(normal, right, rcond=1e-12)[0]))
