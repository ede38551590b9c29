"""What is true of one virtual robot: a scenario's figures worked out, joint by joint, for a given mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from comparisons.virtual_robot.answers import true_figures
from comparisons.virtual_robot.electrical import Drive
from comparisons.virtual_robot.figures import USUAL_ACCELERATION, Figures, reach, usual_torque
from comparisons.virtual_robot.friction import CrossFriction, FrictionLaw
from comparisons.virtual_robot.load import Balancer, Cable, payload_parameters, perturbed, tilted
from comparisons.virtual_robot.scenario import Scenario
from comparisons.virtual_robot.sensors import SensorFigures
from comparisons.virtual_robot.tables import Friction
from comparisons.virtual_robot.transmission import Ripple, Spring
from ident.arrays import FloatArray
from ident.errors import InputError
from ident.robot import Robot


@dataclass(frozen=True)
class Truth:
    """The laws and figures of a virtual robot.

    Build it with ``Truth(robot, scenario)``; every law is a property. `as_dict` gives plain figures for comparison.

    Raises:
        InputError: a table of the scenario gives another number of values than the robot has joints.
    """

    robot: Robot
    scenario: Scenario

    def __post_init__(self) -> None:
        self.as_dict()

    @cached_property
    def _figures(self) -> Figures:
        return Figures(self.scenario, self.robot.n)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.robot.n

    @cached_property
    def usual_torque(self) -> FloatArray:
        """Largest torque that gravity and moderate acceleration ask of each joint [N m], (n,)."""
        return usual_torque(self.robot)

    @cached_property
    def link_parameters(self) -> FloatArray:
        """True link parameters (10n,), payload included; Pinocchio's order, card order of the joints."""
        links = self.scenario.links
        parameters = perturbed(self.robot.multibody.parameters, links.spread, links.seed)
        payload = self.scenario.payload
        if payload is not None:
            last = 10 * int(self.robot.multibody.tree.order[-1])
            parameters[last : last + 10] += payload_parameters(
                payload.mass, np.array(payload.com), np.diag(payload.inertia)
            )
        return parameters

    @cached_property
    def gravity(self) -> FloatArray:
        """Gravity in the base frame as it stands [m/s^2], (3,)."""
        tilt = self.scenario.base_tilt
        level = np.asarray(self.robot.multibody.gravity, dtype=np.float64)
        return level if tilt is None else tilted(level, tilt.roll, tilt.pitch)

    @cached_property
    def nominal_gain(self) -> FloatArray:
        """Gain the maker would print [N m per unit of current], (n,): the scenario's, the card's, or a usual one.

        Left out by both, it is such that the usual torque takes 67 units of a percentage or 5 of another unit.
        """
        given = self.scenario.motors.gain
        if given is None and self.robot.gain is not None:
            return self.robot.gain.copy()
        return self._figures.each(given, "motors.gain", self.usual_torque * (0.015 if "%" in self.robot.unit else 0.2))

    @cached_property
    def gain(self) -> FloatArray:
        """True gain [N m per unit of current], (n,)."""
        effect = self.scenario.drive_gain
        if effect is None:
            return self.nominal_gain
        factor = self._figures.each(effect.factor, "drive_gain.factor")
        gain: FloatArray = self.nominal_gain * (1.0 + self._figures.strength("drive_gain") * (factor - 1.0))
        return gain

    @cached_property
    def usual_current(self) -> FloatArray:
        """Current for the usual torque, in its unit, (n,)."""
        current: FloatArray = self.usual_torque / self.nominal_gain
        return current

    @cached_property
    def rotor_inertia(self) -> FloatArray:
        """Motor inertia reflected to the joints [kg m^2], (n,)."""
        return self._figures.each(
            self.scenario.motors.inertia, "motors.inertia", 0.08 * self.usual_torque / USUAL_ACCELERATION
        )

    @cached_property
    def gear_ratio(self) -> FloatArray:
        """Motor turns per joint turn, (n,)."""
        known = self.robot.gear_ratio
        default = np.full(self.n, 100.0) if known is None else known
        return self._figures.each(self.scenario.motors.gear_ratio, "motors.gear_ratio", default)

    @cached_property
    def friction(self) -> FrictionLaw:
        """Friction with memory; all torques zero where the scenario has none."""
        s = self.scenario
        n = self.n
        f = s.friction if s.friction is not None else Friction()
        strength = self._figures.strength("friction")
        coulomb = strength * self._figures.each(f.coulomb, "friction.coulomb", 0.12 * self.usual_torque)
        static = coulomb * self._figures.each(f.breakaway, "friction.breakaway")
        share = np.linspace(1.5, 0.5, f.elements) / f.elements
        slip = np.geomspace(*f.slip, f.elements)
        stribeck = self._figures.each(f.stribeck_speed, "friction.stribeck_speed")
        loosening, kept = self._figures.loosening()
        heat = s.thermal_friction
        power = 0.2 * coulomb + 1e-9
        return FrictionLaw(
            coulomb=coulomb,
            static=static,
            share=np.tile(share, (n, 1)),
            stiffness=static[:, None] * share / slip,
            # elements that let go late belong to larger contacts, whose film builds up at higher speeds
            stribeck=stribeck[:, None] * np.linspace(0.7, 1.4, f.elements),
            attraction=self._figures.each(f.attraction, "friction.attraction"),
            viscous=strength * self._figures.each(f.viscous, "friction.viscous", 0.12 * self.usual_torque),
            thinning=self._figures.weakened("viscous_nonlinear", "thinning_speed"),
            load=self._figures.effect("load_friction", "coefficient", np.zeros(n)),
            asymmetry=self._figures.effect("coulomb_asymmetry", "share", np.zeros(n)),
            position=self._figures.effect("position_friction", "share", np.zeros(n)),
            phase=self._figures.each(
                s.position_friction.phase if s.position_friction else 0.0, "position_friction.phase"
            ),
            loosening=loosening,
            kept=kept,
            heat_share=self._figures.effect("thermal_friction", "share", np.zeros(n)),
            heat_power=self._figures.each(heat.power if heat else None, "thermal_friction.power", power),
            heat_time=self._figures.each(heat.seconds if heat else 1.0, "thermal_friction.seconds"),
        )

    @cached_property
    def cross_friction(self) -> CrossFriction:
        """Friction of parts that two joints turn; no pairs where the scenario has none."""
        effect = self.scenario.cross_joint_friction
        pairs = np.array(effect.pairs if effect else [], dtype=np.float64).reshape(-1, 2) - 1
        if effect is None or len(pairs) == 0:
            return CrossFriction(*(np.zeros(0) for _ in range(5)))
        if pairs.min() < 0 or pairs.max() >= self.n:
            what = "cross_joint_friction.pairs names a joint the robot does not have"
            raise InputError(what, f"scenario {self.scenario.name}", f"count joints from 1 to {self.n}")
        usual = 0.06 * np.sqrt(np.prod(self.usual_torque[pairs.astype(np.int64)], axis=1))
        strength = self._figures.strength("cross_joint_friction")[pairs[:, 0].astype(np.int64)]
        force = strength * (usual if effect.force is None else np.full(len(pairs), effect.force))
        ones = np.ones(len(pairs))
        return CrossFriction(pairs[:, 0], pairs[:, 1], effect.ratio * ones, force, effect.speed * ones)

    @cached_property
    def spring(self) -> Spring:
        """Elasticity and backlash; stiffness 0 marks rigid joints."""
        elastic = self.scenario.elasticity
        inertia = np.diag(self.robot.multibody.mass_matrix(np.clip(np.zeros(self.n), *reach(self.robot)))).copy()
        usual = inertia * (2.0 * np.pi * 30.0) ** 2  # a resonance of 30 Hz
        stiffness = self._figures.each(elastic.stiffness if elastic else None, "elasticity.stiffness", usual)
        gap = self._figures.effect("backlash", "gap", np.zeros(self.n))
        softness = self._figures.strength("elasticity")
        on = (softness > 0.0) | (gap > 0.0)
        damping = self._figures.each(elastic.damping if elastic else 0.2, "elasticity.damping")
        return Spring(np.where(on, stiffness / np.where(softness > 0.0, softness, 1.0), 0.0), inertia, damping, gap)

    @cached_property
    def ripples(self) -> list[Ripple]:
        """Ripples of gears and of motor poles that the scenario has."""
        found = []
        for key, default in (("gear_ripple", 0.02), ("cogging", 0.015)):
            effect = getattr(self.scenario, key)
            if effect is not None:
                force = self._figures.effect(key, "force", default * self.usual_torque)
                turns = self.gear_ratio * self._figures.each(effect.per_turn, f"{key}.per_turn")
                load = self._figures.each(getattr(effect, "load", 0.0), f"{key}.load") / self.usual_torque
                phase = 1.0 + np.arange(self.n, dtype=np.float64)
                found.append(Ripple(force, turns, phase, load))
        return found

    @cached_property
    def cable(self) -> Cable | None:
        """The cable, if there is one."""
        effect = self.scenario.cable_spring
        if effect is None:
            return None
        stiffness = self._figures.effect("cable_spring", "stiffness", 0.04 * self.usual_torque)
        neutral = self._figures.each(effect.neutral, "cable_spring.neutral")
        return Cable(stiffness, neutral, self._figures.each(effect.reach, "cable_spring.reach"))

    @cached_property
    def balancer(self) -> Balancer | None:
        """The gravity balancer, if there is one: in phase with the joint's own gravity torque."""
        effect = self.scenario.gravity_balancer
        if effect is None:
            return None
        share = self._figures.effect("gravity_balancer", "share", np.zeros(self.n))
        torque, neutral = np.zeros(self.n), np.zeros(self.n)
        body = self.robot.multibody.with_parameters(self.link_parameters)
        for joint in np.flatnonzero(share):
            angles = np.linspace(-np.pi, np.pi, 24, endpoint=False)
            pose = np.clip(np.zeros(self.n), *reach(self.robot))
            weights = [body.gravity_torque(np.where(np.arange(self.n) == joint, a, pose))[joint] for a in angles]
            sine, cosine = 2 * np.mean(weights * np.sin(angles)), 2 * np.mean(weights * np.cos(angles))
            torque[joint] = share[joint] * np.hypot(sine, cosine)
            neutral[joint] = np.arctan2(-cosine, sine)
        return Balancer(torque, neutral)

    @cached_property
    def drive(self) -> Drive:
        """Gain, saturation, offset and drift of the drives."""
        saturation = self.scenario.torque_saturation
        return Drive(
            gain=self.gain,
            saturation=self._figures.effect("torque_saturation", "share", np.zeros(self.n)),
            knee=self._figures.each(
                saturation.knee if saturation else None, "torque_saturation.knee", self.usual_torque
            ),
            offset=self._figures.effect("current_offset", "offset", 0.02 * self.usual_current),
            drift=self._figures.effect("sensor_drift", "per_hour", 0.02 * self.usual_current),
        )

    @cached_property
    def delay(self) -> FloatArray:
        """Delay of the reported current [s], (n,)."""
        return self._figures.effect("delay", "seconds", np.zeros(self.n))

    @cached_property
    def filter_lag(self) -> FloatArray:
        """Corner of the lag of the reported current [Hz], (n,); inf for none."""
        return self._figures.weakened("filter_lag", "hertz")

    @cached_property
    def servo(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Bandwidth [rad/s], damping ratio and acceleration feed-forward of the position loop, (n,) each."""
        servo = self.scenario.servo
        bandwidth = 2.0 * np.pi * self._figures.each(servo.bandwidth, "servo.bandwidth")
        damping = self._figures.each(servo.damping, "servo.damping")
        return bandwidth, damping, self._figures.each(servo.feedforward, "servo.feedforward")

    @cached_property
    def stored_at_start(self) -> float:
        """Largest share of the breakaway torque that a joint may hold when a segment starts."""
        return self.scenario.friction.at_start if self.scenario.friction else 0.0

    @cached_property
    def smoothing(self) -> FloatArray:
        """Corner of the drive's own low-pass [Hz], (n,); inf for none."""
        sensors = self.scenario.sensors
        return self._figures.each(sensors.smoothing if sensors else np.inf, "sensors.smoothing")

    @cached_property
    def sensors(self) -> SensorFigures:
        """Encoder counts and current noise; all zero where the scenario has none."""
        s = self.scenario.sensors
        if s is None:
            zero = np.zeros(self.n)
            return SensorFigures(zero, zero, zero, zero, zero, np.ones(self.n))
        counts = self._figures.each(s.counts, "sensors.counts")
        return SensorFigures(
            encoder_step=2.0 * np.pi / (counts * self.gear_ratio),
            encoder_noise=self._figures.each(s.encoder_noise, "sensors.encoder_noise"),
            current_step=self._figures.each(s.resolution, "sensors.resolution", 0.001 * self.usual_current),
            white=self._figures.each(s.white, "sensors.white", 0.006 * self.usual_current),
            coloured=self._figures.each(s.coloured, "sensors.coloured", 0.008 * self.usual_current),
            correlation=self._figures.each(s.correlation, "sensors.correlation"),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return every true figure by name: links, inertia, gain, laws, the scenario's tables.

        ``effects`` holds those of the contract's catalogue, by its names and keys (see `answers.true_effects`).
        """
        return true_figures(self)
