"""Robots and models of known truth that several observer tests share."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.effects.base import Term
from ident.effects.friction import Coulomb, Viscous
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links, RotorInertia
from ident.model import CurrentModel
from ident.robot import Robot, load_robot

TWO_LINKS = """<robot name="two_link"><link name="base"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="10" effort="100"/></joint>
<link name="l1"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
<inertia ixx="0.3" iyy="0.3" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="10" effort="100"/></joint>
<link name="l2"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
<inertia ixx="0.2" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


@pytest.fixture
def two_link(write_card: Callable[..., Path]) -> Robot:
    """The two-link arm of ext_observer's own test, gravity along -y, torques for currents."""
    return load_robot(write_card("two_link", TWO_LINKS, 'current_unit = "N*m"', "gravity = [0.0, -9.81, 0.0]"))


@pytest.fixture(scope="session")
def true_model() -> Callable[..., CurrentModel]:
    """Make the model whose links are the URDF's; with ``gain`` the forces are N m, without they are currents."""

    def make(
        robot: Robot, cutoff: float = 10.0, rate: float = 100.0, gain: float | None = 1.0, friction: bool = False
    ) -> CurrentModel:
        n = robot.n
        if gain is None:
            shares = np.linspace(0.5, 8.0, n)
            bases = [robot.rigid_body.base_parameters(j) for j in range(n)]
            terms = [
                Term(Links(j), coefficients=shares[j] * bases[j].projection @ robot.multibody.parameters)
                for j in range(n)
            ]
        else:
            base = robot.rigid_body.base_parameters()
            terms = [Term(Links(None), coefficients=base.projection @ robot.multibody.parameters)]
        if friction:
            for j in range(n):
                terms += [
                    Term(RotorInertia(j), coefficients=np.array([0.2])),
                    Term(Coulomb(j), coefficients=np.array([1.5])),
                    Term(Viscous(j), coefficients=np.array([2.0])),
                    Term(MaxwellSlip(j), np.array([1e-3]), np.array([0.3, 0.4, 0.3])),
                ]
        unit = "N m" if gain is not None else robot.unit
        return CurrentModel(robot, tuple(terms), cutoff, rate, np.full(n, gain or 1.0), unit)

    return make
