"""The compiled loop over one sample's terms gives what the effects' own columns give."""

import copy
import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from ident.effects import load_catalogue
from ident.effects.base import Coefficient, Effect, Term
from ident.effects.direction import DirectedEffect
from ident.effects.electrical import DriveGain
from ident.effects.friction import Coulomb, LoadFriction, Viscous
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links
from ident.effects.thermal import ThermalFriction
from ident.gap.rows import panel_of, survey_of
from ident.log import JointLog
from ident.model import NEWTON_METRE, CurrentModel
from ident.online_friction import ENCODED, Memories, OneSample
from ident.signals import Motion

IDENTIFIED = [
    *("coulomb", "viscous", "current-offset", "rotor-inertia", "coulomb-asymmetry", "stribeck", "sigmoid"),
    *("viscous-nonlinear", "load-friction", "cable-spring", "gear-ripple", "cross-joint-friction", "maxwell-slip"),
]
CATALOGUE = {name: kind for name, kind in load_catalogue().items() if kind.__module__.startswith("ident.effects.")}


class Doubled(Coulomb):
    """A user's effect: derived from an encoded one, with columns of its own."""

    def columns(self, context, shape, memory):
        return 2.0 * super().columns(context, shape, memory)


class Counting(Effect):
    """A user's effect that remembers how many samples it saw, in a table of two rows."""

    def start(self):
        return np.zeros((2, 1))

    def coefficients(self, robot):
        return (Coefficient("force", "{current}"),)

    def columns(self, context, shape, memory):
        seen = memory[1, 0] + np.arange(1.0, len(context.motion.t) + 1.0)
        memory[1, 0] = seen[-1]
        return seen[:, None]


@dataclass(frozen=True)
class Steady(Effect):
    """A user's effect without memory."""

    def coefficients(self, robot):
        return (Coefficient("force", "{current}"),)

    def columns(self, context, shape, memory):
        return np.ones((len(context.motion.t), 1))


def term(effect: Effect, rng: np.random.Generator, robot) -> Term:
    """The effect with shape parameters somewhere within their bounds and random coefficients."""
    share = rng.uniform(0.05, 0.95, len(effect.shapes))
    shape = [s.lower + f * (s.upper - s.lower) for f, s in zip(share, effect.shapes, strict=True)]
    return Term(effect, np.array(shape), rng.normal(size=len(effect.coefficients(robot))))


def wander(rng: np.random.Generator, rows: int = 400) -> Motion:
    """Random motion with reversals, stretches at rest, and one row that holds NaN."""
    t = np.arange(rows) / 100.0
    dq = 0.3 * np.cumsum(rng.normal(size=(rows, 6)), axis=0) / np.sqrt(rows) * rng.choice([1e-2, 1.0], (1, 6))
    dq[100:140] = 0.0
    q = rng.uniform(-1.5, 1.5, 6) + np.cumsum(dq, axis=0) / 100.0
    motion = Motion(t, q, dq, rng.normal(size=(rows, 6)))
    motion.q[200], motion.dq[200], motion.ddq[200] = np.nan, np.nan, np.nan
    return motion


def model_of(robot, *terms: Term) -> CurrentModel:
    links = Term(Links(None), coefficients=robot.rigid_body.base_parameters().projection @ robot.multibody.parameters)
    return CurrentModel(robot, (links, *terms), 10.0, 100.0, np.ones(6), NEWTON_METRE)


def by_columns(model: CurrentModel, motion: Motion, memories: list[np.ndarray]) -> np.ndarray:
    """Force of all terms but the links, from the effects' own columns over the whole motion."""
    context, force = model.context(motion), np.zeros_like(motion.q)
    for t, memory in zip(model.terms[1:], memories[1:], strict=True):
        force[:, t.effect.at] += t.effect.columns(context, t.shape, memory) @ t.coefficients
    return force


def by_samples(model: CurrentModel, motion: Motion, memories: Memories) -> np.ndarray:
    force, load = np.zeros_like(motion.q), model.load(motion)
    for k in range(len(motion)):
        model.one_sample.add(motion.t[k], motion.q[k], motion.dq[k], motion.ddq[k], load[k], memories, force[k])
    return force


def agreed(model: CurrentModel, motion: Motion, rtol: float) -> np.ndarray:
    """Force of two encoded terms, of which loop and columns agree, and so do their memories."""
    assert model.one_sample.encoded == (False, True, True)
    ours, theirs = model.start(), model.start()
    expected, found = by_columns(model, motion, theirs), by_samples(model, motion, ours)
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=1e-12)
    np.testing.assert_allclose(ours.flat, theirs.flat, rtol=1e-12, atol=1e-12)
    return expected


def stepped_as_whole(model: CurrentModel, motion: Motion) -> None:
    """The force sample by sample is that of all samples at once."""
    whole, memories = model.force(motion, model.start()), model.start()
    single = np.concatenate([model.force(motion[k : k + 1], memories) for k in range(len(motion))])
    scale = np.nanmax(np.abs(whole), axis=0) + 1.0
    np.testing.assert_allclose(single / scale, whole / scale, rtol=0, atol=1e-11)


def test_what_identification_uses_is_encoded():
    assert {kind.name for kind in ENCODED} == set(IDENTIFIED)
    assert sorted(kind.number for kind in ENCODED.values()) == list(range(len(ENCODED)))


@pytest.mark.parametrize("name", IDENTIFIED)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_loop_gives_the_columns(vs060, name, seed):
    rng = np.random.default_rng(seed)
    kind = CATALOGUE[name]
    effects = [kind(j, source=(j + 2) % 6) if name.startswith("cross") else kind(j) for j in (4, 0)]
    model = model_of(vs060, *(term(effect, rng, vs060) for effect in effects))
    expected = agreed(model, wander(rng), 1e-12)
    assert (np.nanmax(np.abs(expected), axis=0) > 0.0).tolist() == [True, False, False, False, True, False]


