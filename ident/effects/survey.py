"""Facts about logs that effects are built from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ident.arrays import FloatArray

if TYPE_CHECKING:
    from ident.robot import Robot


@dataclass(frozen=True)
class Survey:
    """What logs say that candidates are built from.

    Attributes:
        robot: the robot.
        smoothing: speed (n,) over which each joint's sign of velocity turns [rad/s or m/s].
        presliding: displacement (n,) over which its dry friction builds up instead [rad or m]; nought for none.
        presliding_exponent: exponent (n,) with which it does.
        pace: mean speed (n,) [rad/s or m/s].
        friction: friction force (n,) of each joint at its mean speed, in the model's force unit.
        viscous: share (n,) of it that is viscous.
        weight: largest force (n,) by which the links' weight loads each joint in the logs, by the URDF, in the model's
            force unit.
        largest: largest force (n,) that a model of the logs gives, in its force unit.
        per_newton_metre: force units per N m of each joint, (n,).
        links: inertial parameters (10 n,) of the links [SI], the likeliest by URDF and model.
        load_ratio: the links' load as fitted over the URDF's [force unit per N m], (n,); one where gains are known.
        since: earliest time stamp [s].
        lasts: seconds from that to the last.
        logged: share of these that the logs cover.
        begins: time stamp [s] at which each log begins, of logs whose clocks began anew: whether heat and drift go on
            from one to the next is not known; none where one clock has stamped them all.
        rate: sampling rate [Hz].
        reach: range (n,) of the joints' positions [rad or m].
        middle: middle (n,) of it.
        holds: force (n,) that dry friction holds of a joint that stands, in the model's force unit.
        steps: that by which dry friction changes where a joint turns round, over two (n,), in the model's force unit.
        cutoff: of the filter that derives velocity and acceleration [Hz].
        inertia: mean inertia (n,) of the links that each joint moves, in the model's force unit per rad/s^2 or m/s^2.
        motor: what of it (n,) is the motors', since links as fitted have it and those of the URDF have not.
        held: whether the model is held fixed, and was identified from other logs.
    """

    robot: Robot
    smoothing: FloatArray
    presliding: FloatArray
    presliding_exponent: FloatArray
    pace: FloatArray
    friction: FloatArray
    viscous: FloatArray
    weight: FloatArray
    largest: FloatArray
    per_newton_metre: FloatArray
    links: FloatArray
    load_ratio: FloatArray
    since: float
    lasts: float
    logged: float
    begins: tuple[float, ...]
    rate: float
    reach: FloatArray
    middle: FloatArray
    holds: FloatArray
    steps: FloatArray
    cutoff: float
    inertia: FloatArray
    motor: FloatArray
    held: bool = False
