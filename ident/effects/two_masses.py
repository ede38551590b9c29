"""Two masses: a link behind a spring, or the play of a gear, that is left behind by the motor that drives it."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray
from ident.compiled import compiled
from ident.effects.base import Context, Shape
from ident.effects.direction import SMOOTHING
from ident.effects.second_order import followed

STEPS, BRAKED = 4.0, 4
"""Steps in which a radian of the link's ringing is integrated, and a sample at least where friction brakes the link."""

FASTEST = 3.0
"""Radians a sample by which it may ring; a stiffer spring is as good as at rest."""

LINK_FRICTION = Shape("link_friction", "1", 0.0, 1.0, (0.2,), log=False, ends=(False, False))
"""Share of a joint's dry friction that brakes the link and not the motor."""


def motor_inertia(about: float) -> tuple[Shape, ...]:
    """What of a joint's inertia is its motor's, to be searched for where that is about so much and not nought.

    Args:
        about: what the joint's fitted inertia has beyond the URDF's, in {current} s^2/{angle}.

    Returns:
        The shape to search, or none.
    """
    unit = "{current} s^2/{angle}"
    shape = Shape("motor_inertia", unit, 0.0, 2.0 * about, (about,), log=False, ends=(False, False))
    return (shape,) if about > 0.0 else ()


def searched_motor(about: float, shape: FloatArray) -> float:
    """What of a joint's inertia is its motor's at a shape, of which ``motor_inertia(about)`` is the last.

    Args:
        about: see ``motor_inertia``.
        shape: values of all shapes.
    """
    return float(shape[-1]) if about > 0.0 else 0.0


def link_behind(
    context: Context,
    joint: int,
    stiffness: FloatArray,
    damping: float,
    dry: float,
    memory: FloatArray,
    gap: float = 0.0,
    mean: bool = False,
    motor: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow a joint's link behind its motor, both as the model knows them.

    Args:
        context: what effects see of the rows (N).
        joint: the joint, from 0.
        stiffness: of what lies between motor and link (N,).
        damping: damping ratio of the link's ringing.
        dry: dry friction that brakes the link and not the motor.
        memory: what two masses remember.
        gap: play between them.
        mean: whether accelerations and friction are means since the sample before.
        motor: what of the joint's own inertia is its motor's, which nothing between motor and link carries.

    Returns:
        How far the motor is ahead, the acceleration of that, and the force by which the link's friction differs from
        what it would be at the motor's speed, (N,) each. They are nought where fitted links have no inertia.
    """
    motion, load = context.motors, context.needed("load", "two masses")[:, joint]
    own = np.maximum(context.inertia[:, joint, joint] - motor, 0.0)
    real, dq = own > 0.0, np.ascontiguousarray(motion.dq[:, joint])
    per_own = np.divide(1.0, own, out=np.zeros_like(own), where=real)
    pull, t = (load - motor * motion.ddq[:, joint]) * per_own, np.ascontiguousarray(motion.t)
    brake, square = dry * per_own, stiffness * per_own
    if gap == 0.0 and dry == 0.0:
        ahead, onward = swings(t, pull, square, damping, memory)
        return ahead, onward, np.zeros(len(t))
    ahead, onward, turned = left_behind(t, pull, dq, brake, 0.5 * gap, square, damping, mean, memory)
    return ahead, onward, dry * turned


@compiled
def _swung(
    ahead: float,
    speed: float,
    ends: tuple[tuple[float, float], tuple[float, float]],
    brake: float,
    half: float,
    turn: float,
    damping: float,
    since: float,
    steps: int,
) -> tuple[float, float, float, float, float]:
    """Follow a link from one sample to the next; ``ends`` are its pull and its motor's speed at both.

    Returns:
        How far the motor is ahead, how fast it draws ahead, the acceleration of that and the direction of the link's
        friction in the last step, and that direction's mean.
    """
    (before, after), (motor, then) = ends
    share, step = 1.0 / steps, since / steps
    stiff, damper, braked = turn * turn, 2.0 * damping * turn, brake * step
    width = (SMOOTHING + braked) ** 2
    started, rubbed, rub = speed, 0.0, 0.0
    for i in range(steps):
        part = (i + 0.5) * share
        wound = ahead - min(max(ahead, -half), half)
        push = stiff * wound + damper * speed
        carried = push if half == 0.0 or push * wound > 0.0 else 0.0
        started = speed
        speed += (before + (after - before) * part - carried) * step
        if brake > 0.0:
            link = motor + (then - motor) * part - speed
            rub = link / np.sqrt(link * link + width)
            speed += braked * rub
            rubbed += rub
        ahead += speed * step
    return ahead, speed, (speed - started) / step, rub, rubbed * share


@compiled
def left_behind(
    t: FloatArray,
    pull: FloatArray,
    dq: FloatArray,
    brake: FloatArray,
    half: float,
    square: FloatArray,
    damping: float,
    mean: bool,
    memory: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow how far the motor is ahead of a link (cf. Nordin and Gutman 2002, section 2.1).

    Flanks are springs with dampers that push and do not pull; inside the gap the link is free. Without a gap there is
    one spring. Friction never turns the link round within a step. Samples without a pull are passed over.

    Args:
        t: stamps (N,) [s].
        pull: load of the link over its inertia (N,).
        dq: speed of the motor (N,).
        brake: dry friction of the link over its inertia (N,).
        half: half the gap.
        square: square (N,) of the angular frequency at which the link rings; where it is nought nothing gives way.
        damping: damping ratio.
        mean: whether accelerations and directions are means since the sample before, as of knocks that come a little
            earlier or later, or those of the sample.
        memory: how far the motor was ahead at the last sample, how fast it drew ahead, the pull, the motor's speed and
            the stamp (not known before the first), which are brought up to date.

    Returns:
        How far the motor is ahead, the acceleration of that, and the direction of the link's dry friction less that of
        the motor's, (N,) each.
    """
    place, onward, turned = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t))
    ahead, speed, before, motor, last = memory[0], memory[1], memory[2], memory[3], memory[4]
    for k in range(len(t)):
        if np.isnan(pull[k]) or np.isnan(square[k]):
            place[k] = onward[k] = turned[k] = np.nan
            continue
        of_motor = np.tanh(dq[k] / SMOOTHING)
        if square[k] <= 0.0:
            ahead, speed = 0.0, 0.0
        elif np.isnan(last):
            needed = pull[k] + brake[k] * of_motor
            ahead = (half + abs(needed) / square[k]) * (1.0 if needed >= 0.0 else -1.0)
        else:
            since = t[k] - last
            turn = min(np.sqrt(square[k]), FASTEST / since)
            steps = max(int(np.ceil(since * turn * STEPS)), BRAKED if brake[k] > 0.0 else 1)
            first = speed
            ends = (before, pull[k]), (motor, dq[k])
            ahead, speed, bent, rub, rubbed = _swung(ahead, speed, ends, brake[k], half, turn, damping, since, steps)
            onward[k] = (speed - first) / since if mean else bent
            turned[k] = (rubbed if mean else rub) - of_motor
        place[k] = ahead
        before, motor, last = pull[k], dq[k], t[k]
    memory[0], memory[1], memory[2], memory[3], memory[4] = ahead, speed, before, motor, last
    return place, onward, turned


