"""Adapting a trained predictor to a changed payload from a few seconds of motion, the network left as it is.

A payload is a rigid body on the last link: it adds ``c_j [Y(q, dq, ddq) pi]_j`` to joint j's current, with the ten
inertial parameters pi of the payload, the regressor Y of the last link and the current c_j per torque. What the frozen
predictor leaves of the measured current shows pi. Where the drive gains are unknown, so are the c_j; then pi and c are
found in turn, each by least squares, which a product of two unknowns allows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from ident.arrays import BoolArray, FloatArray
from ident.causal import CausalDerivatives
from ident.errors import InputError
from ident.log import JointLog, Sample
from ident.model import CurrentModel
from ident.predictor import CurrentPredictor
from ident.signals import Motion
from learned.window import Frames, decimation, frames_of

if TYPE_CHECKING:
    from ident.robot import Robot

PAYLOAD_SPREAD = np.array([3.0, *[0.2] * 3, *[0.01] * 6])
"""What a payload's parameters may be [kg, kg m, kg m^2], as standard deviations of their prior about no change."""
SCALE_SPREAD = (0.15, 1.0)
"""Standard deviation of the prior on current per torque, relative to its first estimate: where the CAD torque explains
all of a joint's current, and at most."""
CORRELATION = 0.3
"""Time [s] over which a predictor's error is taken to stay alike where no longer log tells."""
ALIKE = 4.0
"""Longest time [s] over which a predictor's error is taken to stay alike, as friction does from one reversal to the
next: that many samples say no more than one."""
SETTLING = 3.0
"""Periods of the cut-off until the filters have forgotten how they began."""
ROUNDS = 10


class RatedPredictor(CurrentPredictor, Protocol):
    """A predictor that knows the rate [Hz] and the cut-off [Hz] of its filters."""

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""

    @property
    def cutoff(self) -> float:
        """Cut-off [Hz] of the filters that derive velocity and acceleration."""


class AdaptedModel:
    """A predictor and the current of a payload it does not know; a ``CurrentPredictor``.

    Args:
        predictor: at the rate of the samples it will be given.
        robot: that carries the payload.
        payload: see the attributes.
        scale: see the attributes.

    Attributes:
        predictor: the frozen predictor.
        payload: inertial parameters of what was added to the last link, in its joint's frame, Pinocchio's order, (10,).
        scale: current per joint torque [unit/N m], (n,).
    """

    def __init__(self, predictor: RatedPredictor, robot: Robot, payload: FloatArray, scale: FloatArray) -> None:
        self.predictor = predictor
        self.payload = payload
        self.scale = scale
        self._body = robot.rigid_body
        self._parameters = np.zeros((robot.n, 10 * robot.n))
        self._parameters[:, last_link(robot)] = np.outer(scale, payload)
        self._filters = CausalDerivatives(predictor.rate, predictor.cutoff, robot.n)

    @property
    def unit(self) -> str:
        """Unit of the predicted current."""
        return self.predictor.unit

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.predictor.n

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return self.predictor.rate

    @property
    def cutoff(self) -> float:
        """Cut-off [Hz] of the filters that derive velocity and acceleration."""
        return self.predictor.cutoff

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""
        self.predictor.reset()
        self._filters.reset()

    def step(self, sample: Sample) -> FloatArray:
        """Predict the current (n,) at one sample at the predictor's rate."""
        motion = _advanced(*self._filters.step(sample.t, sample.q, sample.dq, sample.ddq), self.cutoff)
        return self.predictor.step(sample) + self._body.inverse_dynamics(*motion, self._parameters)

    def predict(self, log: JointLog, causal: bool = False) -> FloatArray:
        """Predict the current (N, n) of a whole log; the payload's part from the filters that run online."""
        motion = _frames(log, self.predictor).motion
        advanced = _advanced(motion.q, motion.dq, motion.ddq, self.cutoff)
        added = self._body.inverse_dynamics(*advanced, self._parameters)
        return self.predictor.predict(log, causal) + added


