"""Every effect of the catalogue: its gradient, its memory, its units, what it takes the place of."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from ident.effects import load_catalogue
from ident.effects.base import Context, Effect, initial_term
from ident.effects.direction import SMOOTHING
from ident.effects.electrical import Cogging, SensorDrift
from ident.effects.friction import Coulomb, LoadFriction, PositionFriction
from ident.effects.friction_curve import Stribeck
from ident.effects.hysteresis import Backlash, MaxwellSlip
from ident.effects.rigid_body import CableSpring, Links, RotorInertia
from ident.effects.ripple import GearRipple
from ident.effects.thermal import ThermalFriction
from ident.effects.timing import Delay, FilterLag
from ident.effects.transmission import Elasticity
from ident.errors import InputError
from ident.model import NEWTON_METRE, CurrentModel
from ident.robot import load_robot
from ident.signals import Motion

SLIDE = """<robot name="slide"><link name="a"/><link name="b"><inertial><mass value="2"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="100"/></joint></robot>"""

# Those made here for a test, or standing in for another effect's shapes, are no part of the catalogue.
CATALOGUE = {name: kind for name, kind in load_catalogue().items() if kind.__module__.startswith("ident.effects.")}
WHOLE = ("payload", "base-tilt")
SHAPED = sorted(name for name, kind in CATALOGUE.items() if kind(1).shapes)


def acting(name):
    """An effect of that name, on the second joint unless it only ever acts on the whole robot."""
    return CATALOGUE[name](None if name in WHOLE else 1)


def with_gap(context, rows):
    """The same where velocities, accelerations and loads of some rows are not known."""
    motion, load, total = context.motion, context.load.copy(), context.total.copy()
    dq, ddq = motion.dq.copy(), motion.ddq.copy()
    for values in (dq, ddq, load, total):
        values[rows] = np.nan
    return Context(context.robot, Motion(motion.t, motion.q, dq, ddq), load, context.links, total)


def central_difference(context, effect, shape, s, step):
    """Slope of an effect's columns by the s-th shape parameter."""
    moved = step * np.eye(len(shape))[s]
    sides = [effect.columns(context, shape + sign * moved, effect.start()) for sign in (1, -1)]
    return (sides[0] - sides[1]) / (2 * step)


def test_the_catalogue_has_the_contracts_names():
    contract = """payload base-tilt
    cable-spring gravity-balancer rotor-inertia coulomb viscous coulomb-asymmetry stribeck
    sigmoid viscous-nonlinear load-friction position-friction thermal-friction maxwell-slip cross-joint-hysteresis
    backlash cross-joint-friction elasticity gear-ripple drive-gain torque-saturation current-offset sensor-drift
    cogging delay filter-lag contact"""
    assert set(CATALOGUE) == {*contract.split(), "links"}
    families = {"rigid-body", "friction", "hysteresis", "transmission", "electrical", "timing", "contact"}
    assert {kind.family for kind in CATALOGUE.values()} <= families


@pytest.mark.parametrize("name", SHAPED)
@pytest.mark.parametrize("start", [0, -1])
def test_gradients_are_central_differences(context, name, start):
    effect = CATALOGUE[name](1)
    shape = np.array([s.starts[start] for s in effect.shapes], dtype=float)
    gradient = effect.gradient(context, shape)
    assert gradient.shape == (len(shape), len(context.motion), len(effect.coefficients(context.robot)))
    for s in range(len(shape)):
        slope = central_difference(context, effect, shape, s, 1e-6 * max(abs(shape[s]), 1e-3))
        # A Maxwell element that sticks at one step and slips at the other has no slope there.
        smooth = np.abs(gradient[s] - slope) <= 1e-5 * np.abs(gradient[s]).max()
        assert smooth.mean() > (0.99 if effect.family == "hysteresis" else 0.9999)


