"""Base parameters: W pi == W_b P pi, on regressors the search never saw."""

from dataclasses import replace

import numpy as np
import pytest

from ident.base_parameters import rotor_shows
from ident.multibody import Multibody
from ident.rigid_body import RigidBody

ROBOTS = ["ur5", "panda", "xarm7", "vs060"]


@pytest.fixture(params=ROBOTS)
def rigid_body(request, urdf_path, arm_joints):
    return RigidBody(Multibody.from_urdf(urdf_path(request.param), arm_joints(request.param)))


@pytest.fixture
def regressor(rigid_body, rng):
    return rigid_body.regressor(*rng.normal(size=(3, 100, rigid_body.n)))


def test_they_give_what_all_parameters_give(rigid_body, regressor, rng):
    base = rigid_body.base_parameters()
    rows = regressor.reshape(-1, 10 * rigid_body.n)
    pi = rng.normal(size=10 * rigid_body.n)
    np.testing.assert_allclose(rows[:, base.columns] @ (base.projection @ pi), rows @ pi, atol=1e-9)
    chosen = rows[:, base.columns]
    assert np.linalg.cond(chosen / np.linalg.norm(chosen, axis=0)) < 100.0  # none of them is a combination in disguise


def test_they_give_the_row_of_each_joint(rigid_body, regressor, rng):
    pi = rng.normal(size=10 * rigid_body.n)
    for j in range(rigid_body.n):
        base = rigid_body.base_parameters(j)
        rows = regressor[:, j]
        # xArm7 writes 1.5708 for pi/2, which tilts its first axis by 4e-6 and is not taken for information
        exact = 1e-3 if "UF_ROBOT" in rigid_body.multibody.model.name and j == 0 else 1e-9
        np.testing.assert_allclose(rows[:, base.columns] @ (base.projection @ pi), rows @ pi, atol=exact)
        assert len(base.columns) == np.linalg.matrix_rank(rows, tol=1e-2)
        assert base.columns.min() >= 10 * j  # a joint feels the links it carries


def test_numbers_of_base_parameters_are_the_known_ones(urdf_path, arm_joints):
    # 36 for a six-axis arm with its second and third axes parallel, 43 for a seven-axis one (Gautier and Khalil 1990)
    known = {"ur5": 36, "vs060": 36, "panda": 43, "xarm7": 43}
    found = {
        name: len(RigidBody(Multibody.from_urdf(urdf_path(name), arm_joints(name))).base_parameters().columns)
        for name in known
    }
    assert found == known


@pytest.mark.parametrize(
    "limits", [{"velocity": 0.01}, {"velocity": 1e4}, {"velocity": 1e6}, {"lower": -1e16, "upper": 1e16}]
)
def test_they_do_not_depend_on_limits_that_are_none(urdf_path, limits):
    body = Multibody.from_urdf(urdf_path("ur5"))
    usual, written = RigidBody(body), RigidBody(replace(body, **{k: np.full(body.n, v) for k, v in limits.items()}))
    for j in (None, *range(body.n)):
        np.testing.assert_array_equal(usual.base_parameters(j).columns, written.base_parameters(j).columns)


def test_a_joint_row_of_a_rounded_urdf_has_no_parameters_of_the_rounding(urdf_path, arm_joints):
    rows = {
        name: [len(rigid.base_parameters(j).columns) for j in range(7)]
        for name in ("panda", "xarm7")
        for rigid in [RigidBody(Multibody.from_urdf(urdf_path(name), arm_joints(name)))]
    }
    assert rows["panda"] == rows["xarm7"] == [38, 42, 35, 28, 21, 14, 7]


def test_they_are_the_same_every_time(rigid_body):
    first, again = rigid_body.base_parameters(), rigid_body.base_parameters()
    np.testing.assert_array_equal(first.columns, again.columns)
    np.testing.assert_array_equal(first.projection, again.projection)
    assert first.combinations == again.combinations
    np.testing.assert_array_equal(first.projection[:, first.columns], np.eye(len(first.columns)))


def test_a_vertical_first_axis_shows_one_parameter_and_a_tilted_one_three(urdf_path):
    path = urdf_path("vs060")
    upright, tilted = (Multibody.from_urdf(path, gravity=g) for g in ((0.0, 0.0, -9.81), (0.0, 1.0, -9.75)))
    of_link_1 = [
        [name for name in RigidBody(body).base_parameters().names if name.endswith("1")] for body in (upright, tilted)
    ]
    assert of_link_1 == [["Izz1"], ["mx1", "my1", "Izz1"]]


def test_combinations_are_written_out_as_in_the_closed_form(urdf_path):
    base = RigidBody(Multibody.from_urdf(urdf_path("vs060"))).base_parameters()
    written = dict(zip(base.names, base.combinations, strict=True))
    assert written["mx2"] == "mx2"
    assert written["mz5"] == "mz5 + 0.07 m6 + mz6"  # joint 6 sits 0.07 m up the axis of link 5
    assert written["Ixx6"] == "Ixx6 - Iyy6"  # of a body about its own axis, only the difference shows
    assert written["mz2"] == "mz2 + 0.305 m3 + 0.305 m4 + 0.305 m5 + 0.305 m6"


def test_a_rotor_shows_where_other_joints_turn_the_link_about_its_axis(rigid_body):
    # The second axis of all these arms is square to the first; xArm7 says so to six figures.
    assert [rotor_shows(rigid_body, j) for j in range(rigid_body.n)] == [False, False, *[True] * (rigid_body.n - 2)]