@pytest.mark.parametrize("kind", [k for k in ENCODED if issubclass(k, DirectedEffect)], ids=lambda kind: kind.name)
def test_directions_that_build_up_give_the_columns(vs060, kind):
    rng = np.random.default_rng(3)
    forms = kind(4, presliding=3e-4), kind(0, presliding=2e-3, presliding_exponent=0.3)
    model = model_of(vs060, *(term(effect, rng, vs060) for effect in forms))
    agreed(model, wander(rng), 1e-9)


@pytest.mark.parametrize("kind", ENCODED, ids=lambda kind: kind.name)
def test_every_form_that_a_gap_is_asked_for_steps_as_its_columns(vs060, recorded, kind):
    rng, model = np.random.default_rng(7), model_of(vs060, Term(Coulomb(4), coefficients=np.ones(1)))
    survey = survey_of(model, panel_of(model, [recorded()]))
    plain = kind.candidates(survey, 4)
    forms = [*plain, *(fuller for effect in plain for fuller in effect.fuller(survey))]
    model = model_of(vs060, *(term(effect, rng, vs060) for effect in forms))
    assert any(model.one_sample.encoded)
    stepped_as_whole(model, wander(rng))


def test_a_searched_power_is_encoded_and_fuller_forms_are_left_to_their_columns(vs060):
    rng = np.random.default_rng(7)
    stribeck, ripple, cable = (CATALOGUE[name] for name in ("stribeck", "gear-ripple", "cable-spring"))
    ripples = ripple(0, harmonics=2), ripple(2, largest=9.0), ripple(3, rolls=True)
    forms = stribeck(4, power=None), cable(1, slack=True), cable(1, side=-1), *ripples, stribeck(5, lags=True)
    model = model_of(vs060, *(term(effect, rng, vs060) for effect in forms))
    assert model.one_sample.encoded == (False, True, False, False, False, False, False, False)


def test_memory_goes_on_between_samples_and_blocks(vs060):
    rng = np.random.default_rng(5)
    terms = [
        Term(MaxwellSlip(j, spread), np.array([2e-3]), rng.uniform(size=len(spread)))
        for j, spread in ((1, (0.25, 1.0, 4.0)), (3, (1.0,)), (1, (0.5, 2.0)))
    ]
    terms += [
        term(kind(2, presliding=1e-3, presliding_exponent=0.4), rng, vs060) for kind in (Coulomb, ThermalFriction)
    ]
    model, motion = model_of(vs060, *terms), wander(rng, 900)
    whole = model.friction(motion)
    memories = model.start()
    parts = [slice(0, 1), slice(1, 300), *(slice(k, k + 1) for k in range(300, 600)), slice(600, 900)]
    pieces = np.concatenate([model.friction(motion[part], memories) for part in parts])
    np.testing.assert_allclose(pieces, whole, rtol=1e-12, atol=1e-12)


def test_other_effects_keep_to_their_columns(vs060):
    rng = np.random.default_rng(6)
    effects = [kind(1) for kind in CATALOGUE.values() if kind not in ENCODED and kind.name not in ("links", "contact")]
    effects = [kind(None) if (kind := type(e)).name in ("payload", "base-tilt") else e for e in effects]
    mixed = [Coulomb(2), Doubled(2), LoadFriction(2), Counting(0), MaxwellSlip(1), DriveGain(2)]
    model = model_of(vs060, *(term(effect, rng, vs060) for effect in (*effects, *mixed)))
    assert [type(t.effect) for t, e in zip(model.terms, model.one_sample.encoded, strict=True) if e] == [
        Coulomb,
        LoadFriction,
        MaxwellSlip,
    ]
    stepped_as_whole(model, wander(rng)[:190])  # what averages over samples does not get over a NaN


def test_odd_terms_are_left_to_complain(vs060):
    fine = np.ones(1)
    odd = (Term(Coulomb(7), coefficients=fine), Term(Coulomb(-1), coefficients=fine), Term(Viscous(0)))
    assert OneSample(odd, vs060).encoded == (False, False, False)
    row = wander(np.random.default_rng(0))[:1]
    for term_, error in ((odd[0], IndexError), (odd[2], ValueError)):
        with pytest.raises(error):
            model_of(vs060, term_).friction(row)


def test_a_copy_of_memories_is_its_own(vs060):
    memories = Memories.start([Term(MaxwellSlip(0)), Term(Counting(1)), Term(Coulomb(0))])
    assert [m.shape for m in memories] == [(3,), (2, 1), (0,)]
    for other in (copy.deepcopy(memories), pickle.loads(pickle.dumps(memories))):
        other.flat[:] = 7.0
        assert (other[0] == 7.0).all()
        assert np.isnan(memories[0]).all()


def test_a_model_steps_as_it_predicts(vs060):
    rng = np.random.default_rng(8)
    effects = [kind(j) for j in range(6) for kind in (Coulomb, Viscous, MaxwellSlip, LoadFriction)]
    t = np.arange(200) / 100.0
    log = JointLog(t, 0.4 * np.sin(2.0 * t[:, None] + np.arange(6)), np.zeros((200, 6)))
    for more in ([], [Steady(3)], [Doubled(1), DriveGain(2)]):
        model = model_of(vs060, *(term(effect, rng, vs060) for effect in [*effects, *more]))
        model.reset()
        stepped = np.array([model.step(sample) for sample in log.samples()])
        np.testing.assert_allclose(stepped, model.predict(log, causal=True), rtol=0, atol=1e-9)