VARIANTS = (
    Elasticity(1, everywhere=True),
    Elasticity(1, rings=True),
    Elasticity(1, everywhere=True, rings=True),
    Elasticity(1, everywhere=True, rings=True, dry=2.0),
    Backlash(1, flies=True),
    Backlash(1, flies=True, dry=2.0),
    Backlash(1, flies=True, everywhere=True, dry=2.0),
    CableSpring(1, slack=True, middle=0.1, half=0.8),
    CableSpring(1, side=-1, middle=0.1, half=0.8),
    ThermalFriction(1, steady=True),
    ThermalFriction(1, mixed=True),
    SensorDrift(1, begins=(0.0, 2.0)),
    LoadFriction(1, per_newton_metre=2.0),
    LoadFriction(1, driven=True),
    Stribeck(1, power=None, lags=True),
    Stribeck(1, power=None, lags=True, presliding=1e-3),
    Elasticity(1, everywhere=True, rings=True, motor=0.2, even=2.0),
    GearRipple(1, harmonics=2, largest=5.0),
    GearRipple(1, harmonics=3, rolls=True),
    GearRipple(1, harmonics=2, fades=True),
    Delay(1, dry=(2.0,), turns=(2e-3,)),
    Delay(None, dry=(2.0,) * 6, turns=(2e-3,) * 6),
    FilterLag(1, dry=(2.0,), turns=(2e-3,)),
    FilterLag(None, dry=(2.0,) * 6, turns=(2e-3,) * 6),
    FilterLag(1, order=2),
    FilterLag(None, dry=(2.0,) * 6, turns=(2e-3,) * 6, order=2),
)


@pytest.mark.parametrize("effect", [*map(acting, sorted(CATALOGUE)), *VARIANTS])
@pytest.mark.parametrize("size", [1, 7, 150])
def test_memory_makes_blocks_as_good_as_the_whole(context, effect, size):
    shape = initial_term(effect).shape
    whole = effect.columns(context, shape, effect.start())
    memory = effect.start()
    rows = range(0, len(context.motion), size)
    pieces = [effect.columns(context.rows(slice(k, k + size)), shape, memory) for k in rows]
    np.testing.assert_allclose(np.concatenate(pieces), whole, rtol=1e-12, atol=1e-12)
    rows = len(context.motion)
    of_one = (rows,) if effect.acts_on is not None else (rows, 6)
    assert whole.shape == (*of_one, len(effect.coefficients(context.robot)))
    assert np.all(np.isfinite(whole))


@pytest.mark.parametrize("effect", [e for e in [*map(acting, sorted(CATALOGUE)), *VARIANTS] if e.start().size == 0])
def test_an_effect_without_memory_can_be_asked_of_no_rows(context, effect):
    found = effect.columns(context.rows(slice(0, 0)), initial_term(effect).shape, effect.start())
    of_one = (0,) if effect.acts_on is not None else (0, 6)
    assert found.shape == (*of_one, len(effect.coefficients(context.robot)))


@pytest.mark.parametrize("effect", [effect for effect in VARIANTS if effect.acts_on is None])
def test_a_row_is_that_of_all_rows(context, effect):
    shape = initial_term(effect).shape
    every = effect.columns(context, shape, effect.start())
    for joint in range(6):
        one = effect.row(context, shape, effect.start(), joint)
        np.testing.assert_allclose(one, every[:, joint], rtol=0, atol=1e-12 * np.abs(every).max())


