"""Links and drive gains that a model's rows and the URDF tell together."""

from dataclasses import replace

import numpy as np
import pytest

from ident.effects.attached import BaseTilt
from ident.effects.base import Term
from ident.effects.rigid_body import Links, RotorInertia
from ident.gap.bodies import _Guess, _Row, _Rows, bodies_of
from ident.model import NEWTON_METRE, CurrentModel
from ident.robot import load_robot

GAINS = np.array([0.02, 0.03, 0.05, 0.1, 0.08, 0.3])
"""Amperes per N m."""


SLIDES = "".join(
    f"""<link name="{link}"><inertial><origin xyz="0 0 .1"/><mass value="{mass}"/>
    <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="j{link}" type="prismatic"><parent link="{parent}"/><child link="{link}"/><axis xyz="{axis}"/>
    <limit lower="-1" upper="1" velocity="2" effort="500"/></joint>"""
    for link, mass, parent, axis in (("x", 20, "base", "1 0 0"), ("y", 8, "x", "0 1 0"), ("z", 4, "y", "0 0 1"))
)


@pytest.fixture
def gantry(write_card):
    return load_robot(write_card("gantry", f'<robot name="gantry"><link name="base"/>{SLIDES}</robot>'))


@pytest.fixture
def true_links(vs060):
    links = vs060.multibody.parameters
    return links * (1.0 + 0.05 * np.random.default_rng(3).standard_normal(links.size))


def model_of(robot, links, rotors=0.1, errors=None):
    """A model of unknown gains whose rows are of the same links; without terms for rotors they are part of them."""
    terms = []
    for j, gain in enumerate(GAINS):
        effect = Links(j)
        fitted = gain * effect.base(robot).projection @ links
        known = np.zeros((len(fitted), 1)) if errors is None else errors(j, fitted)
        terms.append(Term(effect, coefficients=fitted, errors=known))
    known = [] if rotors is None else enumerate(GAINS)
    shown = [Term(RotorInertia(j), coefficients=np.array([rotors * gain])) for j, gain in known]
    return CurrentModel(robot, (*terms, *shown), 8.0, 100.0, np.ones(6), "A")


def test_gains_are_known_well_beside_one_another(vs060, true_links):
    found = bodies_of(model_of(vs060, true_links)).per_newton_metre / GAINS
    assert np.ptp(found) < 0.01
    assert np.abs(found - 1.0).max() < 0.05


def test_weights_under_a_tilt_are_nearer_than_those_of_the_urdf(vs060, true_links, context):
    bodies = bodies_of(model_of(vs060, true_links))
    gains = tuple(bodies.per_newton_metre.tolist())

    def weights(tilt, per=1.0):
        return tilt.columns(context, np.zeros(0), np.zeros(0)) * np.asarray(per)

    true = weights(BaseTilt(None, tuple(GAINS.tolist()), tuple(true_links.tolist())))
    off = [
        np.linalg.norm(weights(BaseTilt(None, gains, links)) - true)
        for links in (tuple(bodies.parameters.tolist()), ())
    ]
    assert off[0] < 0.5 * off[1]


@pytest.mark.parametrize("rotors", [None, 0.0])  # no term, or one that fits leave at nought beside the links
def test_a_rotor_that_is_part_of_its_links_inertia_bends_neither_gain_nor_link(vs060, true_links, rotors):
    heavy = true_links.copy()
    heavy[9] += 40.0 * true_links[9]  # of the first link, which turns about z alone
    found = bodies_of(model_of(vs060, heavy, rotors=rotors))
    assert np.ptp(found.per_newton_metre / GAINS) < 0.02
    np.testing.assert_allclose(found.parameters.reshape(-1, 10)[:, 0], true_links.reshape(-1, 10)[:, 0], rtol=0.15)


def test_a_joint_whose_row_tells_no_gain_has_what_is_usual(vs060, true_links):
    def errors(joint, fitted):
        return (1e3 if joint == 5 else 1e-3) * np.diag(np.abs(fitted) + 1e-6)

    gains = bodies_of(model_of(vs060, true_links, errors=errors)).per_newton_metre
    assert gains[5] == pytest.approx(np.median(gains[:5]), rel=0.3)
    np.testing.assert_allclose(gains[:5] / GAINS[:5], 1.0, atol=0.05)


def with_tool(links, mass, away=0.08):
    """The last link with something of which the URDF does not tell."""
    held = links.copy()
    held[50:] += mass * np.array([1.0, 0.0, 0.0, away, away**2 + 0.002, 0.0, away**2 + 0.002, 0.0, 0.0, 0.002])
    return held


