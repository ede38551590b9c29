"""EMPS, a real axis with pulses of known force: how well they are felt."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.signal

from ident.arrays import FloatArray
from ident.causal import CausalDerivatives
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import Links
from ident.fit import Drives, fit
from ident.log import JointLog
from ident.model import CurrentModel
from ident.robot import load_robot
from observers.contact import ContactDetector
from observers.momentum import MomentumObserver
from observers.thresholds import fit_threshold

BANDWIDTH = 8.0
SLIDER = """<robot name="emps"><link name="base"/><link name="slider"><inertial><mass value="95"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="slider"/><axis xyz="1 0 0"/>
<limit lower="-0.5" upper="0.5" velocity="1" effort="1000"/></joint></robot>"""


def read(path: Path) -> JointLog:
    """The log, with force for current and the pulses taken out of the motor's force: the world then gives them."""
    data = scipy.io.loadmat(path)
    gain = float(data["gtau"][0, 0])
    pulses = gain * data["pulses_N"].astype(float) if "pulses_N" in data else np.zeros_like(data["vir"])
    return JointLog(t=data["t"][:, 0], q=data["qm"], current=gain * data["vir"] - pulses, tau_ext=pulses)


@pytest.fixture(scope="module")
def model(measured: Callable[[str], Path], write_card: Callable[..., Path]) -> CurrentModel:
    robot = load_robot(write_card("emps", SLIDER, 'current_unit = "N"'))
    log = read(measured("emps/DATA_EMPS.mat"))
    effects = [Links(None), Coulomb(0), Viscous(0), CurrentOffset(0)]
    return fit(robot, effects, [log], 60.0, Drives(np.ones(1), "N m")).model


def through_the_observer(model: CurrentModel, log: JointLog) -> FloatArray:
    """The true force as an observer without errors would give it: the low pass of motion, then its own."""
    assert log.tau_ext is not None
    force = CausalDerivatives(log.rate, model.cutoff, 1).run(log.t, log.tau_ext)[0][:, 0]
    pole = np.exp(-2.0 * np.pi * BANDWIDTH / log.rate)
    mean = np.r_[0.0, 0.5 * (force[1:] + force[:-1])]
    expected: FloatArray = scipy.signal.lfilter([1.0 - pole], [1.0, -pole], mean)
    return expected


def test_every_pulse_is_felt_and_nothing_else(model: CurrentModel, measured: Callable[[str], Path]) -> None:
    log, quiet = read(measured("emps/DATA_EMPS_PULSES.mat")), read(measured("emps/DATA_EMPS.mat"))
    observer = MomentumObserver(model, BANDWIDTH)
    still, felt = observer.run(quiet), observer.run(log)
    error = (felt.current[:, 0] - through_the_observer(model, log))[felt.good]
    assert np.sqrt(np.mean(error**2)) <= 3.0
    assert log.tau_ext is not None
    begins = log.t[1:][np.diff(log.tau_ext[:, 0]) > 0.0]
    episodes = ContactDetector(fit_threshold([still], 1.0)).run(felt).episodes()
    assert len(begins) == 25
    delays = np.array([episode.start for episode in episodes]) - begins
    assert np.all((delays > 0.0) & (delays < 0.05))