@pytest.mark.parametrize("effect", [*map(acting, sorted(CATALOGUE)), *VARIANTS])
def test_samples_without_derivatives_are_passed_over(context, effect):
    shape = initial_term(effect).shape
    whole = effect.columns(context, shape, effect.start())
    found = effect.columns(with_gap(context, slice(40, 44)), shape, effect.start())
    late = slice(len(whole) // 2, None)
    np.testing.assert_allclose(found[late], whole[late], atol=0.1 * np.abs(whole).max(initial=0.0))


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_units_are_written_out_and_bounds_hold_the_starts(vs060, name):
    effect = acting(name)
    for force_unit in (NEWTON_METRE, "%Use"):
        model = CurrentModel(vs060, (initial_term(effect),), 5.0, 100.0, np.ones(6), force_unit)
        units = [model.unit_of(effect, p) for p in (*effect.shapes, *effect.coefficients(vs060))]
        assert all("{" not in unit and unit for unit in units)
        if name in ("coulomb", "viscous", "maxwell-slip", "current-offset", "cable-spring"):
            assert all(force_unit in unit for unit in units[len(effect.shapes) :])
    for s in effect.shapes:
        assert all(s.lower < start < s.upper for start in s.starts)
        assert not s.log or s.lower > 0


def test_a_drive_gives_more_or_less_and_saturates_one_way(vs060):
    (gain,), (lost,) = (CATALOGUE[name](1).coefficients(vs060) for name in ("drive-gain", "torque-saturation"))
    assert (gain.lower, lost.lower) == (-np.inf, 0.0)


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_what_an_effect_replaces_and_its_rivals_exist(name):
    for replaced in (*CATALOGUE[name].replaces, *CATALOGUE[name].rivals):
        assert replaced in CATALOGUE
        assert replaced != name


def test_units_on_a_prismatic_axis(write_card):
    robot = load_robot(write_card("slide", SLIDE, 'current_unit = "A"'))
    effect = RotorInertia(0)
    for force, unit in ((NEWTON_METRE, "N s^2/m"), ("A", "A s^2/m")):
        model = CurrentModel(robot, (), 5.0, 100.0, np.ones(1), force)
        assert model.unit_of(effect, effect.coefficients(robot)[0]) == unit


def test_links_of_one_row_are_those_of_the_robot(vs060, context):
    shared = Links(None).columns(context, np.zeros(0), np.zeros(0))
    base = vs060.rigid_body.base_parameters()
    torque = shared @ (base.projection @ vs060.multibody.parameters)
    for joint in range(6):
        own = Links(joint).base(vs060)
        row = Links(joint).columns(context, np.zeros(0), np.zeros(0)) @ (own.projection @ vs060.multibody.parameters)
        np.testing.assert_allclose(row, torque[:, joint], atol=1e-4)


def test_a_spring_leaves_the_motor_what_the_links_need_where_they_are(vs060):
    t = np.arange(600) * 0.002
    phase = 2.0 * np.pi * t[:, None] * np.linspace(0.6, 1.6, 6) + np.arange(6)
    speed = 2.0 * np.pi * np.linspace(0.6, 1.6, 6)
    motion = Motion(t, np.sin(phase), speed * np.cos(phase), -(speed**2) * np.sin(phase))
    links = np.tile(vs060.multibody.parameters, (6, 1))
    load = vs060.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, links)
    wind = CubicSpline(t, 0.02 / 30.0 * load[:, 1])
    moved = [np.array(x) for x in (motion.q, motion.dq, motion.ddq)]
    for order, x in enumerate(moved):
        x[:, 1] -= wind(t, order)
    effect = Elasticity(1, largest=30.0)
    context = Context(vs060, motion, load, links)
    change = 0.02 * effect.columns(context, np.array([0.02]), effect.start())[:, 0]
    true = vs060.rigid_body.inverse_dynamics(*moved, links) - load
    inside = slice(10, -10)
    np.testing.assert_allclose(change[inside], true[inside, 1], atol=0.01 * np.abs(true[:, 1]).max())
    everywhere = dataclasses.replace(effect, everywhere=True)
    assert everywhere.acts_on is None
    change = 0.02 * everywhere.columns(context, np.zeros(0), everywhere.start())[:, :, 0]
    np.testing.assert_allclose(change[inside], true[inside], atol=0.03 * np.abs(true).max())
    assert np.abs(change[inside]).max(axis=0)[2] > 0.1 * np.abs(true).max()
    moved[1:] = motion.dq, motion.ddq
    slow = dataclasses.replace(everywhere, slow=True)
    change = 0.02 * slow.columns(context, np.zeros(0), slow.start())[:, :, 0]
    stood = vs060.rigid_body.inverse_dynamics(*moved, links) - load
    np.testing.assert_allclose(change, stood, atol=0.08 * np.abs(stood).max())  # first order


def test_a_direct_drive_has_poles_and_no_gear(write_card, vs060):
    lines = f"joints = {list(vs060.joints)}", "[drive]", f"gear_ratio = {[1.0] * 6}"
    robot = load_robot(write_card("direct", vs060.urdf.read_text(), *lines))
    survey = SimpleNamespace(robot=robot, reach=np.full(6, 2.0))
    assert GearRipple.candidates(survey, 2) == []
    (poles,) = Cogging.candidates(survey, 2)
    (repeats,) = poles.shapes
    assert repeats.lower <= 14.0 <= repeats.upper
    assert 14.0 in repeats.starts


