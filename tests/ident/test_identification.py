"""From logs to an identified model: what is found, what is said, what is refused."""

import numpy as np
import pytest

from comparisons.virtual_robot import simulate
from ident.errors import InputError
from ident.identification import identify
from ident.log import concatenate
from ident.model_file import load_model
from ident.robot import load_robot

PLAIN = ["coulomb", "viscous"]
GAIN = [0.71, 0.81, 0.403, 0.112, 0.144, 0.076]


@pytest.fixture(scope="module")
def virtual_log(vs060):
    return simulate(vs060, protocol="sinusoid", seconds=60.0, seed=1)[0]


@pytest.fixture(scope="module")
def known(vs060, tmp_path_factory):
    folder = tmp_path_factory.mktemp("known")
    (folder / "robot.toml").write_text(
        f'name = "vs060"\nurdf = "{vs060.urdf}"\ncurrent_unit = "%Use"\n[drive]\ngain = {GAIN}\n'
    )
    return load_robot(folder / "robot.toml")


def test_the_virtual_arm_end_to_end(vs060, virtual_log, tmp_path):
    told = []
    found = identify(
        vs060, [virtual_log], effects=["coulomb", "viscous", "maxwell-slip"], progress=lambda *x: told.append(x)
    )
    predicted = found.model.predict(virtual_log)
    error = np.linalg.norm(virtual_log.current - predicted, axis=0) / np.linalg.norm(virtual_log.current, axis=0)
    assert np.all(error < 0.25)
    assert found.gains == "per-joint"
    assert found.warnings == ()
    assert told[-1] == ("fitting", 1.0)
    found.write(tmp_path)
    np.testing.assert_array_equal(load_model(tmp_path, vs060).predict(virtual_log), predicted)
    result = found.result()
    assert result["joints"] == list(vs060.joints)
    assert result["unit"] == result["force_unit"] == "%Use"
    assert 1 < result["condition_number"] < 1000
    assert {"name", "value", "std", "unit"} <= set(result["parameters"][0])
    assert result["effects"]["4"] == ["links", "current-offset", "rotor-inertia", "coulomb", "viscous", "maxwell-slip"]


def test_effects_are_chosen_where_none_are_named(vs060, recorded):
    found = identify(vs060, [recorded(20.0, noise=1.0)], cutoff=10.0)
    assert found.structure is not None
    assert found.structure.effects == tuple(t.effect for t in found.model.terms)
    assert all(
        {"coulomb", "viscous"} & {t.effect.name for t in found.model.terms if t.effect.joint == j} for j in range(6)
    )


def test_the_speed_over_which_signs_turn_is_chosen_and_is_no_friction_law(vs060, recorded):
    found = identify(vs060, [recorded(40.0, seed=seed) for seed in (1, 2, 3)], cutoff=20.0)
    laws = [t.effect for t in found.model.terms]
    for j in range(6):
        (coulomb,) = [e for e in laws if e.name == "coulomb" and e.joint == j]
        assert 2.5e-3 < coulomb.smoothing <= 1e-2
    assert not {"sigmoid", "cross-joint-friction"} & {e.name for e in laws}


def test_a_sign_that_turns_too_slowly_is_left_to_a_law_of_its_own(vs060, recorded):
    def slowly(motion):
        return 5.0 * (np.tanh(motion.dq / 0.1) - np.tanh(motion.dq / 5e-3))

    found = identify(vs060, [recorded(40.0, seed=s, extra=slowly) for s in (1, 2, 3)], cutoff=20.0, effects=PLAIN)
    assert all(t.effect.smoothing < 1e-3 for t in found.model.terms if t.effect.name == "coulomb")


@pytest.mark.parametrize("gains", ["per-joint", "shared", "known"])
def test_a_joint_that_never_moves_is_named_and_the_rest_identified(known, recorded, gains):
    log = recorded(30.0)
    motion_less = np.array(log.q)
    motion_less[:, 3] = 0.2 + 1e-5 * np.sin(log.t)
    still = log.replace(q=motion_less, current=torque_of(known, log, motion_less))
    found = identify(known, [still], gains=gains, effects=PLAIN)
    assert any("Joint 4 (joint_4) never moves" in warning for warning in found.warnings)
    named = {p.name: p for p in found.parameters}
    assert "coulomb.4.force" not in named
    for joint in (1, 2, 3, 5, 6):
        assert named[f"coulomb.{joint}.force"].determined
    error = still.current - found.model.predict(still)
    inside = slice(50, -50)
    assert np.all(np.sqrt(np.mean(error[inside] ** 2, axis=0)) < 1.0)


