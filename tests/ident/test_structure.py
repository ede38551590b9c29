"""Friction terms are chosen where they are, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from ident.effects.base import Context
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.friction_curve import Sigmoid, ViscousNonlinear
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links
from ident.fit import Drives
from ident.log import JointLog
from ident.robot import load_robot
from ident.structure import candidates, choose_structure, coupled, make_folds
from ident.walk import collect

CUTOFF = 10.0
DRIVES = Drives(np.ones(2), "A")
URDF = """<robot name="arm"><link name="l0"/><link name="l1"><inertial><origin xyz="0.01 0 0.1"/><mass value="4"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.01"/></inertial></link>
<link name="l2"><inertial><origin xyz="0 0.02 0.2"/><mass value="2"/>
<inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>
<joint name="pan" type="revolute"><parent link="l0"/><child link="l1"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="4" effort="50"/></joint>
<joint name="lift" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/><origin xyz="0 0 0.25"/>
<limit lower="-2.5" upper="2.5" velocity="4" effort="50"/></joint></robot>"""


def baseline(joints=6):
    return [e for j in range(joints) for e in (Links(j), CurrentOffset(j), Coulomb(j), Viscous(j))]


def chosen(structure, joint):
    usual = {"links", "current-offset", "coulomb", "viscous"}
    return {e.name for e in structure.effects if e.joint == joint} - usual


@pytest.fixture(scope="module")
def arm(write_card):
    """Two joints, so that a search takes a second."""
    return load_robot(write_card("arm", URDF, 'current_unit = "A"'))


@pytest.fixture(scope="module")
def record(arm, swinging):
    """Logs of the arm; white noise, and what is hidden in the second joint."""

    def make(seed, hidden=lambda motion: 0.0, seconds=40.0):
        motion = swinging(seconds, seed=seed, n=2)
        torque = arm.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, arm.multibody.parameters)
        current = torque + 5.0 * np.tanh(motion.dq / 5e-3) + 3.0 * motion.dq + 1.0
        current[:, 1] += hidden(motion)
        noise = np.random.default_rng(seed).normal(size=current.shape)
        return JointLog(motion.t, motion.q, current + 0.3 * noise, name=f"log{seed}")

    return make


@pytest.fixture(scope="module")
def slip(arm):
    effect = MaxwellSlip(1, spread=(1.0,))
    return lambda m: 6.0 * effect.columns(Context(arm, m), np.array([8e-3]), effect.start())[:, 0]


def stribeck(motion):
    dq = motion.dq[:, 1]
    return 5.0 * np.tanh(dq / 5e-3) * np.exp(-((dq / 0.15) ** 2))


def test_nothing_is_chosen_where_nothing_is_hidden(arm, record):
    found = choose_structure(arm, baseline(2), [record(s) for s in (1, 2, 3)], CUTOFF, DRIVES)
    assert [e.name for e in found.effects] == [e.name for e in baseline(2)]
    assert not any(choice.taken for choice in found.choices)
    assert "groups of 3 logs" in found.folds


def test_hidden_stribeck_friction_is_found_on_its_joint_alone(arm, record):
    told = []
    found = choose_structure(arm, baseline(2), [record(s, stribeck) for s in (1, 2)], CUTOFF, DRIVES, told.append)
    # The curve may be written as a Stribeck term or, on these speeds, as one that comes to the same.
    assert chosen(found, 1) & {"stribeck", "sigmoid"}
    assert chosen(found, 0) == set()
    first = next(choice for choice in found.choices if choice.joint == 1)
    assert first.taken
    assert first.gain > 0.2
    assert first.worst_fold > 0
    assert told == sorted(told)


def test_hidden_maxwell_slip_is_found_in_one_log(arm, record, slip):
    found = choose_structure(arm, baseline(2), [record(1, slip)], CUTOFF, DRIVES)
    assert "maxwell-slip" in chosen(found, 1)
    assert chosen(found, 0) == set()


def test_folds_hold_every_row_out_once(recorded):
    one = collect([recorded(20.0)], CUTOFF)
    folds, described = make_folds(one)
    assert "parts of the log" in described
    held = sum(np.concatenate([b.keep for b in f.held_out]).astype(int) for f in folds)
    np.testing.assert_array_equal(held, np.concatenate([b.keep for b in one]).astype(int))
    for fold in folds:
        for train, held_out in zip(fold.train, fold.held_out, strict=True):
            assert not (train.keep & held_out.keep).any()
    many = collect([recorded(10.0, seed=s) for s in (1, 2, 3, 4)], CUTOFF)
    folds, described = make_folds(many)
    for fold in folds:
        assert not {b.log.name for b in fold.train} & {b.log.name for b in fold.held_out}
    assert sorted(b.log.name for f in folds for b in f.held_out) == ["log1", "log2", "log3", "log4"]


def test_candidates_are_those_a_joint_has_not(vs060):
    own = [Links(1), Coulomb(1, 2e-3), Viscous(1, 2e-3)]
    names = {e.name for e in candidates(vs060, own, 1)}
    assert {"stribeck", "sigmoid", "viscous-nonlinear", "load-friction", "maxwell-slip"} <= names
    assert "coulomb" not in names
    assert {e.smoothing for e in candidates(vs060, own, 1) if hasattr(e, "smoothing")} == {2e-3}
    assert "sigmoid" not in {e.name for e in candidates(vs060, [*own, Sigmoid(1)], 1)}
    assert candidates(vs060, [Links(1), CurrentOffset(1)], 1) == []
    asymmetry = {rests: {e.name for e in candidates(vs060, own, 1, rests)} for rests in (True, False)}
    assert asymmetry[True] - asymmetry[False] == {"coulomb-asymmetry"}
    assert ViscousNonlinear(1).replaces == ("viscous",)


def test_wrists_may_be_coupled(vs060):
    assert [coupled(vs060, j) for j in range(6)] == [[], [], [], [], [5], [4]]
    drive = vs060.card.drive.model_copy(update={"coupling": (np.eye(6) - 0.5 * np.eye(6, k=-1)).tolist()})
    told = replace(vs060, card=vs060.card.model_copy(update={"drive": drive}))
    assert [coupled(told, j) for j in range(6)] == [[]] * 6


def test_logs_too_short_change_nothing(arm, record):
    found = choose_structure(arm, baseline(2), [record(1)[:5]], CUTOFF, DRIVES)
    assert list(found.effects) == baseline(2)
    assert "too short" in found.folds