@pytest.mark.parametrize("reach", [0.4, 1.2, 4.0])
def test_no_ripple_hides_between_two_starts(vs060, reach):
    angle = np.linspace(0.0, reach, 20000)
    survey = SimpleNamespace(robot=vs060, reach=np.full(6, reach))
    repeats = np.array(Cogging.candidates(survey, 2)[0].shapes[0].starts)
    assert repeats.max() > 12.0 * vs060.gear_ratio[2]
    hidden = np.exp(1j * (repeats[:-1] + repeats[1:]) / 2.0 * angle[:, None])
    near = np.exp(1j * repeats[:-1] * angle[:, None])
    assert np.abs(np.mean(hidden * near.conj(), axis=0)).min() > 0.8


def test_a_ripple_is_one_if_two_of_its_waves_are_seen(vs060):
    for effect in (GearRipple, Cogging):
        for reach in (0.02, 0.5, 3.0):
            survey = SimpleNamespace(robot=vs060, reach=np.full(6, reach))
            for one in effect.candidates(survey, 2):
                assert one.shapes[0].lower * reach >= 4.0 * np.pi - 1e-9
    wide = SimpleNamespace(robot=vs060, reach=np.full(6, 3.0))
    assert GearRipple.candidates(wide, 2)[0].shapes[0].lower == pytest.approx(4.0 * np.pi / 3.0)


def test_wrong_uses_are_refused(context):
    with pytest.raises(InputError, match="load"):
        LoadFriction(0).columns(dataclasses.replace(context, load=None), np.zeros(0), np.zeros(0))
    with pytest.raises(InputError, match="it needs a joint, effect coulomb"):
        Coulomb(None).columns(context, np.zeros(0), np.zeros(0))


def test_a_subclass_with_a_name_enters_the_catalogue():
    class Quadratic(Effect):
        """Friction with the square of speed."""

        name = "test-quadratic"
        family = "friction"

        def coefficients(self, robot):
            return ()

        def columns(self, context, shape, memory):
            return np.zeros((len(context.motion), 0))

    class OfOneRobot(Quadratic):
        """The same, without a name of its own."""

    assert load_catalogue()["test-quadratic"] is Quadratic
    assert OfOneRobot(1).name == "test-quadratic"
    del Effect.catalogue["test-quadratic"]