STIFFEST = 2.0
"""Radians a sample by which a spring alone may ring; of a stiffer one the link follows at once."""


@compiled
def swings(
    t: FloatArray, pull: FloatArray, square: FloatArray, damping: float, memory: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Follow a link on a spring alone, exactly for a pull that is linear between samples.

    Args:
        t: stamps (N,) [s].
        pull: load of the link over its inertia (N,); samples without it are passed over.
        square: square (N,) of the angular frequency at which the link rings; where it is nought nothing gives way.
        damping: damping ratio.
        memory: as of ``left_behind``, without the motor's speed.

    Returns:
        How far the motor is ahead, and the acceleration of that, (N,) each.
    """
    place, onward = np.zeros(len(t)), np.zeros(len(t))
    ahead, speed, before, last = memory[0], memory[1], memory[2], memory[4]
    for k in range(len(t)):
        if np.isnan(pull[k]) or np.isnan(square[k]):
            place[k] = onward[k] = np.nan
            continue
        if square[k] <= 0.0:
            ahead, speed = 0.0, 0.0
        elif np.isnan(last):
            ahead, speed = pull[k] / square[k], np.nan
        elif square[k] * (t[k] - last) ** 2 > STIFFEST**2:
            step, behind, drew = t[k] - last, ahead, speed
            ahead = pull[k] / square[k]
            speed = (ahead - behind) / step
            onward[k] = 0.0 if np.isnan(drew) else (speed - drew) / step
        else:
            step, turn = t[k] - last, np.sqrt(square[k])
            speed = 0.0 if np.isnan(speed) else speed
            rest, needed = before / turn**2, pull[k] / turn**2
            ahead, rise = followed(ahead, speed / turn, rest, needed, turn * step, damping)
            speed = rise * turn
            onward[k] = pull[k] - 2.0 * damping * turn * speed - turn**2 * ahead
        place[k] = ahead
        before, last = pull[k], t[k]
    memory[0], memory[1], memory[2], memory[4] = ahead, speed, before, last
    return place, onward
