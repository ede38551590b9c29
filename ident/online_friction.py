"""A model's terms at one sample, summed in one compiled call: what the online paths of model and observers run on.

The effects' own ``columns`` stay the reference. The effects that an identified model holds are encoded here once more
as rows of a table that a compiled loop walks; every other effect, a user's own or a subclass of an encoded one, keeps
to its ``columns``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ident.arrays import FloatArray, IntArray
from ident.compiled import compiled
from ident.effects.base import Effect, Term
from ident.effects.direction import DirectedEffect, follow
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, CoulombAsymmetry, LoadFriction, Viscous
from ident.effects.friction_curve import Sigmoid, Stribeck, ViscousNonlinear
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import CableSpring, Links, RotorInertia
from ident.effects.ripple import GearRipple
from ident.effects.transmission import CrossJointFriction
from ident.robot import Robot

_COULOMB, _VISCOUS, _OFFSET, _ROTOR, _ASYMMETRY, _STRIBECK, _SIGMOID, _NONLINEAR = range(8)
_LOAD, _CABLE, _RIPPLE, _CROSS, _SLIP = range(8, 13)


class Kind(NamedTuple):
    """What the compiled loop knows of an encoded effect: the plainest form, which others of its class are not.

    Attributes:
        number: by which it goes.
        shapes: how many shapes it reads; of any others the effect states the columns alone.
        coefficients: how many coefficients; none stands for as many as there are.
        needs: what of the fitted model it sees.
    """

    number: int
    shapes: int
    coefficients: int | None = 1
    needs: tuple[str, ...] = ()


ENCODED: dict[type[Effect], Kind] = {
    Coulomb: Kind(_COULOMB, 0),
    Viscous: Kind(_VISCOUS, 0),
    CurrentOffset: Kind(_OFFSET, 0),
    RotorInertia: Kind(_ROTOR, 0),
    CoulombAsymmetry: Kind(_ASYMMETRY, 0),
    Stribeck: Kind(_STRIBECK, 2),
    Sigmoid: Kind(_SIGMOID, 2),
    ViscousNonlinear: Kind(_NONLINEAR, 1),
    LoadFriction: Kind(_LOAD, 0, needs=("load",)),
    CableSpring: Kind(_CABLE, 1, 2),
    GearRipple: Kind(_RIPPLE, 1, 2),
    CrossJointFriction: Kind(_CROSS, 2, 2),
    MaxwellSlip: Kind(_SLIP, 1, None),
}
"""The encoded effects; exactly these classes, not what is derived from them."""


OF_JOINTS = (CableSpring, CrossJointFriction)
"""Those of them that follow the joints where all others follow the motors: the loop sees but the latter."""


class Memories(list[FloatArray]):
    """Memories of a model's terms, one array a term, side by side in one vector.

    The arrays are views: effects carry them forward in place, and the compiled loop sees the same numbers in ``flat``.

    Args:
        flat: all memories, one after the other, (M,).
        shapes: shape of each term's memory.
    """

    def __init__(self, flat: FloatArray, shapes: Sequence[tuple[int, ...]]) -> None:
        self.flat, self._shapes = flat, tuple(shapes)
        ends = np.cumsum([math.prod(shape) for shape in self._shapes], dtype=np.int64)
        starts = np.concatenate([np.zeros(1, dtype=np.int64), ends])
        super().__init__(flat[a:b].reshape(s) for a, b, s in zip(starts[:-1], ends, self._shapes, strict=True))

    def __reduce__(self) -> tuple[type[Memories], tuple[FloatArray, tuple[tuple[int, ...], ...]]]:
        # a copy's arrays must be views of the copy's own vector
        return Memories, (self.flat, self._shapes)

    @staticmethod
    def start(terms: Sequence[Term]) -> Memories:
        """Return the memories as they stand at the start of a segment."""
        starts = [np.asarray(term.effect.start(), dtype=np.float64) for term in terms]
        return Memories(np.concatenate([np.zeros(0), *(s.ravel() for s in starts)]), [s.shape for s in starts])


class OneSample:
    """The encoded terms of a model, ready for single samples.

    Args:
        terms: the model's terms.
        robot: its robot.

    Attributes:
        encoded: for each term, whether the compiled loop knows it.
        others: numbers of the terms left to their own columns; links are neither.
        asks_load: whether one of the encoded terms depends on the force that the links need.
        table: what ``add_terms`` walks, its ``entries`` and ``values``.
    """

    def __init__(self, terms: Sequence[Term], robot: Robot) -> None:
        self.encoded = tuple(_known(term, robot) for term in terms)
        strange = [not known and not isinstance(t.effect, Links) for t, known in zip(terms, self.encoded, strict=True)]
        self.others = [k for k, other in enumerate(strange) if other]
        entries, values, memory = [], [np.zeros(0)], 0
        for term, encoded in zip(terms, self.encoded, strict=True):
            if encoded:
                own = _values(term)
                entries.append([*_entry(term), sum(map(len, values)), memory])
                values.append(own)
            memory += term.effect.start().size
        self.asks_load = any(entry[0] == _LOAD for entry in entries)
        self.table: tuple[IntArray, FloatArray] = (
            np.array(entries, dtype=np.int64).reshape(-1, 6),
            np.concatenate(values),
        )

    def add(
        self,
        t: float,
        q: FloatArray,
        dq: FloatArray,
        ddq: FloatArray,
        load: FloatArray,
        memories: Memories,
        force: FloatArray,
    ) -> None:
        """Add the encoded terms to a force, carrying their memories forward; every array but the memories is (n,).

        Args:
            t: the sample's stamp [s].
            q, dq, ddq: the sample's motion, of the motors [rad or m, s].
            load: force that the links need; read only where ``asks_load``.
            memories: of all the model's terms, as ``Memories.start`` gave them.
            force: what is added to, in the model's force unit.
        """
        add_terms(*self.table, t, q, dq, ddq, load, memories.flat, force)


def _known(term: Term, robot: Robot) -> bool:
    """Whether the table can hold a term; whatever is odd about one is left for its columns to complain of."""
    effect = term.effect
    kind, full = ENCODED.get(type(effect)), (len(effect.shapes), len(effect.coefficients(robot)))
    if kind is None or effect.needs != kind.needs or (len(term.shape), len(term.coefficients)) != full:
        return False
    if isinstance(effect, DirectedEffect) and effect.remembers:
        return False
    if robot.coupling is not None and isinstance(effect, OF_JOINTS):
        return False
    inside = all(j is not None and 0 <= j < robot.n for j in (effect.joint, getattr(effect, "source", 0)))
    return inside and len(_shape(term)) == kind.shapes and kind.coefficients in (None, len(term.coefficients))


def _entry(term: Term) -> list[int]:
    """Kind, joint, other joint and length of the memory of a term."""
    effect = term.effect
    return [ENCODED[type(effect)].number, effect.at, getattr(effect, "source", 0), effect.start().size]


def _shape(term: Term) -> FloatArray:
    """Shapes of a term, a power that is given among them."""
    if isinstance(term.effect, Stribeck):
        return np.array([term.effect.exponent(term.shape), term.shape[0]])
    return term.shape


def _values(term: Term) -> FloatArray:
    """Width, shapes, coefficients of a term; of Maxwell slip the elements' displacements and forces.

    The width is the speed over which a direction turns; of one that remembers it is the displacement, with its
    exponent before.
    """
    effect = term.effect
    if isinstance(effect, MaxwellSlip):
        return np.concatenate([term.shape[0] * np.array(effect.spread), term.coefficients])
    first = [getattr(effect, "smoothing", 0.0)]
    if isinstance(effect, DirectedEffect) and effect.presliding > 0.0:
        first = [effect.presliding_exponent, effect.presliding]
    return np.concatenate([first, _shape(term), term.coefficients])


@compiled
def add_terms(
    entries: IntArray,
    values: FloatArray,
    t: float,
    q: FloatArray,
    dq: FloatArray,
    ddq: FloatArray,
    load: FloatArray,
    memory: FloatArray,
    force: FloatArray,
) -> None:
    """Add every row of the table to ``force`` (n,).

    ``entries`` (T, 6): kind, joint, other joint, length of the memory, and where in ``values`` and ``memory`` the
    term's begin.
    """
    for k in range(len(entries)):
        kind, j, source, length, v, m = entries[k]
        if kind == _SLIP:
            force[j] += _slip(q[j], values[v : v + 2 * length], memory[m : m + length])
        elif kind == _CROSS:
            mixed = math.cos(values[v + 1]) * dq[j] + math.sin(values[v + 1]) * dq[source]
            force[j] += values[v + 3] * math.tanh(mixed / values[v + 2]) + values[v + 4] * dq[source]
        elif kind in (_VISCOUS, _OFFSET, _ROTOR, _CABLE, _RIPPLE):
            force[j] += _plain(kind, values[v:], q[j], dq[j], ddq[j])
        elif kind == _SIGMOID:
            force[j] += _sigmoid(values[v:], dq[j])
        elif length:
            direction = follow(t, q[j], dq[j], values[v + 1], values[v], memory[m : m + length])
            force[j] += _directed(kind, values[v + 1 :], dq[j], direction, load[j])
        else:
            force[j] += _directed(kind, values[v:], dq[j], math.tanh(dq[j] / values[v]), load[j])


@compiled
def _plain(kind: int, p: FloatArray, q: float, dq: float, ddq: float) -> float:
    """Force of a term that one signal of the joint's motion decides; ``p`` holds its values."""
    force: float = p[1]
    if kind == _VISCOUS:
        force *= dq
    elif kind == _ROTOR:
        force *= ddq
    elif kind == _CABLE:
        force = p[2] * (q - p[1]) + p[3] * (q - p[1]) ** 3
    elif kind == _RIPPLE:
        force = p[2] * math.sin(p[1] * q) + p[3] * math.cos(p[1] * q)
    return force


