"""The tables of a scenario file, one an effect, with every key they may hold."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, lt=1.0)]
Wait = Annotated[float, Field(ge=0.0, le=1.0)]
PerJoint = Finite | tuple[Finite, ...]
"""One figure for all joints, or one a joint. Where a figure is left out (None), it is scaled to the robot's torques."""
Positives = Positive | tuple[Positive, ...]
Shares = Share | tuple[Share, ...]


class Section(BaseModel):
    """A table of the scenario file; a key it does not know is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Effect(Section):
    """A table that switches an effect on by being there.

    ``joints`` (counted from 1) limits it to some joints, ``scale`` multiplies its strength joint by joint.
    """

    joints: tuple[int, ...] | None = None
    scale: PerJoint = 1.0


class Links(Section):
    """True links: the URDF's inertias changed at random by about ``spread`` (relative), drawn from ``seed``."""

    spread: Annotated[float, Field(ge=0.0)] = 0.05
    seed: int = 1


class Motors(Section):
    """Motors: ``gain`` [N m per unit of current], ``inertia`` reflected to the joint [kg m^2], ``gear_ratio``."""

    gain: Positives | None = None
    inertia: PerJoint | None = None
    gear_ratio: Positives | None = None


class Servo(Section):
    """The position loop of a prescribed motion: bandwidth [Hz], damping ratio and acceleration feed-forward."""

    bandwidth: Positives = 8.0
    damping: Shares = 0.25
    feedforward: PerJoint = 0.6


class Friction(Effect):
    """Friction with memory: torques [N m], speeds [rad/s], slip [rad] over which the elements let go one by one."""

    coulomb: PerJoint | None = None
    breakaway: Positives = 1.25
    viscous: PerJoint | None = None
    stribeck_speed: Positives = 0.035
    slip: tuple[Positive, Positive] = (0.5e-3, 3.0e-3)
    elements: Annotated[int, Field(ge=1, le=32)] = 6
    attraction: Positives = 60.0
    at_start: Annotated[float, Field(ge=0.0, le=1.0)] = 0.6


class LoadFriction(Effect):
    """Coulomb torque grows by ``coefficient`` with the transmitted torque."""

    coefficient: PerJoint = 0.03


class CoulombAsymmetry(Effect):
    """Friction differs between directions by plus and minus ``share``."""

    share: PerJoint = 0.1


class PositionFriction(Effect):
    """Friction swings by ``share`` over a turn of the joint, largest at ``phase`` [rad]."""

    share: PerJoint = 0.1
    phase: PerJoint = 0.7


class ViscousNonlinear(Effect):
    """The lubricant thins: at ``thinning_speed`` [rad/s] the damping is halved."""

    thinning_speed: Positives = 3.0


class CrossJointHysteresis(Effect):
    """Motion of other joints shakes stored friction loose.

    ``per_radian``: how fast, a radian of the others' motion (row j by column k, or one figure for all pairs);
    ``kept``: the share that stays for good.
    """

    per_radian: float | tuple[tuple[float, ...], ...] = 1.0
    kept: Shares = 0.15


class ThermalFriction(Effect):
    """Dissipated power warms a joint; its friction falls by up to ``share`` with a time constant of ``seconds``."""

    share: Shares = 0.3
    seconds: Positives = 1200.0
    power: Positives | None = None


class CrossJointFriction(Effect):
    """Parts turned by two joints at once: pairs of joints (from 1), ``force`` [N m], turns ratio, speed [rad/s]."""

    pairs: tuple[tuple[int, int], ...]
    force: float | None = None
    ratio: float = 1.0
    speed: float = 0.05


class Elasticity(Effect):
    """Springs between motor and link: ``stiffness`` [N m/rad] and damping ratio."""

    stiffness: Positives | None = None
    damping: Shares = 0.05


class Backlash(Effect):
    """Play between motor and link: ``gap`` [rad]."""

    gap: PerJoint = 0.5e-3


class GearRipple(Effect):
    """Torque ripple of the gears: ``force`` [N m], ``per_turn`` periods a motor turn; grows with load by ``load``."""

    force: PerJoint | None = None
    per_turn: Positives = 2.0
    load: PerJoint = 0.5


class Cogging(Effect):
    """Torque ripple of the motor's poles: ``force`` [N m], ``per_turn`` periods a motor turn."""

    force: PerJoint | None = None
    per_turn: Positives = 6.0


class CableSpring(Effect):
    """A cable that stiffens as it bends: ``stiffness`` [N m/rad], ``neutral`` position and ``reach`` [rad]."""

    stiffness: Positives | None = None
    neutral: PerJoint = 0.2
    reach: Positives = 2.0


class GravityBalancer(Effect):
    """A spring that relieves gravity by ``share`` of the joint's largest gravity torque; joint 2 unless told."""

    joints: tuple[int, ...] | None = (2,)
    share: Shares = 0.3


class TorqueSaturation(Effect):
    """``share`` of the torque is lost at the joint's largest usual torque (or ``knee`` [N m])."""

    share: Shares = 0.08
    knee: Positives | None = None


class DriveGain(Effect):
    """The true gain is ``factor`` times the one in ``motors``."""

    factor: Positives = 1.1


class CurrentOffset(Effect):
    """A constant ``offset`` of the reported current, in its unit (None: 2 % of the usual current)."""

    offset: PerJoint | None = None


class SensorDrift(Effect):
    """The offset grows by ``per_hour``, in current units (None: 2 % of the usual current)."""

    per_hour: PerJoint | None = None


class Delay(Effect):
    """The current is reported ``seconds`` late."""

    seconds: Wait | tuple[Wait, ...] = 0.005


class FilterLag(Effect):
    """The current passes a first-order filter at ``hertz``."""

    hertz: Positives = 8.0


class Payload(Section):
    """A load on the last link: ``mass`` [kg], ``com`` [m] in its frame, ``inertia`` (xx yy zz) about it [kg m^2]."""

    mass: Annotated[float, Field(ge=0.0)] = 1.0
    com: tuple[float, float, float] = (0.0, 0.02, 0.06)
    inertia: tuple[float, float, float] = (0.002, 0.002, 0.001)


class BaseTilt(Section):
    """The base stands askew by ``roll`` and ``pitch`` [rad]."""

    roll: float = 0.02
    pitch: float = -0.03


class SensorNoise(Section):
    """Encoders and current sensors.

    ``counts`` a motor turn, ``encoder_noise`` [counts]; ``smoothing``: the drive's own low-pass [Hz]; ``white`` and
    ``coloured`` standard deviation of the current noise and ``resolution`` of the current, in its unit (None: 0.6 %,
    0.8 % and 0.1 % of the usual current); ``correlation`` time of the coloured part [s].
    """

    counts: Positives = 131072.0
    encoder_noise: PerJoint = 0.6
    smoothing: Positives = 40.0
    white: PerJoint | None = None
    coloured: PerJoint | None = None
    correlation: Positives = 0.15
    resolution: PerJoint | None = None
