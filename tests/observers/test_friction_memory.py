"""What a memory of friction does to the deadzone that an arm needs."""

import numpy as np
import pytest

from comparisons.protocols import named
from comparisons.virtual_robot.robot import VirtualRobot
from ident.effects.base import Effect
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.friction_curve import Stribeck
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links
from ident.fit import Drives, fit
from ident.robot import Robot
from observers.momentum import MomentumObserver

SURE = 20.0  # [s] after which every joint has moved, and what it stores is known


@pytest.fixture(scope="module")
def virtual(vs060: Robot) -> VirtualRobot:
    return VirtualRobot(vs060)


def peak(virtual: VirtualRobot, kinds: tuple[type[Effect], ...]) -> np.ndarray:
    """Residual that a thousandth of the rows of a fresh contact-free log exceed [%Use], (n,)."""
    train, fresh = (virtual.record(named("stop_and_go")(virtual.robot, seconds=400.0, seed=s), s) for s in (1, 21))
    effects = [kind(j) for j in range(6) for kind in kinds]
    model = fit(virtual.robot, effects, [train], 10.0, Drives(np.ones(6), virtual.robot.unit)).model
    residual = MomentumObserver(model, 2.0).run(fresh)
    return np.quantile(np.abs(residual.current[residual.good & (fresh.t > SURE)]), 0.999, axis=0)


def test_memory_of_friction_makes_the_deadzone_small(virtual: VirtualRobot) -> None:
    remembers = peak(virtual, (Links, MaxwellSlip, Viscous, CurrentOffset))
    forgets = peak(virtual, (Links, Coulomb, Viscous, Stribeck, CurrentOffset))
    fall = 1.0 - remembers / forgets
    # what joints 4 and 5 store is shaken loose by the others' motion, which a joint's own memory does not know
    assert np.all(fall[[0, 1, 2, 5]] > 0.4), fall
    assert np.all(fall[[3, 4]] > 0.25), fall