@pytest.mark.parametrize(
    ("effect", "shape"),
    [
        (Stribeck(1, power=None), [0.1, 1.4]),
        (GearRipple(1, harmonics=2), [7.0]),
        (PositionFriction(1, harmonics=1), [2.0]),
        (CableSpring(1), [0.4]),
    ],
)
def test_gradients_of_fuller_forms_are_central_differences(context, effect, shape):
    shape = np.array(shape)
    gradient = effect.gradient(context, shape)
    for s in range(len(shape)):
        slope = central_difference(context, effect, shape, s, 1e-5)
        np.testing.assert_allclose(gradient[s], slope, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize("effect", [GearRipple(1), GearRipple(1, harmonics=2), Cogging(1), Stribeck(1), MaxwellSlip(1)])
@pytest.mark.parametrize("even", [True, False])
def test_a_sweep_gives_the_columns_at_each_shape(context, effect, even):
    first = np.array([s.starts[0] for s in effect.shapes], dtype=float)
    steps = np.arange(40) if even else np.arange(40) ** 1.5
    shapes = first + 0.25 * steps[:, None] * np.ones(len(first))
    together = np.array(list(effect.sweep(context, shapes)))
    alone = np.array([effect.columns(context, shape, effect.start()) for shape in shapes])
    np.testing.assert_allclose(together, alone, atol=1e-11)


@pytest.mark.parametrize("dry", [0.0, 0.5])
@pytest.mark.parametrize("hertz", [4.0, 9.0])
def test_a_link_swings_on_its_spring_as_two_masses_do(arm, hertz, dry):
    # The pendulum at the end of a chain whose first joint stands: its weight bends the spring, too.
    t = np.arange(800) / 200.0
    angle = CubicSpline(t, np.stack([np.full_like(t, 0.3), 0.5 * np.sin(2.0 * t) + 0.1 * np.sin(11.0 * t)], axis=1))
    q, dq, ddq = angle(t), angle(t, 1), angle(t, 2)
    links = np.tile(arm.multibody.parameters, (2, 1))

    def force(q, dq, ddq):
        return arm.rigid_body.inverse_dynamics(*(np.atleast_2d(x) for x in (q, dq, ddq)), links)

    inertia = float(arm.rigid_body.mass_matrix(q[:1], links)[0, 1, 1])
    stiffness, damping = inertia * (2.0 * np.pi * hertz) ** 2, 0.1
    drag = 2.0 * damping * np.sqrt(stiffness * inertia)

    def swing(s, y):
        # The link, at y behind the motor, moves as spring and damper make it.
        carried = stiffness * y[0] + drag * y[1]
        behind, slower = np.array([0.0, y[0]]), np.array([0.0, y[1]])
        rest = force(angle(s) - behind, angle(s, 1) - slower, np.zeros(2))[0, 1]
        link = angle(s, 1)[1] - y[1]
        return [y[1], angle(s, 2)[1] - (carried - rest - dry * link / np.hypot(link, SMOOTHING)) / inertia]

    load = force(q, dq, ddq)
    begun = [(load[0, 1] + dry * np.sign(dq[0, 1])) / stiffness, 0.0]
    wound = solve_ivp(swing, (0.0, t[-1]), begun, t_eval=t, rtol=1e-8, atol=1e-10).y
    carried = stiffness * wound[0] + drag * wound[1]
    effect = Elasticity(1, float(np.abs(load[:, 1]).max()), rings=True, dry=2.0 * dry)
    context = Context(arm, Motion(t, q, dq, ddq), load, links)
    shape = np.array([effect.largest / stiffness, damping, 0.5])[: len(effect.shapes)]
    told = effect.columns(context, shape, effect.start())[:, 0]
    lacks = carried - load[:, 1] - dry * np.tanh(dq[:, 1] / SMOOTHING)
    assert np.abs(lacks).max() > 0.03 * np.abs(load[:, 1]).max()
    later = t > 1.0  # how the spring begins is not known
    np.testing.assert_allclose(told[later], lacks[later], atol=(0.06 if dry else 0.05) * np.abs(lacks).max())


def test_a_link_follows_at_once_on_a_spring_too_stiff_for_the_samples(arm):
    t = np.arange(600) / 100.0
    q = np.stack([np.full_like(t, 0.3), 0.5 * np.sin(2.0 * t) + 0.1 * np.sin(11.0 * t)], axis=1)
    spline = CubicSpline(t, q)
    motion = Motion(t, q, spline(t, 1), spline(t, 2))
    links = np.tile(arm.multibody.parameters, (2, 1))
    load = arm.rigid_body.inverse_dynamics(motion.q, motion.dq, motion.ddq, links)
    context = Context(arm, motion, load, links)
    effect = Elasticity(1, float(np.abs(load[:, 1]).max()), rings=True)
    soft, stiff = (effect.columns(context, np.array([wound, 0.1]), effect.start())[5:, 0] for wound in (2e-4, 1e-4))
    np.testing.assert_allclose(soft, 2.0 * stiff, atol=1e-3 * np.abs(soft).max())
    assert np.abs(stiff).max() > 0.0


def test_a_braked_spring_is_looked_for_where_its_link_rings_below_the_cutoff(vs060):
    figures = {"largest": 30.0, "inertia": 2.0}
    survey = SimpleNamespace(robot=vs060, cutoff=8.0, **{key: np.full(6, value) for key, value in figures.items()})
    survey.holds = np.array([0.0, 1.5, 0.0, 0.0, 0.0, 0.0])
    assert [form.dry for form in Elasticity.candidates(survey, 0)] == [0.0, 0.0]
    (braked,) = (form for form in Elasticity.candidates(survey, 1) if form.dry > 0.0)
    wound = braked.shapes[0]
    assert np.sqrt(30.0 / wound.lower / 2.0) / (2.0 * np.pi) == pytest.approx(8.0)
    assert all(wound.lower < start < wound.upper for start in wound.starts)