@compiled
def _directed(kind: int, p: FloatArray, dq: float, direction: float, load: float) -> float:
    """Force of a term against the direction of motion; ``p`` holds its values."""
    force: float = p[1] * direction
    if kind == _LOAD:
        force *= abs(load)
    elif kind == _ASYMMETRY:
        force = p[1] * abs(direction)
    elif kind == _STRIBECK:
        force = p[3] * direction * math.exp(-(abs(dq / p[2]) ** p[1]))
    elif kind == _NONLINEAR:
        force = p[2] * direction * (abs(dq) + 1e-9) ** p[1]
    return force


@compiled
def _sigmoid(p: FloatArray, dq: float) -> float:
    force: float = p[3] * (_logistic((dq + p[2]) / p[1]) - _logistic(p[2] / p[1]))
    return force


@compiled
def _logistic(x: float) -> float:
    return 0.5 * (1.0 + math.tanh(0.5 * x))


@compiled
def _slip(z: float, p: FloatArray, position: FloatArray) -> float:
    """Maxwell elements; ``p`` holds their displacements, then their forces, ``position`` where each stands."""
    elements = len(position)
    total = 0.0
    for k in range(elements):
        slip, zeta = p[k], position[k]
        if np.isnan(zeta):
            zeta = z
        stretch = z - zeta
        if stretch >= slip:
            zeta, stretch = z - slip, slip
        elif stretch <= -slip:
            zeta, stretch = z + slip, -slip
        position[k] = zeta
        total += p[elements + k] * (stretch / slip)
    return total
