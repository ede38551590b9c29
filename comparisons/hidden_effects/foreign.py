"""Effects that the catalogue does not have: of them the workflow must say that something is there, and give no name."""

from __future__ import annotations

import numpy as np

from comparisons.hidden_effects.laws import Scene, law, on
from ident.arrays import FloatArray

Found = tuple[FloatArray, dict[str, float]]


@law("hum", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """A disturbance at a fixed frequency: a fan, a pump, the mains folded down."""
    return on(s, j, a * np.sin(2.0 * np.pi * rng.uniform(2.0, 6.0) * s.t)), {}


@law("other-joints-angle", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """Friction that depends on where another joint stands: a bearing that the arm's pose bends."""
    other = (j + 1) % s.q.shape[1]
    return on(s, j, a * s.direction[:, j] * np.sin(2.0 * s.q[:, other])), {}


@law("friction-step", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """A seal that comes off: friction jumps at one moment of each log."""
    return on(s, j, a * s.direction[:, j] * (s.t > 0.6 * s.t[-1])), {}


@law("creep", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """A visco-elastic mount: a spring that relaxes in seconds."""
    slow = np.zeros(len(s.t))
    level, dt = s.q[0, j], float(np.median(np.diff(s.t)))
    for k, x in enumerate(s.q[:, j].tolist()):
        level = x if s.start[k] else level + dt / 2.0 * (x - level)
        slow[k] = x - level
    return on(s, j, a * slow), {}


@law("wind-of-others", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """A torque that goes with the product of two other joints' speeds."""
    n = s.q.shape[1]
    return on(s, j, a * s.dq[:, (j + 1) % n] * np.abs(s.dq[:, (j + 2) % n])), {}


@law("end-stop", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """A soft bumper that is met near the end of the range."""
    edge = np.quantile(s.q[:, j], 0.85)
    return on(s, j, a * np.maximum(s.q[:, j] - edge, 0.0) ** 1.5), {}


@law("limit-cycle", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """A controller that hunts while the joint stands or creeps."""
    hunting = np.exp(-((s.dq[:, j] / 0.05) ** 2))
    return on(s, j, a * hunting * np.sin(2.0 * np.pi * 3.3 * s.t)), {}


@law("wandering-offset", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """A sensor whose offset walks at random."""
    walk = np.cumsum(np.random.default_rng(int(1e3 * abs(s.q[5, j])) + 7).standard_normal(len(s.t)))
    return on(s, j, a * (walk - walk.mean()) / walk.std()), {}


@law("speed-times-angle", foreign=True)
def _(s: Scene, j: int, a: float, rng: np.random.Generator) -> Found:
    """Damping that changes along the joint's range: a magnetic brake, a worn guide."""
    return on(s, j, a * s.dq[:, j] * np.sin(1.3 * s.q[:, j] + 0.4)), {}