def adapt_payload(
    predictor: RatedPredictor,
    robot: Robot,
    log: JointLog,
    reference: JointLog | None = None,
    identified: CurrentModel | None = None,
) -> AdaptedModel:
    """Identify what was added to the last link (or taken off) since a predictor was made.

    Maximum a posteriori estimate with the prior that nothing changed: directions that the motion does not show stay
    as they were, so a short log can only help.

    Args:
        predictor: predictor made with the former payload.
        robot: the robot; its gains are used where known.
        log: a few seconds of motion with the new payload, touching nothing.
        reference: a longer log from before, a training log for instance. How slowly the predictor's error changes on it
            says how much to believe of ``log``. With unknown gains, what the predictor expects on it, held against the
            torque of the CAD masses, also says how much current a joint takes for a torque; by default ``log`` itself
            has to say so, and a short one hardly can.
        identified: with unknown gains, a model identified from before, whose links say it better, as they are free of
            friction; by default that on which a hybrid stands.

    Raises:
        InputError: the log does not fit, or holds less than a second that can be used.
    """
    frames = _frames(log, predictor)
    left = log.current - predictor.predict(log, causal=True)
    use = _settled(frames, log, predictor) & np.isfinite(left).all(axis=1)
    if use.sum() < predictor.rate:
        what = f"{use.sum()} samples that can be used"
        raise InputError(what, f"log {log.name}", "give at least a second of motion, better four")
    left, motion = left[use], frames.motion
    body = robot.rigid_body
    regressor = body.regressor(*_advanced(motion.q[use], motion.dq[use], motion.ddq[use], predictor.cutoff))[
        :, :, last_link(robot)
    ]
    if robot.gain is not None:
        first, spread = 1.0 / robot.gain, np.zeros(robot.n)
    else:
        physics = identified or getattr(predictor, "physics", None)
        plain = physics if isinstance(physics, CurrentModel) else None
        first, spread = _current_per_torque(predictor, robot, log if reference is None else reference, plain)
    alike = np.full(robot.n, CORRELATION * predictor.rate) if reference is None else _alike(predictor, reference)
    return AdaptedModel(predictor, robot, *_payload_and_scale(regressor, left, first, spread, np.maximum(alike, 1.0)))


