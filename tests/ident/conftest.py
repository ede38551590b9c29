"""Small motions and logs on which identification is tested."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from joblib import parallel_config
from scipy.signal import lfilter

from ident.effects.base import Context
from ident.log import JointLog
from ident.robot import Robot, load_robot
from ident.signals import Motion

ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz=".25 0 0"/><mass value="4"/>
<inertia ixx=".02" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz=".2 0 0"/><mass value="2"/>
<inertia ixx=".01" iyy=".05" izz=".05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="90"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz=".5 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="50"/></joint></robot>"""

GAIN = np.array([0.71, 0.81, 0.403, 0.112, 0.144, 0.076])  # [N m per %Use]


@pytest.fixture(autouse=True)
def one_thread_a_process() -> Iterator[None]:
    """Do one after the other what is shared out to threads: tests share the cores among processes as it is."""
    with parallel_config(backend="sequential"):
        yield


@pytest.fixture(scope="session")
def swinging() -> Callable[..., Motion]:
    """Motion of sinusoids in every joint, exact derivatives."""

    def move(seconds: float = 20.0, rate: float = 100.0, seed: int = 1, n: int = 6) -> Motion:
        t = np.arange(round(seconds * rate)) / rate
        speed = np.random.default_rng(seed).uniform(0.5, 2.0, (2, n))
        parts = [(a, w, p) for a, w, p in zip((0.6, 0.3), speed, (1.0, 0.0), strict=True)]
        q = sum(a * np.sin(w * t[:, None] + p) for a, w, p in parts)
        dq = sum(a * w * np.cos(w * t[:, None] + p) for a, w, p in parts)
        ddq = sum(-a * w**2 * np.sin(w * t[:, None] + p) for a, w, p in parts)
        return Motion(t, q, dq, ddq)

    return move


@pytest.fixture(scope="session")
def context(vs060: Robot, swinging: Callable[..., Motion]) -> Context:
    """What effects see of such a motion, with stretches at rest, and slow ones, where friction does most."""
    motion = swinging(4.0)
    rest = motion.q.copy(), motion.dq.copy(), motion.ddq.copy()
    rest[0][100:140], rest[1][100:140], rest[2][100:140] = motion.q[100], 0.0, 0.0
    motion = Motion(motion.t, *rest)
    load, total = np.random.default_rng(3).normal(size=(2, *motion.q.shape))
    links = np.tile(vs060.multibody.parameters, (6, 1))
    return Context(vs060, motion, load, links, total)


@pytest.fixture(scope="session")
def recorded(vs060: Robot, swinging: Callable[..., Motion]) -> Callable[..., JointLog]:
    """Log of the built-in arm with Coulomb and viscous friction, an offset, and noise that lasts 0.1 s."""

    def record(seconds: float = 20.0, seed: int = 1, noise: float = 0.2, extra: object = None) -> JointLog:
        motion = swinging(seconds, seed=seed)
        torque = vs060.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, vs060.multibody.parameters)
        white = np.random.default_rng(seed).normal(size=motion.q.shape)
        coloured = lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], white, axis=0)
        friction = 5.0 * np.tanh(motion.dq / 5e-3) + 3.0 * motion.dq + 1.0
        added = 0.0 if extra is None else extra(motion)  # type: ignore[operator]
        current = (torque + 0.05 * motion.ddq) / GAIN + friction + added + noise * coloured
        return JointLog(motion.t, motion.q, current, name=f"log{seed}")

    return record


@pytest.fixture(scope="session")
def arm(write_card: Callable[..., Path]) -> Robot:
    """Two links that two joints turn in a plane."""
    return load_robot(write_card("arm", ARM, 'current_unit = "A"'))