@pytest.mark.parametrize("mass", [0.5, 2.0, 6.0])
def test_a_tool_that_the_urdf_lacks_bends_no_gain(vs060, true_links, mass):
    found = bodies_of(model_of(vs060, with_tool(true_links, mass)))
    np.testing.assert_allclose(found.per_newton_metre / GAINS, 1.0, atol=0.05)
    assert found.parameters[50] == pytest.approx(true_links[50] + mass, rel=0.1)


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_a_last_link_that_the_urdf_has_without_its_mass_bends_no_gain(vs060, true_links, share):
    links = vs060.multibody.parameters.copy()
    links[50:] *= share
    light = replace(vs060, multibody=replace(vs060.multibody, parameters=links))
    model = model_of(vs060, true_links, errors=lambda joint, fitted: np.diag(0.02 * np.abs(fitted) + 1e-6))
    gains = bodies_of(replace(model, robot=light)).per_newton_metre
    np.testing.assert_allclose(gains / GAINS, 1.0, atol=0.1)


@pytest.mark.parametrize("rotor", [0.0, 1.0])
def test_rotors_of_sliding_joints_are_no_gain(gantry, rotor):
    axes, links = range(3), gantry.multibody.parameters
    fitted = [0.05 * Links(j).base(gantry).projection @ links for j in axes]
    for j in (0, 1):  # of the third one gravity tells
        fitted[j] = fitted[j] * (1.0 + rotor * links[10 * j] / links[10 * j :: 10].sum())
    rows = [Term(Links(j), coefficients=fitted[j], errors=np.zeros((len(fitted[j]), 1))) for j in axes]
    shown = Term(RotorInertia(2), coefficients=np.array([0.2]))
    gains = bodies_of(CurrentModel(gantry, (*rows, shown), 8.0, 100.0, np.ones(3), "A")).per_newton_metre
    np.testing.assert_allclose(gains[2], 0.05, rtol=0.02)
    # A row of one number tells its gain to as much as rotors leave open.
    assert np.all((gains[:2] > 0.045) & (gains[:2] < 0.05 * (1.1 + rotor)))


def test_the_search_for_gains_has_the_gradient_of_its_measure(vs060, true_links):
    model = model_of(vs060, true_links, rotors=None, errors=lambda joint, fitted: np.diag(0.02 * np.abs(fitted)))
    urdf = _Guess.of(model)
    rows = _Rows.of([_Row.of(model, term, urdf) for term in model.terms], urdf)
    place = np.append(np.log(rows.start), [-2.0, -3.0, 1.0])
    along = np.eye(len(place)) * 1e-5
    slope = [(rows._unlikely(place + d)[0] - rows._unlikely(place - d)[0]) / 2e-5 for d in along]
    np.testing.assert_allclose(rows._unlikely(place)[1], slope, rtol=1e-4, atol=1e-3)


def test_known_gains_are_one_and_the_urdf_stands_where_nothing_was_fitted(vs060, true_links):
    fitted = Links(None).base(vs060).projection @ true_links
    links = Term(Links(None), coefficients=fitted, errors=np.zeros((len(fitted), 1)))
    rotors = [Term(RotorInertia(j), coefficients=np.array([0.1])) for j in range(6)]
    model = CurrentModel(vs060, (links, *rotors), 8.0, 100.0, np.ones(6), NEWTON_METRE)
    found, none = bodies_of(model), bodies_of(replace(model, terms=()))
    np.testing.assert_array_equal(found.per_newton_metre, 1.0)
    base = Links(None).base(vs060).projection
    urdf = vs060.multibody.parameters
    # What shows is as fitted, but for what a fit leaves open itself.
    assert np.linalg.norm(base @ (found.parameters - true_links)) < 0.1 * np.linalg.norm(base @ (urdf - true_links))
    np.testing.assert_array_equal(none.parameters, urdf)
    np.testing.assert_array_equal(none.per_newton_metre, 1.0)


def test_a_model_whose_errors_are_not_known_stands_beside_the_urdf(vs060, true_links):
    # Rows that deny one another, were they exact, make gains no smaller.
    noisy = true_links * (1.0 + 0.5 * np.random.default_rng(1).standard_normal(true_links.size))
    model = model_of(vs060, noisy, errors=lambda joint, fitted: np.zeros((0, 0)))
    assert np.all(np.abs(np.log(bodies_of(model).per_newton_metre / GAINS)) < 1.0)


def test_relative_gains_share_one_factor(vs060, true_links):
    links = Term(Links(None), coefficients=7.0 * Links(None).base(vs060).projection @ true_links)
    found = bodies_of(CurrentModel(vs060, (links,), 8.0, 100.0, np.ones(6), f"relative {NEWTON_METRE}"))
    np.testing.assert_allclose(found.per_newton_metre, 7.0, rtol=0.05)


def test_a_urdf_without_masses_tells_no_gain(vs060, true_links):
    model = model_of(vs060, true_links)
    bare = replace(vs060, multibody=replace(vs060.multibody, parameters=np.zeros(60)))
    found = bodies_of(replace(model, robot=bare))
    np.testing.assert_array_equal(found.per_newton_metre, 1.0)
    np.testing.assert_array_equal(found.parameters, 0.0)
