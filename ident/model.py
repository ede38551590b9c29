"""The current model: effects with fitted parameters, which together say what a robot's motors should draw."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ident.arrays import FloatArray
from ident.effects.base import Coefficient, Context, Effect, Shape, Term
from ident.effects.direction import DirectedEffect
from ident.effects.rigid_body import Links, RotorInertia
from ident.log import JointLog, LogSource, PositionsOnly, Sample
from ident.online_friction import Memories, OneSample
from ident.robot import Robot
from ident.signals import CausalDerivatives, Motion, derive
from ident.walk import Block, walk

NEWTON_METRE = "N m"
"""Force unit of a model whose drive gains are known; forces of prismatic joints are then in N."""


@dataclass(eq=False)
class CurrentModel:
    """Sum of effects, each with its parameters; satisfies ``CurrentPredictor``.

    Attributes:
        robot: the robot.
        terms: effects with their parameters.
        cutoff: cut-off [Hz] of the filters that derive velocity and acceleration.
        rate: sampling rate [Hz] of the logs it was identified from; filters of ``step`` are designed for it.
        gain: force unit per unit of current, (n,); ones where the gains are unknown.
        force_unit: unit of the model's forces: N m where the drive gains are known, else the current's unit.
        positions_only: whether velocities come from the positions even where a log holds them, since those lag or
            are noisier.
    """

    robot: Robot
    terms: tuple[Term, ...]
    cutoff: float
    rate: float
    gain: FloatArray
    force_unit: str
    positions_only: bool = False
    _online: tuple[CausalDerivatives, Memories] | None = field(default=None, init=False, repr=False)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.robot.n

    @property
    def unit(self) -> str:
        """Unit of the current it predicts."""
        return self.robot.unit

    def unit_of(self, effect: Effect, parameter: Coefficient | Shape) -> str:
        """Return the unit of a parameter of one of its effects, written out."""
        own, angle = (
            "rad" if joint is None else self.robot.displacement_unit(joint)
            for joint in (effect.joint, effect.measured_on)
        )
        force = "N" if own == "m" and self.force_unit == NEWTON_METRE else self.force_unit
        return parameter.unit.replace("{current}", force).replace("{angle}", angle)

    @cached_property
    def link_parameters(self) -> FloatArray:
        """Inertial parameters (n, 10 n) that row j of the links' equations uses, in force units.

        Only base parameters are set; the others are nought. Rows differ where each joint has parameters of its own.
        """
        rows = np.zeros((self.n, 10 * self.n))
        for term in self.terms:
            if isinstance(term.effect, Links):
                joints = slice(None) if term.effect.joint is None else term.effect.joint
                rows[joints, term.effect.base(self.robot).columns] = term.coefficients
        return rows

    @cached_property
    def rotor_inertia(self) -> FloatArray:
        """Reflected rotor inertia (n,) in force units per acceleration; nought where it is part of the links'."""
        inertia = np.zeros(self.n)
        for term in self.terms:
            if isinstance(term.effect, RotorInertia):
                inertia[term.effect.joint] += term.coefficients[0]
        return inertia

    @cached_property
    def presliding(self) -> FloatArray:
        """Displacement (n,) over which each joint's dry friction builds up as it turns [rad or m], or nought."""
        return self._of_directions("presliding", 0.0)

    @cached_property
    def presliding_exponent(self) -> FloatArray:
        """Exponent (n,) with which it does."""
        return self._of_directions("presliding_exponent", 1.0)

    def _of_directions(self, name: str, otherwise: float) -> FloatArray:
        values = np.full(self.n, otherwise)
        for term in self.terms:
            if isinstance(term.effect, DirectedEffect):
                values[term.effect.at] = getattr(term.effect, name)
        return values

    def load(self, motion: Motion) -> FloatArray:
        """Force (N, n) that the links need for a motion."""
        return self.robot.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, self.link_parameters)

    def context(self, motion: Motion, total: bool = False) -> Context:
        """Return what effects see of a motion that starts a segment, with load, links and, if asked for, the total."""
        load = self.load(motion)
        return Context(self.robot, motion, load, self.link_parameters, self._ordinary(motion, load) if total else None)

    @cached_property
    def one_sample(self) -> OneSample:
        """The terms that a compiled loop sums where there is one sample."""
        return OneSample(self.terms, self.robot)

    def friction(self, motion: Motion, memories: list[FloatArray] | None = None) -> FloatArray:
        """Force (N, n) of everything but links and rotors, carrying the memories forward (default: from a start)."""
        loaded = len(motion.t) > 1 or self.one_sample.asks_load or self.one_sample.others
        load = self.load(motion) if loaded else np.zeros((1, self.n))
        rotors = self.rotor_inertia * self.robot.motors(motion).ddq
        return self._all(motion, load, self.start() if memories is None else memories) - load - rotors

    def force(self, motion: Motion, memories: list[FloatArray]) -> FloatArray:
        """Force (N, n) of all effects, carrying the memories forward."""
        return self._all(motion, self.load(motion), memories)

    def start(self) -> Memories:
        """Memories of the terms at the start of a segment."""
        return Memories.start(self.terms)

    def predict(self, log: JointLog, causal: bool = False) -> FloatArray:
        """Predict the current (N, n); NaN in rows whose segment is too short to derive velocity from."""
        if not causal:
            return np.concatenate([predicted for _, predicted in self.predict_blocks(log)])
        predicted = np.empty_like(log.q)
        motion = derive(log.positions_only() if self.positions_only else log, self.cutoff, causal=True)
        for segment in log.segments():
            predicted[segment] = self.force(motion[segment], self.start()) / self.gain
        return predicted

    def view(self, source: LogSource) -> LogSource:
        """Return a log as the model looks at it: without its velocities where those are not used."""
        return PositionsOnly(source) if self.positions_only else source

    def predict_blocks(self, source: LogSource) -> Iterator[tuple[JointLog, FloatArray]]:
        """Walk a log and yield (rows, predicted current (rows, n)) with zero-phase filters, in bounded memory."""
        for block, predicted in self.predict_walk(source):
            yield block.log, predicted

    def predict_walk(self, source: LogSource) -> Iterator[tuple[Block, FloatArray]]:
        """Walk a log and yield its blocks, with their motion, and the predicted current (rows, n) of each."""
        memories = self.start()
        for block in walk(self.view(source), self.cutoff):
            if block.first:
                memories = self.start()
            yield block, self.force(block.motion, memories) / self.gain

    def reset(self) -> None:
        """Forget all memory, as at the start of a segment."""
        self._online = (CausalDerivatives(self.rate, self.cutoff, self.n), self.start())

    def step(self, sample: Sample) -> FloatArray:
        """Predict the current (n,) at one sample with the causal filters."""
        if self._online is None:
            self.reset()
            return self.step(sample)
        derivatives, memories = self._online
        q, dq, ddq = derivatives.step(
            sample.t, sample.q, *((None, None) if self.positions_only else (sample.dq, sample.ddq))
        )
        motion = Motion(np.array([sample.t]), q[None], dq[None], ddq[None])
        return (self.force(motion, memories) / self.gain)[0]  # type: ignore[no-any-return]

    def _ordinary(self, motion: Motion, load: FloatArray) -> FloatArray:
        """Force (N, n) of the terms that do not need the total, from the start of a segment."""
        ordinary = [term for term in self.terms if "total" not in term.effect.needs]
        return replace(self, terms=tuple(ordinary))._all(motion, load, [term.effect.start() for term in ordinary])

    def _all(self, motion: Motion, load: FloatArray, memories: list[FloatArray]) -> FloatArray:
        """Force (N, n) of all terms: first those that do not need the total, then those that do."""
        force, left = load.copy(), list(zip(self.terms, memories, strict=True))
        if len(motion.t) == 1 and isinstance(memories, Memories):
            motors = self.robot.motors(motion)
            self.one_sample.add(motors.t[0], motors.q[0], motors.dq[0], motors.ddq[0], load[0], memories, force[0])
            left = [left[k] for k in self.one_sample.others]
            if not left:
                return force
        context = Context(self.robot, motion, load, self.link_parameters)
        for late in (False, True):
            if late:
                context = replace(context, total=force.copy())
            for term, memory in left:
                effect = term.effect
                if ("total" in effect.needs) == late and not isinstance(effect, Links):
                    joints = slice(None) if effect.acts_on is None else effect.acts_on
                    force[:, joints] += effect.current(context, term.shape, term.coefficients, memory)
        return force