def _payload_and_scale(
    regressor: FloatArray, left: FloatArray, first: FloatArray, spread: FloatArray, alike: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameters (10,) of the payload and current per torque (n,), in turn: each is linear where the other is known.

    Args:
        regressor: (N, n, 10) of the payload's torques.
        left: current (N, n) that it explains.
        first: current per torque (n,) as known before, and
        spread: its standard deviation over it (n,); nought where it is sure.
        alike: samples (n,) over which errors are alike.
    """
    payload, scale = np.zeros(10), first
    for _ in range(ROUNDS):
        error = left - scale * (regressor @ payload)
        noise = np.maximum(np.mean(error**2, axis=0), 1e-12) * alike
        payload = _payload(regressor, left, scale, noise)
        torque = regressor @ payload
        # The inverse of the prior's variance would be infinite where the scale is sure.
        trust = (spread * first) ** 2
        found = (trust * np.sum(torque * left, axis=0) + noise * first) / (trust * np.sum(torque**2, axis=0) + noise)
        scale = np.maximum(found, 0.05 * first)
    return payload, scale


def last_link(robot: Robot) -> slice:
    """Columns of the last link's parameters: the link at the end of the chain, which carries the tool.

    Args:
        robot: the robot.
    """
    last = int(robot.multibody.tree.order[-1])
    return slice(10 * last, 10 * last + 10)


def _frames(log: JointLog, predictor: RatedPredictor) -> Frames:
    """Causal motion of every row of a log."""
    return frames_of(log, predictor.rate * decimation(log, predictor.rate), predictor.cutoff)


def _advanced(
    q: FloatArray, dq: FloatArray, ddq: FloatArray, cutoff: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Carry filtered motion forward by the delay of the causal third-order low pass, 2 over its angular cut-off.

    A network learns to make up for that delay; the payload's rigid body has to be told.
    """
    delay = 1.0 / (np.pi * cutoff)
    return q + delay * dq + 0.5 * delay**2 * ddq, dq + delay * ddq, ddq


def _payload(rows: FloatArray, left: FloatArray, scale: FloatArray, noise: FloatArray) -> FloatArray:
    """Most probable parameters (10,) given current per torque and the variance of each joint's error."""
    weight = scale**2 / noise
    information = np.einsum("kja,kjb,j->ab", rows, rows, weight, optimize=True)
    seen = np.einsum("kja,kj,j->a", rows, left, scale / noise, optimize=True)
    # Scaled to the prior's spread, so that the matrix is no worse conditioned than the data make it.
    spread = PAYLOAD_SPREAD
    matrix = information * np.outer(spread, spread) + np.eye(10)
    return np.asarray(spread * np.linalg.solve(matrix, spread * seen))


def _alike(predictor: RatedPredictor, log: JointLog) -> FloatArray:
    """Number (n,) of successive samples of a predictor's error that say no more than one.

    The variance of means over ``ALIKE`` seconds is that of the error over the number of independent ones among them.
    """
    error = log.current - predictor.predict(log, causal=True)
    error = error[np.isfinite(error).all(axis=1)]
    rows = min(round(ALIKE * log.rate), len(error) // 2)
    parts = error[: len(error) // rows * rows].reshape(-1, rows, error.shape[1])
    return np.asarray(np.clip(rows * parts.mean(axis=1).var(axis=0) / parts.var(axis=(0, 1)), 1.0, rows))


def _current_per_torque(
    predictor: RatedPredictor, robot: Robot, log: JointLog, physics: CurrentModel | None
) -> tuple[FloatArray, FloatArray]:
    """First estimate (n,) of current per torque, the slope of prediction over CAD torque, and its relative spread (n,).

    The prediction is that of the links of ``physics``, else the predictor's, friction and all; then a joint whose
    friction drowns the torque in this log takes the median of the others.
    """
    frames = _frames(log, predictor)
    current = predictor.predict(log, causal=True) if physics is None else np.zeros(log.q.shape)
    use = _settled(frames, log, predictor) & np.isfinite(current).all(axis=1)
    q, dq, ddq = (x[use] for x in (frames.motion.q, frames.motion.dq, frames.motion.ddq))
    advanced = _advanced(q, dq, ddq, predictor.cutoff)
    torque = robot.rigid_body.inverse_dynamics(*advanced, robot.multibody.parameters)
    current = current[use] if physics is None else physics.load(Motion(log.t[use], *advanced)) / physics.gain
    slope, share = np.zeros(robot.n), np.zeros(robot.n)
    for joint in range(robot.n):
        y = current[:, joint]
        friction = [np.tanh(dq[:, joint] / 0.02), dq[:, joint]] if physics is None else []
        others = np.stack([*friction, np.ones(len(dq))], axis=1)
        bare = torque[:, joint] - others @ np.linalg.lstsq(others, torque[:, joint], rcond=None)[0]
        slope[joint] = bare @ y / max(float(bare @ bare), 1e-30)
        share[joint] = slope[joint] ** 2 * float(bare @ bare) / max(float(np.sum((y - y.mean()) ** 2)), 1e-30)
    good = (slope > 0.0) & (share > 0.02)
    scale = np.where(good, slope, np.median(slope[good])) if good.any() else np.ones(robot.n)
    return scale, np.clip(SCALE_SPREAD[0] / np.sqrt(np.where(good, share, 1e-9)), *SCALE_SPREAD)


def _settled(frames: Frames, log: JointLog, predictor: RatedPredictor) -> BoolArray:
    """Rows whose motion is known and no longer shows that the filters began at rest, as a log need not."""
    settled = frames.finite.copy()
    for rows in frames.segments:
        settled[rows.start : rows.start + round(SETTLING * log.rate / predictor.cutoff)] = False
    return settled