def torque_of(robot, log, q):
    """Current of the arm, with Coulomb and viscous friction, for positions (N, 6) sampled at a log's times."""
    dq = np.gradient(q, log.t, axis=0)
    ddq = np.gradient(dq, log.t, axis=0)
    torque = robot.rigid_body.inverse_dynamics(q, dq, ddq, robot.multibody.parameters)
    noise = 0.1 * np.random.default_rng(0).normal(size=q.shape)
    return torque / np.array(GAIN) + 5.0 * np.tanh(dq / 5e-3) + 3.0 * dq + 1.0 + noise


@pytest.mark.parametrize("gains", ["per-joint", "known"])
@pytest.mark.parametrize("joint", [1, 4])
def test_a_flipped_current_is_said_of_its_joint(known, virtual_log, gains, joint):
    flipped = np.array(virtual_log.current)
    flipped[:, joint] *= -1
    found = identify(known, [virtual_log.replace(current=flipped)], gains=gains, effects=PLAIN)
    said = [warning for warning in found.warnings if "flipped" in warning]
    assert [warning.split(":")[0] for warning in said] == [f"Joint {joint + 1} (joint_{joint + 1})"]


def test_gains_known_give_newton_metres_and_a_body(known, virtual_log, tmp_path):
    found = identify(known, [virtual_log], effects=PLAIN)
    assert found.gains == "known"
    assert found.model.force_unit == "N m"
    assert found.feasible is not None
    found.write(tmp_path)
    weighed = load_urdf(tmp_path / "identified.urdf", tmp_path).multibody.parameters
    np.testing.assert_allclose(weighed, found.feasible.preferred.parameters, rtol=1e-6, atol=1e-8)
    assert found.result()["feasible"]["parameters"] == found.feasible.preferred.parameters.tolist()


def load_urdf(path, folder):
    (folder / "robot.toml").write_text(f'name = "vs060"\nurdf = "{path}"\n')
    return load_robot(folder / "robot.toml")


def test_gains_shared_are_relative_with_intervals(vs060, recorded):
    found = identify(vs060, [recorded(40.0, noise=0.05)], gains="shared", effects=PLAIN, cutoff=10.0)
    estimate = found.gain_estimate
    assert found.model.force_unit == "relative N m"
    assert np.log(estimate.value).mean() == pytest.approx(0.0, abs=1e-9)
    relative = np.array(GAIN) / np.exp(np.mean(np.log(GAIN)))
    np.testing.assert_allclose(estimate.value[1:3], relative[1:3], rtol=0.1)
    assert len(found.result()["gain_interval"]) == 6


def test_a_segment_of_one_row_does_no_harm(vs060, recorded):
    log = recorded(20.0)
    odd = concatenate([log[:1], log[5:], log[:1]], "odd")
    found = identify(vs060, [odd], effects=PLAIN)
    predicted = found.model.predict(odd)
    assert np.isnan(predicted[[0, -1]]).all()
    assert np.isfinite(predicted[1:-1]).all()


def test_named_effects_act_where_they_can(vs060, recorded):
    found = identify(vs060, [recorded(10.0)], effects=[*PLAIN, "coulomb", "cross-joint-friction"], cutoff=10.0)
    wrists = [t.effect for t in found.model.terms if t.effect.name == "cross-joint-friction"]
    assert [(e.joint, e.source) for e in wrists] == [(4, 5), (5, 4)]
    assert sum(t.effect.name == "coulomb" for t in found.model.terms) == 6


def test_named_effects_know_the_logs(vs060, recorded):
    names = ["thermal-friction", "cross-joint-hysteresis", "elasticity"]
    found = identify(vs060, [recorded(10.0)], effects=[*PLAIN, *names], cutoff=10.0)
    thermal, other, spring = ([t.effect for t in found.model.terms if t.effect.name == name] for name in names)
    assert len({e.pace for e in thermal}) == len({e.largest for e in spring}) == 6
    assert [(e.joint, e.source) for e in other] == [(4, 5), (5, 4)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"effects": ["coulom"]}, "no effect is named 'coulom'"),
        ({"effects": ["payload"]}, "payload is no effect of one joint"),
        ({"gains": "known"}, "the drive gains are not known"),
        ({"gains": "payload"}, "no logs with a payload"),
        ({"cutoff": 80.0}, "cut-off of 80 Hz"),
    ],
)
def test_wrong_calls_are_refused(vs060, recorded, options, message):
    with pytest.raises(InputError, match=message):
        identify(vs060, [recorded(10.0)], **{"effects": PLAIN} | options)


@pytest.mark.parametrize("rows", [1, 2, 10])
def test_logs_too_short_are_refused(vs060, recorded, rows):
    with pytest.raises(InputError, match=r"too short|fewer than two rows"):
        identify(vs060, [recorded(10.0)[:rows]], effects=PLAIN)
    with pytest.raises(InputError, match="no log"):
        identify(vs060, [])
