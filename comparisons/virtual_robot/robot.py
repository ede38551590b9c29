"""The virtual robot under a prescribed motion: commands in, logs out, block by block."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from comparisons.virtual_robot.contact import push_effect
from comparisons.virtual_robot.friction import FrictionState, cross_friction, friction_scan, stopped
from comparisons.virtual_robot.kinematics import Kinematics
from comparisons.virtual_robot.load import balancer, cable
from comparisons.virtual_robot.motion import Protocol, ReferenceBlock, reblocked
from comparisons.virtual_robot.readout import Readout
from comparisons.virtual_robot.scenario import Scenario, built_in_scenarios, load_scenario
from comparisons.virtual_robot.servo import PositionLoop
from comparisons.virtual_robot.transmission import ripple, spring_scan
from comparisons.virtual_robot.truth import Truth
from ident.arrays import FloatArray
from ident.log import JointLog
from ident.readers.source import join
from ident.rigid_body import RigidBody
from ident.robot import Robot

BLOCK = 2048  # rows simulated at once: about 10 MB of intermediate results
SEGMENT_PAUSE = 5.0  # [s] between the last row of a segment and the first of the next


class VirtualRobot:
    """A robot whose truth is known: motion in, positions and currents out.

    Five lines from nothing to a log::

        from ident.robot import load_robot
        from comparisons.virtual_robot import VirtualRobot
        from comparisons.protocols import sinusoid
        virtual = VirtualRobot(load_robot("vs060"))
        log = virtual.record(sinusoid(virtual.robot, seconds=60.0, seed=1), seed=1)

    Args:
        robot: any robot with a card.
        scenario: what is true of it: a `Scenario`, the name of a built-in one or the path of a TOML file; by default
            the built-in scenario of the robot's name, or ``generic``.

    Attributes:
        truth: every true figure, as a dict (see `Truth.as_dict`).
    """

    def __init__(self, robot: Robot, scenario: Scenario | str | None = None) -> None:
        if scenario is None:
            scenario = robot.name if robot.name in built_in_scenarios() else "generic"
        self.robot = robot
        self.scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        self.laws = Truth(robot, self.scenario)
        self.kinematics = Kinematics(robot.multibody)
        self._body = RigidBody(robot.multibody)
        self._parameters = np.tile(self.laws.link_parameters, (robot.n, 1))

    @property
    def truth(self) -> dict[str, Any]:
        """Every true figure by name."""
        return self.laws.as_dict()

    def simulate(
        self,
        blocks: Iterable[ReferenceBlock],
        rate: float = 100.0,
        seed: int = 0,
        derivatives: bool = False,
        external: bool | None = None,
        name: str = "virtual",
        rows: int = BLOCK,
    ) -> Iterator[JointLog]:
        """Yield the log of a motion, block by block, in bounded memory; the same however the motion is blocked.

        Args:
            blocks: the commanded motion, sampled at ``rate`` [Hz]; every segment starts at rest.
            rate: sampling rate of commands and log [Hz].
            seed: draws the sensors' noise and the friction stored before each segment.
            derivatives: log the true velocities and accelerations of the motors too.
            external: log the true ``tau_ext`` and ``wrench``; by default in segments that have pushes.
            name: name of the log.
            rows: rows simulated at once; they bound the memory and change nothing else.
        """
        run = _Run(self, rate, seed)
        for block in reblocked(blocks, rows):
            yield run.advance(block, derivatives, external, name)

    def record(self, protocol: Protocol, seed: int = 0, **options: Any) -> JointLog:
        """Return the whole log of a protocol in memory; ``options`` as for `simulate`."""
        blocks = self.simulate(protocol.blocks(), protocol.rate, seed, name=protocol.name, **options)
        return join(list(blocks))

    def rigid_torque(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """Return what the true links ask of the joints along a motion, (N, n) each [N m]."""
        return self._body.inverse_dynamics(q, dq, ddq, self._parameters, self.laws.gravity)

    def hanging_torque(self, q: FloatArray) -> FloatArray:
        """Return what cables and balancers ask of the joints at positions (N, n) [N m]."""
        torque = np.zeros_like(q)
        if self.laws.cable is not None:
            torque += cable(self.laws.cable, q)
        if self.laws.balancer is not None:
            torque += balancer(self.laws.balancer, q)
        return torque

    def gear_torque(self, q: FloatArray, dq: FloatArray, transmitted: FloatArray) -> FloatArray:
        """Return what ripples and shared gears ask of the motors, (N, n), under the transmitted torque [N m]."""
        torque = cross_friction(self.laws.cross_friction, dq)
        for law in self.laws.ripples:
            torque += ripple(law, q, transmitted)
        return torque

    def friction_at_start(self, seed: int, segment: int) -> FrictionState:
        """Return friction as an unknown earlier motion left it, drawn from the seed for each segment."""
        share = np.random.default_rng([seed, segment, 7]).uniform(-1.0, 1.0, self.robot.n)
        return stopped(self.laws.friction, self.laws.stored_at_start * share)

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Return the true mass matrix with the motors' reflected inertia, (n, n), at ``q`` (n,)."""
        mass: FloatArray = self._body.mass_matrix(q, self._parameters) + np.diag(self.laws.rotor_inertia)
        return mass


