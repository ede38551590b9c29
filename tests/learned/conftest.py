"""A small arm's logs with friction that remembers, and networks with random weights."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from ident.log import JointLog
from learned.model_file import TrainedModel
from learned.motion_discriminator import TABLE_I, DiscriminatorSpec
from learned.networks import DISCRIMINATED, architecture
from learned.torch_graph import network
from learned.window import Scaling

RATE = 100.0


def _stop_and_go(seed, seconds=60.0, n=2, rate=RATE, segments=1):
    """Joints that move at random speeds and pause; current is gravity, friction and what friction leaves at rest."""
    rng = np.random.default_rng(seed)
    rows = int(seconds * rate)
    speed = np.zeros((rows, n))
    for joint in range(n):
        k = 0
        while k < rows:
            moving, still = int(rng.uniform(0.3, 1.5) * rate), int(rng.uniform(0.3, 1.5) * rate)
            speed[k + still : k + still + moving, joint] = rng.uniform(-1.5, 1.5)
            k += moving + still
    ramp = np.hanning(int(0.1 * rate) + 2)[1:-1]
    speed = np.stack([np.convolve(s, ramp / ramp.sum(), mode="same") for s in speed.T], axis=1)
    q = np.cumsum(speed, axis=0) / rate
    q = 2.0 * np.sin(q)
    dq = np.gradient(q, 1.0 / rate, axis=0)
    slip = np.zeros((rows, n))
    for k in range(1, rows):
        slip[k] = np.clip(slip[k - 1] + q[k] - q[k - 1], -0.003, 0.003)
    current = 10.0 * np.cos(q) * np.arange(1, n + 1) + 3.0 * slip / 0.003 + 3.0 * dq
    t = np.arange(rows) / rate
    segment = np.arange(rows) * segments // rows
    return JointLog(t, q, current + 0.1 * rng.normal(size=q.shape), segment=segment, name=f"log{seed}")


def _random_model(method, n=2, seed=0, width=32, discriminator=None):
    """A model of the method whose weights are drawn at random."""
    spec = discriminator or DiscriminatorSpec(sum(TABLE_I, ()))
    spec = spec if method in DISCRIMINATED else DiscriminatorSpec(())
    shape = architecture(method, n, spec.rows(n), width=width)
    rng = np.random.default_rng(seed)
    weights = [network(shape, h, seed + h).flat() for h in range(len(shape.groups))]
    held = spec.rows(n) * n
    return TrainedModel(
        robot="arm",
        joints=tuple(f"joint_{j + 1}" for j in range(n)),
        unit="%Use",
        rate=RATE,
        cutoff=20.0,
        architecture=shape,
        discriminator=spec,
        frame_scaling=Scaling(rng.normal(size=3 * n), rng.uniform(0.5, 2.0, 3 * n)),
        held_scaling=Scaling(rng.normal(scale=0.01, size=held), rng.uniform(20.0, 40.0, held)),
        output_gain=rng.uniform(5.0, 10.0, (len(shape.groups), n)),
        output_offset=rng.normal(size=n),
        weights=np.concatenate(weights),
    )


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """Networks this small gain nothing from threads, and tests run side by side."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def stop_and_go():
    """Maker of logs; see ``_stop_and_go``."""
    return _stop_and_go


@pytest.fixture(scope="session")
def random_model():
    """Maker of trained models; see ``_random_model``."""
    return _random_model


@pytest.fixture(scope="session")
def arm_card():
    """Stand-in for a robot's card that no test changes."""
    return SimpleNamespace(name="arm", joints=("joint_1", "joint_2"), n=2, unit="%Use")


@pytest.fixture
def arm():
    """Stand-in for a robot's card: its name, joints and unit."""
    return SimpleNamespace(name="arm", joints=("joint_1", "joint_2"), n=2, unit="%Use")
