"""The virtual robot under control: forward dynamics, a cascade servo, pushes and hands, sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from comparisons.virtual_robot.contact import Hand, Push, push_effect
from comparisons.virtual_robot.friction import friction_step
from comparisons.virtual_robot.readout import Readout
from comparisons.virtual_robot.robot import VirtualRobot
from ident.arrays import FloatArray
from ident.errors import InputError
from ident.log import JointLog, Sample

Controller = Callable[[Sample], FloatArray]
"""From a sample to the joint velocities [rad/s] or positions [rad] wanted until the next one, (n,)."""

POSITION_GAIN = 25.0  # [1/s]
VELOCITY_BANDWIDTH = 120.0  # [rad/s]
INTEGRAL_RATE = 30.0  # [1/s]
COMMAND_LAG = 0.015  # [s] over which commanded speeds are smoothed
HURRY = 10.0  # [rad/s^2] the commanded speed changes no faster where the robot names no limit


class ClosedLoop:
    """A virtual robot whose servo is commanded at the log's rate.

    The servo is a cascade: speed wanted = commanded speed + gain x position error, then a PI controller of the speed
    makes the motor torque, all at 1 kHz or more; links, friction and contact answer by forward dynamics (semi-implicit
    Euler). Transmissions are rigid.

    Args:
        virtual: the robot.
        start: positions at the start, at rest (n,); default zero, moved inside the limits.
        rate: commands and samples a second [Hz].
        mode: whether commands are joint ``velocity`` or ``position``.
        disturbances: pushes at links and hands on the tool.
        seed: draws the noise and the friction stored at the start.

    Attributes:
        sample: what the drives reported last.

    Raises:
        InputError: the scenario has elasticity or backlash, or gears couple the motors: this loop follows neither.
    """

    def __init__(
        self,
        virtual: VirtualRobot,
        start: FloatArray | None = None,
        rate: float = 100.0,
        mode: Literal["velocity", "position"] = "velocity",
        disturbances: Sequence[Push | Hand] = (),
        seed: int = 0,
    ) -> None:
        laws, limits = virtual.laws, virtual.robot.limits
        if np.any(laws.spring.stiffness > 0.0):
            what = "elasticity or backlash in a closed loop"
            raise InputError(what, f"scenario {virtual.scenario.name}", "take them out: its transmissions are rigid")
        if virtual.robot.coupling is not None:
            what = "coupled motors in a closed loop"
            raise InputError(what, f"robot {virtual.robot.name}", "take [drive] coupling out of its card")
        self.virtual, self.mode, self.rate = virtual, mode, rate
        self._pushes = [d for d in disturbances if isinstance(d, Push)]
        self._hands = [d for d in disturbances if isinstance(d, Hand)]
        self._taken: dict[int, FloatArray] = {}
        self._readout = Readout(laws, rate, seed)
        self._dt = self._readout.dt
        n = virtual.robot.n
        wanted = np.zeros(n) if start is None else np.asarray(start, dtype=np.float64)
        self._lower, self._upper = limits.lower, limits.upper
        self._speed = limits.velocity
        self._hurry = np.where(np.isfinite(limits.acceleration), limits.acceleration, HURRY)
        self._effort = limits.effort
        self.q = np.clip(wanted, limits.lower, limits.upper)
        self.dq, self.ddq = np.zeros(n), np.zeros(n)
        self._friction = virtual.friction_at_start(seed, 0)
        self._inertia = np.diag(virtual.mass_matrix(self.q)).copy()
        self._reference, self._rate_wanted = self.q.copy(), np.zeros(n)
        self._held = virtual.rigid_torque(self.q, self.dq, self.ddq) + virtual.hanging_torque(self.q[None])[0]
        self._load = self._held.copy()
        self._lost = self._friction.force.sum(axis=1)
        # the integrators carry the arm and the stored friction, as they would after standing for long
        self._integral = self._held + self._lost
        self._steps = 0
        self.tau_ext, self.wrench = np.zeros(n), np.zeros(6)
        self.sample = self._period(np.zeros(n))

    def step(self, command: FloatArray) -> Sample:
        """Apply a command (n,) until the next sample, and return that sample.

        Raises:
            InputError: the command has not one finite value a joint.
        """
        wanted = np.asarray(command, dtype=np.float64)
        if wanted.shape != self.q.shape or not np.all(np.isfinite(wanted)):
            what = f"a command of shape {wanted.shape}, {wanted}"
            raise InputError(what, "closed loop", f"give {len(self.q)} finite values")
        if self.mode == "position":
            wanted = (np.clip(wanted, self._lower, self._upper) - self._reference) * self.rate
        self.sample = self._period(np.clip(wanted, -self._speed, self._speed))
        return self.sample

    def run(self, controller: Controller, seconds: float, derivatives: bool = False, name: str = "loop") -> JointLog:
        """Let a controller command the robot, and return the log with the true ``tau_ext`` and ``wrench``.

        ``derivatives`` logs the true velocities and accelerations too. The first row is the sample at hand.
        """
        rows = round(seconds * self.rate)
        n = len(self.q)
        t, q, current, pushed = np.empty(rows), np.empty((rows, n)), np.empty((rows, n)), np.empty((rows, n))
        wrench, dq, ddq = np.empty((rows, 6)), np.empty((rows, n)), np.empty((rows, n))
        for row in range(rows):
            sample = self.sample
            t[row], q[row], current[row] = sample.t, sample.q, sample.current
            pushed[row], wrench[row], dq[row], ddq[row] = self.tau_ext, self.wrench, self.dq, self.ddq
            if row + 1 < rows:
                self.step(controller(sample))
        log = JointLog(t=t, q=q, current=current, tau_ext=pushed, wrench=wrench, name=name)
        return log.replace(dq=dq, ddq=ddq) if derivatives else log

    def _period(self, speed: FloatArray) -> Sample:
        """Go on by one period of the log at the commanded speed."""
        substeps = self._readout.substeps
        steps = self._steps + np.arange(1.0, substeps + 1.0)
        times: FloatArray = np.asarray(steps * self._dt - 1.0 / self.rate, dtype=np.float64)
        q, torque = np.empty((substeps, len(self.q))), np.empty((substeps, len(self.q)))
        for k in range(substeps):
            torque[k] = self._inner_step(float(times[k]), speed)
            q[k] = self.q
        self._steps += substeps
        seen, current = self._readout.read(times, q, torque)
        return Sample(float(times[-1]), seen[0], current[0])

    def _inner_step(self, t: float, speed: FloatArray) -> FloatArray:
        """Integrate one inner step, and return the motor torque (n,) that acted in it."""
        virtual, laws, dt = self.virtual, self.virtual.laws, self._dt
        motor = self._servo(speed)
        self._feel(t)
        still = np.zeros_like(self.q)
        passive = virtual.rigid_torque(self.q, self.dq, still) + virtual.hanging_torque(self.q[None])[0]
        gears = virtual.gear_torque(self.q[None], self.dq[None], self._load[None])[0]
        net = motor + self.tau_ext - passive - gears - self._lost
        self.ddq = np.linalg.solve(virtual.mass_matrix(self.q), net)
        self.dq = self.dq + dt * self.ddq
        travel = dt * self.dq
        self.q = self.q + travel
        self._load = motor - laws.rotor_inertia * self.ddq - gears - self._lost
        lost = np.empty_like(self.q)
        friction_step(laws.friction, self._friction, self.q, travel, self.dq, self._load, dt, lost)
        self._lost = lost
        return motor

    def _servo(self, speed: FloatArray) -> FloatArray:
        dt = self._dt
        change = np.clip((speed - self._rate_wanted) * dt / COMMAND_LAG, -self._hurry * dt, self._hurry * dt)
        self._rate_wanted = self._rate_wanted + change
        reference = self._reference + dt * self._rate_wanted
        self._reference = np.clip(reference, self._lower, self._upper)
        ahead = np.where(reference == self._reference, self._rate_wanted, 0.0)
        error = ahead + POSITION_GAIN * (self._reference - self.q) - self.dq
        wanted = self._inertia * VELOCITY_BANDWIDTH * error + self._integral
        motor: FloatArray = np.clip(wanted, -self._effort, self._effort)
        # an integrator that cannot act does not go on integrating
        free = motor == wanted
        self._integral = self._integral + free * dt * INTEGRAL_RATE * VELOCITY_BANDWIDTH * self._inertia * error
        return motor

    def _feel(self, t: float) -> None:
        """Find what pushes and hands do to the joints now."""
        kinematics = self.virtual.kinematics
        self.tau_ext, self.wrench = np.zeros_like(self.q), np.zeros(6)
        pushes = [p for p in self._pushes if p.start <= t <= p.start + p.duration]
        if pushes:
            torque, wrench = push_effect(kinematics, pushes, np.array([t]), self.q[None])
            self.tau_ext, self.wrench = torque[0], wrench[0]
        for number, hand in enumerate(self._hands):
            if not hand.holds(t):
                self._taken.pop(number, None)
                continue
            jacobian, tool = kinematics.jacobian(self.q, kinematics.last, kinematics.tool)
            taken = self._taken.setdefault(number, tool)
            force = hand.force_at(t, taken, tool, jacobian[:3] @ self.dq)
            self.tau_ext = self.tau_ext + jacobian[:3].T @ force
            self.wrench = self.wrench + np.concatenate([force, np.zeros(3)])


def run_closed_loop(
    virtual: VirtualRobot,
    controller: Controller,
    seconds: float,
    disturbances: Sequence[Push | Hand] = (),
    start: FloatArray | None = None,
    rate: float = 100.0,
    mode: Literal["velocity", "position"] = "velocity",
    seed: int = 0,
    derivatives: bool = False,
) -> JointLog:
    """Return the log of a robot under a controller, with the true ``tau_ext`` and ``wrench``; see `ClosedLoop`.

    ::

        push = Push(link=3, point=(0.0, 0.0, 0.1), force=(0.0, 20.0, 0.0), start=1.0, duration=2.0)
        log = run_closed_loop(virtual, lambda sample: np.zeros(6), seconds=5.0, disturbances=[push])

    Args:
        virtual: the robot.
        controller: takes a sample, returns joint velocities or positions to command, (n,).
        seconds: how long.
        disturbances: pushes at links and hands that hold the tool.
        start: joint positions to begin at, at rest (n,); default zero, moved inside the limits.
        rate: samples and commands a second [Hz].
        mode: what the controller commands.
        seed: draws the noise and the friction stored at the start.
        derivatives: see `ClosedLoop.run`.
    """
    loop = ClosedLoop(virtual, start, rate, mode, disturbances, seed)
    return loop.run(controller, seconds, derivatives)