@dataclass
class _Run:
    """One simulation under way: the memory of servo, friction, springs, filters and sensors."""

    virtual: VirtualRobot
    rate: float
    seed: int

    def __post_init__(self) -> None:
        laws, servo = self.virtual.laws, self.virtual.laws.servo
        self.coupling = self.virtual.robot.coupling
        self.readout = Readout(laws, self.rate, self.seed)
        self.dt = self.readout.dt
        self.loop = PositionLoop(*servo, substeps=self.readout.substeps, dt=self.dt)
        self.segment: int | None = None
        self.heat = np.zeros(laws.n)
        self.clock = 0.0

    def advance(self, block: ReferenceBlock, derivatives: bool, external: bool | None, name: str) -> JointLog:
        """Simulate one block and return its rows."""
        if block.segment != self.segment:
            self._start(block)
        rows, substeps = len(block.q), self.readout.substeps
        since = (self.row + np.arange(1, rows * substeps + 1) / substeps - 1.0) / self.rate
        q, dq, ddq = self.loop.follow(block.q)
        pushed, wrench = push_effect(self.virtual.kinematics, block.pushes, since, q)
        torque = self._motor_torque(q, dq, ddq, pushed)
        seen, reported = self.readout.read(self.start + since, q, torque)
        logged = slice(substeps - 1, None, substeps)
        t = self.start + (self.row + np.arange(rows)) / self.rate
        self.row += rows
        self.clock = float(t[-1]) + SEGMENT_PAUSE
        told = bool(block.pushes) if external is None else external
        return JointLog(
            t=t,
            q=seen,
            current=reported,
            dq=dq[logged] if derivatives else None,
            ddq=ddq[logged] if derivatives else None,
            tau_ext=pushed[logged] if told else None,
            wrench=wrench[logged] if told else None,
            segment=np.full(rows, block.segment, dtype=np.int64),
            name=name,
        )

    def _start(self, block: ReferenceBlock) -> None:
        """Stand at the first command with friction stored by an unknown earlier motion; the joints keep their heat."""
        self.readout.restart()
        self.segment, self.row, self.start = block.segment, 0, self.clock
        self.loop.reset(block.q[0])
        self.before = block.q[0].copy() if self.coupling is None else self.coupling.motor_motion(block.q[0])
        state = self.virtual.friction_at_start(self.seed, block.segment)
        self.state = FrictionState(state.force, state.slipping, state.anchor, self.heat)
        self.spring: FloatArray | None = None

    def _motor_torque(self, q: FloatArray, dq: FloatArray, ddq: FloatArray, pushed: FloatArray) -> FloatArray:
        """Return the torque that the motors give along the inner steps of a block, (M, n)."""
        laws = self.virtual.laws
        torque = self.virtual.rigid_torque(q, dq, ddq)
        elastic = laws.spring.stiffness > 0.0
        if np.any(elastic):  # links hang behind the motors by the wind-up of the springs
            wind = np.where(elastic, torque / np.where(elastic, laws.spring.stiffness, 1.0), 0.0)
            torque = self.virtual.rigid_torque(q - wind, dq, ddq)
        torque += self.virtual.hanging_torque(q) - pushed
        if np.any(elastic):
            if self.spring is None:
                self.spring = np.stack([laws.spring.settled(torque[0]), np.zeros(laws.n)])
            torque = spring_scan(laws.spring, self.spring, torque, self.dt)
        if self.coupling is not None:  # of the joints until here, of the motors from here on
            torque = self.coupling.motor_force(torque)
            q, dq, ddq = map(self.coupling.motor_motion, (q, dq, ddq))
        motor = torque + laws.rotor_inertia * ddq
        motor += friction_scan(laws.friction, self.state, q, dq, torque, self.before, self.dt)
        motor += self.virtual.gear_torque(q, dq, torque)
        self.before = q[-1].copy()
        return motor


def simulate(
    robot: Robot,
    protocol: str = "sinusoid",
    seconds: float = 60.0,
    seed: int = 0,
    scenario: Scenario | str | None = None,
    **options: Any,
) -> tuple[JointLog, dict[str, Any]]:
    """Return the log of a protocol named in `comparisons.protocols`, and the truth behind it.

    ::

        log, truth = simulate(load_robot("vs060"), protocol="sinusoid", seconds=60.0, seed=1)

    Args:
        robot: any robot with a card.
        protocol: ``sinusoid``, ``fourier``, ``continuous``, ``stop_and_go``, ``plateaus`` ... (`protocols.named`).
        seconds: about how long; protocols that repeat a pattern end with a whole one.
        seed: draws motion and noise.
        scenario: what is true of the robot (see `VirtualRobot`).
        options: further arguments of the protocol, such as ``rate``.

    Raises:
        InputError: no protocol or scenario of that name.
    """
    from comparisons.protocols import named

    virtual = VirtualRobot(robot, scenario)
    return virtual.record(named(protocol)(robot, seconds=seconds, seed=seed, **options), seed), virtual.truth
