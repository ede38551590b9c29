"""The current model: online as offline, saved as loaded, and other robots refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, LoadFriction, Viscous
from ident.effects.friction_curve import Stribeck
from ident.effects.hysteresis import MaxwellSlip
from ident.effects.rigid_body import Links, RotorInertia
from ident.effects.transmission import CrossJointFriction
from ident.errors import InputError
from ident.fit import Drives, fit
from ident.log import JointLog, concatenate
from ident.model_file import load_model, save_model
from ident.predictor import CurrentPredictor
from ident.robot import load_robot
from ident.signals import derive

CUTOFF = 8.0
GAIN = np.array([0.71, 0.81, 0.403, 0.112, 0.144, 0.076])


@pytest.fixture(scope="module")
def log(recorded):
    return recorded(20.0)


@pytest.fixture(scope="module", params=["per-joint", "shared"])
def model(request, vs060, log):
    effects = [Links(None)] if request.param == "shared" else [Links(j) for j in range(6)]
    for j in range(6):
        effects += [CurrentOffset(j), Coulomb(j), Viscous(j)] + [RotorInertia(j)] * (request.param == "shared")
    effects += [MaxwellSlip(3), Stribeck(1), LoadFriction(2), CrossJointFriction(5, source=4)]
    gain, unit = (np.ones(6), "%Use") if request.param == "per-joint" else (GAIN, "N m")
    return fit(vs060, effects, [log], CUTOFF, Drives(gain, unit)).model


def stepped(model, log):
    model.reset()
    return np.array([model.step(sample) for sample in log.samples()])


@pytest.mark.parametrize("reports", ["q", "dq", "ddq"])
def test_steps_are_the_causal_prediction(model, log, reports):
    log = log[:600]
    motion = derive(log, 20.0)
    if reports != "q":
        log = log.replace(dq=motion.dq, ddq=motion.ddq if reports == "ddq" else None)
    whole = model.predict(log, causal=True)
    assert whole.shape == log.q.shape
    np.testing.assert_allclose(stepped(model, log), whole, rtol=1e-9, atol=1e-9)
    assert isinstance(model, CurrentPredictor)


def test_reset_forgets(model, log):
    first = stepped(model, log[:200])
    stepped(model, log[300:500])
    np.testing.assert_array_equal(stepped(model, log[:200]), first)
    model.reset()
    assert not np.allclose(model.step(next(log[300:].samples())), first[0])


def test_a_first_step_needs_no_reset(model, log):
    fresh = replace(model)
    np.testing.assert_array_equal(fresh.step(next(log.samples())), stepped(model, log[:1])[0])


@pytest.mark.parametrize("row", [0, 50])
def test_a_sample_without_position_gives_no_prediction_and_is_passed_over(model, log, row):
    log = log[:200]
    q = np.array(log.q)
    q[row, 2] = np.nan
    gappy = log.replace(q=q)
    online, whole = stepped(model, gappy), model.predict(gappy, causal=True)
    np.testing.assert_allclose(online, whole, rtol=1e-9, atol=1e-9)
    assert np.isnan(online[row]).all()
    assert np.isfinite(np.delete(online, row, axis=0)).all()


def test_segments_start_anew(model, log):
    two = concatenate([log[:300], log[700:1000]])
    for causal in (True, False):
        parts = [model.predict(part, causal) for part in (log[:300], log[700:1000])]
        np.testing.assert_allclose(model.predict(two, causal), np.concatenate(parts), rtol=1e-9, atol=1e-9)


def test_blocks_are_the_whole_prediction(model, recorded):
    log = recorded(200.0, seed=1)  # more than one block
    pieces = list(model.predict_blocks(log))
    assert len(pieces) > 1
    np.testing.assert_array_equal(np.concatenate([p.t for p, _ in pieces]), log.t)
    predicted = np.concatenate([p for _, p in pieces])
    np.testing.assert_array_equal(predicted, model.predict(log))
    memories = model.start()
    expected = model.force(derive(log, CUTOFF), memories) / model.gain
    np.testing.assert_allclose(predicted, expected, rtol=1e-6, atol=1e-6)
    residual = log.current - predicted
    assert np.all(np.sqrt(np.mean(residual**2, axis=0)) < 0.1 * log.current.std(axis=0))


def test_the_sum_is_links_rotors_and_friction(model, log):
    motion = derive(log[:400], CUTOFF)
    parts = model.load(motion) + model.rotor_inertia * motion.ddq + model.friction(motion)
    np.testing.assert_allclose(model.force(motion, model.start()), parts, rtol=1e-9, atol=1e-9)


def test_too_short_a_log_is_not_predicted(model, log):
    assert np.isnan(model.predict(log[:5])).all()
    assert len(model.predict(log[:1])) == 1


def test_saved_and_loaded_it_is_the_same(model, log, vs060, tmp_path):
    save_model(model, tmp_path)
    loaded = load_model(tmp_path, vs060)
    assert (loaded.cutoff, loaded.rate, loaded.force_unit) == (model.cutoff, model.rate, model.force_unit)
    np.testing.assert_array_equal(loaded.predict(log), model.predict(log))
    for before, after in zip(model.terms, loaded.terms, strict=True):
        assert before.effect == after.effect
        for name in ("shape", "coefficients", "std", "shape_std"):
            np.testing.assert_array_equal(getattr(before, name), getattr(after, name))
        np.testing.assert_allclose(before.errors, after.errors, rtol=1e-3)
    text = (tmp_path / "model.json").read_text()
    assert "NaN" not in text
    assert json.loads(text)["format"] == 1


def spoilt(tmp_path, model, change):
    save_model(model, tmp_path)
    content = json.loads((tmp_path / "model.json").read_text())
    change(content)
    (tmp_path / "model.json").write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(joints=["a"] * 6), "the model's joints"),
        (lambda c: c.update(unit="A"), "the model's unit A is not the robot's %Use"),
        (lambda c: c["terms"][7].update(effect="witchcraft"), "unknown effect 'witchcraft'"),
        (lambda c: c["terms"][0]["coefficients"].pop(), "do not fit the robot's URDF"),
        (lambda c: c["terms"][7]["shape"].append({"name": "span", "value": 1.0, "std": None}), "another version's law"),
        (lambda c: c["terms"][7]["errors"][0].pop(), "lacks or spoils errors, of which some"),
        (lambda c: c["terms"][0]["errors"][1].pop(), "lacks or spoils errors of links"),
        (lambda c: c["terms"][7].update(errors=[]), "lacks or spoils errors of [a-z]"),
        (lambda c: c["terms"][7].update(errors="x"), "lacks or spoils errors of [a-z]"),
        (lambda c: c["terms"][7].update(errors=[[float("nan")]]), "lacks or spoils errors of [a-z]"),
        (
            lambda c: c["origins"][2].__setitem__(0, c["origins"][2][0] + 0.3),
            "joint 3 lies 0.3 m elsewhere in its link",
        ),
        (lambda c: c["origins"].pop(), "lacks or spoils"),
        (lambda c: c.pop("terms"), "lacks or spoils 'terms'"),
        (lambda c: c["terms"][7].update(options={"smothing": 1.0}), "lacks or spoils"),
        (lambda c: c["terms"][7].update(joint="two"), "lacks or spoils"),
        (lambda c: c["terms"][7].update(joint=7), "lacks or spoils joint 7"),
        (lambda c: c.update(terms=3), "lacks or spoils"),
    ],
)
def test_files_that_do_not_fit_are_refused(model, vs060, tmp_path, change, message):
    spoilt(tmp_path, model, change)
    with pytest.raises(InputError, match=message):
        load_model(tmp_path, vs060)


def test_no_file_and_no_json_are_refused(vs060, tmp_path):
    with pytest.raises(InputError, match="no model"):
        load_model(tmp_path, vs060)
    for text in ("{", "[]", "\xff"):
        (tmp_path / "model.json").write_bytes(text.encode("latin-1"))
        with pytest.raises(InputError, match="not a model file"):
            load_model(tmp_path, vs060)


def test_another_robots_model_is_refused(model, tmp_path, urdf_path):
    save_model(model, tmp_path)
    (tmp_path / "robot.toml").write_text(f'name = "ur5"\nurdf = "{urdf_path("ur5")}"\ncurrent_unit = "%Use"\n')
    with pytest.raises(InputError, match="are not the robot's"):
        load_model(tmp_path, load_robot(tmp_path / "robot.toml"))


def test_units_say_what_the_gains_are(model):
    rotor = Coulomb(0)
    unit = model.unit_of(rotor, rotor.coefficients(model.robot)[0])
    assert unit == model.force_unit
    assert isinstance(model.predict(JointLog(np.arange(3) / 100, np.zeros((3, 6)), np.zeros((3, 6)))), np.ndarray)
