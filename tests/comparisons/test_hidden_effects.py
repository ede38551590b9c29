"""The hidden-effect benchmark: scoring of hand-made answers, the hidden laws, suites, rivals' rules, resuming a run."""

import json
import math
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from comparisons.hidden_effects import benchmark as bench
from comparisons.hidden_effects.answer import Answer, Name, Secret, Truth, truth_from
from comparisons.hidden_effects.benchmark_page import page, plots, results
from comparisons.hidden_effects.cases import CHANGES, WHOLE_ROBOT, Case, Hidden, Maker, make, robot_of
from comparisons.hidden_effects.identifiability import SURE
from comparisons.hidden_effects.laws import FOREIGN, LAWS
from comparisons.hidden_effects.measured import measured_tasks
from comparisons.hidden_effects.rates import Rate, Score
from comparisons.hidden_effects.rivals import _merged, best_mae, frols, sparse_regression, stepwise_bic
from comparisons.hidden_effects.scoring import Judged, calibration, confusion, curves, parameter_error, table
from comparisons.hidden_effects.styles import POOR, reference
from comparisons.hidden_effects.suites import SUITES, Sizes, Task, tasks
from comparisons.hidden_effects.work import WORKFLOW, judged, work
from ident.effects import load_catalogue
from ident.effects.base import Context
from ident.effects.hysteresis import Backlash
from ident.effects.survey import Survey
from ident.errors import InputError
from ident.gap import baseline_model, find_gap
from ident.gap.candidates import grid
from ident.gap.problem import JointProblem
from ident.model_file import load_model, save_model
from ident.signals import Motion

STRIBECK = Secret("stribeck", (1,), 1.0, {"force": 2.0, "speed": 0.04})


def judge(kind, secrets, findings=(), unexplained=(), after=(1.0, 1.0, 1.0), noise=(1.0, 1.0, 1.0), **said):
    return Judged(
        Truth("case", "vs060", kind, tuple(secrets), noise, noise),
        Answer(tuple(findings), tuple(unexplained), (), after, **said),
    )


def right(p_value=1e-4, force=2.1):
    return Name("stribeck", (1,), ("sigmoid",), {"force": force}, p_value)


def test_wilson_interval_of_known_counts():
    # Newcombe 1998, table I: 81 of 263 and 0 of 20
    assert Rate(81, 263).interval == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert Rate(0, 20).interval == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert Rate(20, 20).interval[1] == 1.0
    assert all(math.isnan(x) for x in (Rate(0, 0).value, *Rate(0, 0).interval))


def test_f1_counts_names_with_their_joints():
    load = Secret("load-friction", (0,), 1.0, {})
    both = judge("pair", [STRIBECK, load], [right(), Name("load-friction", (0,))])
    wrong_joint = judge("pair", [STRIBECK, load], [right(), Name("load-friction", (2,))])
    twice = judge("pair", [STRIBECK, load], [right(), right()])
    assert (both.counts, wrong_joint.counts, twice.counts) == ((2, 0, 0), (1, 1, 1), (1, 1, 1))
    assert Score.f1([both.counts, wrong_joint.counts]).value == pytest.approx(6 / 8)
    assert Score.f1([(0, 0, 1)]).value == 0.0
    low, high = Score.f1([both.counts, wrong_joint.counts] * 20).interval
    assert 0.5 <= low < 0.75 < high <= 1.0


def test_table_of_hand_made_answers():
    sigmoid_first = Name("sigmoid", (1,), ("stribeck",))
    cases = [
        judge("single", [STRIBECK], [right()], after=(9.0, 1.2, 9.0)),
        judge("single", [STRIBECK], [sigmoid_first], after=(9.0, 1.4, 9.0)),
        judge("single", [STRIBECK], [Name("backlash", (2,))], after=(9.0, 2.0, 9.0)),
        judge("single", [STRIBECK], [], [(1,)], after=(9.0, 3.0, 9.0)),
        judge("nothing", []),
        judge("nothing", [], [right()]),
        judge("foreign", [Secret("hum", (2,), 1.0, {})], [], [(0,), (2,)]),
        judge("foreign", [Secret("hum", (2,), 1.0, {})], [], [(0,)]),
        judge("foreign", [Secret("hum", (2,), 1.0, {})], [Name("backlash", (2,))], [(2,)]),
        Judged(Truth("case", "vs060", "nothing", (), (1.0,), (1.0,)), None),
    ]
    found = {row: (score.value, score.of) for row, score in table(cases).items()}
    assert found["first name right"] == (0.25, 4)
    assert found["true name in name + alternatives"] == (0.5, 4)
    assert found["joint right"] == (0.75, 4)
    assert found["a name, where nothing is hidden"] == (pytest.approx(2 / 3), 3)  # a breakdown is no silence
    assert found["silence on effects outside the catalogue"] == (pytest.approx(1 / 3), 3)
    assert found["test RMSE over that with the law known"] == (pytest.approx(1.7), 4)  # of the hidden joint alone
    assert found["test RMSE over the noise"] == (pytest.approx(1.7), 4)
    assert found["no name too many"] == (0.5, 4)
    assert found["main parameter's error"] == (pytest.approx(0.05), 1)
    assert "F1, two effects" not in found


def test_errors_of_the_whole_robot_are_over_all_joints():
    lag = judge("single", [Secret("delay", (), 1.0, {"seconds": 5e-3})], [Name("delay", (), (), {"seconds": 4e-3})],
                after=(1.0, 2.0, 2.0), noise=(1.0, 2.0, 1.0))  # fmt: skip
    assert lag.error_ratio == pytest.approx(math.sqrt((1 + 1 + 4) / 3))
    assert lag.parameter_errors == [pytest.approx(0.2)]
    assert lag.name_right
    assert lag.joint_right


def test_error_of_a_gain_is_of_its_distance_from_one():
    gain = Name("drive-gain", (0,), (), {"scale": 0.97})
    assert parameter_error(gain, "drive-gain", {"scale": 0.96}) == pytest.approx(0.25)
    assert math.isnan(parameter_error(Name("position-friction", (0,)), "position-friction", {}))


def test_errors_from_the_nearest_law_stand_beside_those_from_the_true_one():
    ripple = Secret("gear-ripple", (1,), 1.0, {"force": 2.0}, None, {"force": 2.2})
    balancer = Secret("gravity-balancer", (1,), 1.0, {}, None, {"force": 9.0})  # has no true force
    scores = table([
        judge("single", [secret], [Name(secret.effect, (1,), (), {"force": 2.1})]) for secret in (ripple, balancer)
    ])  # fmt: skip
    found = {row: (score.value, score.of) for row, score in scores.items()}
    assert found["main parameter's error"] == (pytest.approx(0.05), 1)
    assert found["the same from the catalogue's law nearest to what is hidden"] == (pytest.approx(0.1 / 2.2), 1)


def test_curves_calibration_and_confusion():
    weak = Secret("stribeck", (1,), 0.5, {})
    cases = [
        judge("single", [STRIBECK], [right(1e-4)]),
        judge("single", [weak], [Name("sigmoid", (1,), (), {}, 5e-3)]),
        judge("single", [weak], [], [(1,)]),
        judge("nothing", [], [right(5e-3)], least_p_value=5e-3),
        judge("nothing", [], least_p_value=0.2),
    ]
    by_severity = curves(cases)["first name right"]
    assert {x: (s.value, s.of) for x, s in by_severity.items()} == {0.5: (0.0, 2), 1.0: (1.0, 1)}
    held = calibration(cases)
    assert {p: s.value for p, s in held["nothing hidden"].items()} == {
        1e-5: 0, 1e-4: 0, 1e-3: 0, 3e-3: 0, 0.01: 0.5, 0.03: 0.5, 0.1: 0.5, 0.3: 0.5,
    }  # fmt: skip
    assert [held["candidates"][p].value for p in (3e-3, 0.01, 0.1, 0.3)] == [0.0, 0.5, 0.5, 1.0]
    assert (held["names"][1e-4].value, held["names"][1e-4].of) == (0.0, 1)
    assert (held["names"][0.01].value, held["names"][0.01].of) == (1.0, 2)
    assert confusion(cases) == {
        "stribeck": {"stribeck": 1, "sigmoid": 1, "unexplained": 1},
        "nothing": {"stribeck": 1, "silent": 1},
    }


def test_clarity_is_severity_over_what_the_baseline_leaves():
    def truth(*secrets):
        return Truth("case", "vs060", "single", secrets, (1.0, 1.0), (2.0, 1.0))

    first, second = Secret("stribeck", (0,), 1.0, {}), Secret("stribeck", (1,), 2.0, {})
    assert (truth(first).clarity, truth(second).clarity, truth(first, second).clarity) == (0.5, 2.0, 0.5)
    assert truth(Secret("delay", (), 2.0, {})).clarity == pytest.approx(2.0 * math.sqrt(0.625))
    assert truth().clarity is None


@pytest.fixture(scope="module")
def rows():
    """A maker with the scenes of one log, for looking at laws."""
    maker = Maker(Case("vs060", (), 3))
    return maker, [maker.scene(maker.paths(0))]


BY_DEFINITION = ("rotor-inertia", "current-offset", "drive-gain")
"""Effects whose law can be but one: the acceleration, a constant, the whole current."""


@pytest.mark.parametrize("name", [n for n in [*LAWS, *FOREIGN] if n not in BY_DEFINITION])
def test_laws_are_not_in_the_span_of_the_catalogues_columns(name, rows):
    """A law that the catalogue could give exactly would test nothing but the solver."""
    maker, scenes = rows
    joint, scene = 1, scenes[0]
    force = maker.effect(Hidden(name, joint, 1.0), scene, 1.0)[0][:, joint]
    assert np.linalg.norm(force) > 0
    kind = load_catalogue().get(name)
    if kind is None:
        return
    n = maker.robot.n
    motion = Motion(scene.t, scene.q, scene.dq, scene.ddq)
    links = np.tile(maker.parameters, (n, 1))
    context = Context(maker.robot, motion, scene.torque, links, scene.known)
    survey = Survey(
        robot=maker.robot, smoothing=np.full(n, 2e-3), presliding=np.zeros(n), presliding_exponent=np.ones(n),
        pace=np.abs(scene.dq).mean(0), friction=maker.coulomb, viscous=np.zeros(n), weight=np.ones(n),
        largest=np.abs(scene.known).max(0), per_newton_metre=np.ones(n), links=maker.parameters, load_ratio=np.ones(n),
        since=0.0, lasts=60.0, logged=1.0, begins=(0.0,), rate=100.0, reach=np.ptp(scene.q, axis=0),
        middle=scene.q.min(axis=0) + 0.5 * np.ptp(scene.q, axis=0), holds=maker.coulomb, steps=maker.coulomb,
        cutoff=8.0, inertia=np.ones(n), motor=np.full(n, 0.1),
    )  # fmt: skip
    effects = [*kind.candidates(survey, joint), *kind.candidates(survey, None)]
    assert effects
    for effect in effects:
        for shape in list(grid(effect.shapes))[:12]:
            columns = effect.row(context, shape, effect.start(), joint)
            left = force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]
            assert np.linalg.norm(left) > 1e-4 * np.linalg.norm(force)


@pytest.mark.parametrize(
    ("name", "severity"), [("stribeck", 1.0), ("load-friction", 5.0), ("payload", 2.0), ("hum", 0.5)]
)
def test_hidden_effects_have_the_severity_asked_for(name, severity):
    joint = None if name in WHOLE_ROBOT else 1
    case = Case("vs060", (Hidden(name, joint, severity),), 4, changed=name in CHANGES)
    maker = Maker(case)
    scenes = [maker.scene(maker.paths(k)) for k in range(3)]
    noise = case.noise * np.sqrt(np.mean(np.concatenate([s.known for s in scenes]) ** 2, axis=0))
    strength = maker.strength(case.hidden[0], scenes, noise)
    forces = [maker.effect(case.hidden[0], s, strength)[0] for s in scenes]
    joints = range(maker.robot.n) if joint is None else [joint]
    assert max(maker.unmodelled(scenes, forces, j) / noise[j] for j in joints) == pytest.approx(severity, rel=0.03)


def test_play_whose_link_flies_and_knocks_is_named(tmp_path):
    made = make(Case("vs060", (Hidden("backlash", 2, 2.0),), 1, style="short"))
    found = find_gap(baseline_model(made.robot, made.train), made.train, made.test)
    (play,) = found.findings
    assert (play.effect, play.joints) == ("backlash", (2,))
    effect = play.terms[0].effect
    assert isinstance(effect, Backlash)
    assert effect.flies
    assert play.parameters["gap"] == pytest.approx(made.parameters[0]["gap"], rel=0.2)
    assert found.evidence is not None
    # The joint that carries it feels it, too.
    assert np.all(found.evidence.after[1:3] < 0.85 * found.evidence.before[1:3])
    save_model(found.model, tmp_path)
    (test,) = made.test
    np.testing.assert_allclose(load_model(tmp_path, made.robot).predict(test), found.model.predict(test), atol=1e-9)


def test_same_seed_same_logs():
    case = Case("vs060", (Hidden("stribeck", 1, 1.0),), 5)
    one, two = make(case), make(case)
    other = make(Case("vs060", (Hidden("stribeck", 1, 1.0),), 6))
    np.testing.assert_array_equal(one.train[0].current, two.train[0].current)
    assert one.parameters == two.parameters
    assert not np.array_equal(one.train[0].q, other.train[0].q)


def test_suites_hold_every_effect_and_no_name_twice():
    full = tasks(SUITES["full"], 1)
    names = [task.name for task in full]
    assert len(set(names)) == len(names)
    for kind, effects in (("single", set(LAWS) - set(CHANGES)), ("changed", set(CHANGES)), ("foreign", set(FOREIGN))):
        of = [t for t in full if t.kind == kind]
        assert {t.case.hidden[0].effect for t in of} == effects
        assert {t.case.hidden[0].severity for t in of} == {0.5, 1.0, 2.0, 5.0}
    assert {t.case.robot for t in full} == {"vs060", "ur10", "panda", "xarm7"}
    assert {t.case.changed for t in full if t.kind == "nothing"} == {True, False}
    assert all(h.joint is None or h.joint < robot_of(t.case.robot).n for t in full for h in t.case.hidden)
    assert tasks(SUITES["full"], 1, ("nothing",)) == [t for t in full if t.kind == "nothing"]
    assert {t.case.seed for t in full}.isdisjoint({t.case.seed for t in tasks(SUITES["full"], 2)})


def test_cases_are_chosen_by_set_by_effect_or_by_both():
    listed = tasks(Sizes(1, (1.0,), 1, 1, ("vs060",)), 1, ("single", "nothing", "tie"))

    def kinds(*only):
        return sorted((task.kind, *(h.effect for h in task.case.hidden)) for task in bench._chosen(listed, only))

    assert kinds("nothing") == [("nothing",)]
    assert kinds("stribeck") == [("single", "stribeck"), ("tie", "stribeck")]
    assert kinds("tie-stribeck", "nothing") == [("nothing",), ("tie", "stribeck")]
    with pytest.raises(InputError, match="no case of pair-stribeck"):
        kinds("pair-stribeck")


def test_no_measured_logs_no_such_cases(tmp_path):
    assert measured_tasks(None, 1) == []
    assert measured_tasks(tmp_path, 1) == []


@pytest.fixture
def regression():
    """A joint's candidates, of which the fourth and, less, the second are in the target."""
    rng = np.random.default_rng(0)
    matrix = rng.standard_normal((2000, 6))
    target = 2.0 * matrix[:, 3] - matrix[:, 1] + 0.3 * rng.standard_normal(2000)
    problem = JointProblem(np.ones((2000, 1)), target, np.arange(2000) % 4, np.ones(2000, dtype=bool))
    candidates = [SimpleNamespace(columns=matrix[:, k : k + 1]) for k in range(6)]
    scaled = problem.away(matrix)
    scaled /= np.linalg.norm(scaled, axis=0)
    return SimpleNamespace(problem=problem, candidates=candidates, matrix=scaled, owner=list(range(6)))


def test_rivals_choose_what_is_there(regression):
    assert best_mae(regression)[:2] == [3, 1]
    assert stepwise_bic(regression) == [3, 1]
    pytest.importorskip("pysindy")
    assert frols(regression)[:2] == [3, 1]
    assert sparse_regression(regression) == [3, 1]


def test_frols_takes_a_column_that_says_the_same_once(regression):
    pytest.importorskip("pysindy")
    twice = np.hstack([regression.matrix, regression.matrix[:, 3:4]])
    again = SimpleNamespace(**vars(regression) | {"matrix": twice, "owner": [*regression.owner, 6]})
    assert frols(again)[:2] == [3, 1]


def test_rivals_report_a_cause_of_the_whole_robot_once():
    names = [Name("delay", (0,)), Name("stribeck", (1,)), Name("delay", (2,))]
    assert _merged(names) == [Name("delay", ()), Name("stribeck", (1,))]
    assert _merged(names[:2]) == names[:2]


def test_a_killed_run_goes_on(tmp_path, monkeypatch):
    listed = tasks(Sizes(1, (2.0,), 0, 2, ("vs060",)), 1, ("nothing",))
    asked = []

    def work(task, methods, known=None):
        asked.append(task.name)
        answer = None if len(asked) == 1 else Answer((), (), (1.0,), (1.0,)).to_dict()
        truth = {"name": task.name, "robot": "vs060", "kind": task.kind, "secrets": [], "noise": [1.0], "known": [1.0]}
        return {
            "name": task.name, "truth": truth | {"exact_noise": True}, "answers": {WORKFLOW: answer},
            "errors": {} if answer else {WORKFLOW: "broke"},
        }  # fmt: skip

    monkeypatch.setattr(bench, "work", work)
    bench.run(listed, [WORKFLOW], tmp_path)
    (tmp_path / f"{listed[1].name}.part").write_text("half a file")
    records = bench.run(listed, [WORKFLOW], tmp_path)
    assert asked == [
        listed[0].name,
        listed[1].name,
        listed[0].name,
    ]  # what broke down is asked again, what did not is not
    assert len(records) == 2
    assert truth_from(json.loads((tmp_path / f"{listed[0].name}.json").read_text())["truth"]).kind == "nothing"


def test_a_tilted_base_shows_on_the_upright_joint_alone():
    """Links fitted to that joint's row cannot say what a tilt does to it: its angles come from the URDF's."""
    tilted = Case("ur10", (Hidden("base-tilt", None, 1.5),), 11, style="short")
    said = judged(work(Task("single", tilted), (WORKFLOW,)), WORKFLOW)
    assert [name.effect for name in said.findings] == ["base-tilt"]
    (secret,) = said.truth.secrets
    for angle in ("roll", "pitch"):
        assert said.first.parameters[angle] == pytest.approx(secret.parameters[angle], rel=0.15)


def test_page_and_plots_of_records(tmp_path):
    hidden = {"effect": "stribeck", "joints": [1], "severity": 2.0, "parameters": {"force": 2.0}}
    truth = {
        "name": "a",
        "robot": "vs060",
        "kind": "single",
        "noise": [1.0, 1.0],
        "known": [1.0, 1.0],
        "exact_noise": True,
    }
    truth["secrets"] = [hidden]
    good = Answer((right(),), (), (2.0, 2.0), (1.0, 1.0), 3.0).to_dict()
    records = [
        {"name": "a", "truth": truth, "answers": {WORKFLOW: good, "stepwise BIC": None}, "errors": {}},
        {"name": "b", "truth": None, "answers": {}, "errors": {"case": "no"}},
    ]
    found = results(records, [WORKFLOW, "stepwise BIC"])
    found["provenance"] = {"command_line": "python -m x", "date": "today"}
    text = page(found)
    assert "| first name right | >= 95 % | 100.0 % (20.7 to 100.0; 1) | 0.0 % (0.0 to 79.3; 1) |" in text
    assert "Not made, and in no figure: b." in text
    assert "stepwise BIC broke down, which counts as wrong, on: a." in text
    assert all(path.read_text().startswith("<?xml") for path in plots(found, tmp_path))


def test_cases_whose_logs_do_not_tell_rivals_apart_count_in_the_first_table_alone():
    def record(name, margin):
        secret = Secret("stribeck", (1,), 2.0, {"force": 2.0}, margin)
        truth = Truth(name, "vs060", "single", (secret,), (1.0, 1.0), (1.0, 1.0))
        answer = Answer((right() if name == "told" else Name("sigmoid", (1,)),), (), (2.0, 2.0), (1.0, 1.0), 3.0)
        return {"name": name, "truth": asdict(truth), "answers": {WORKFLOW: answer.to_dict()}, "errors": {}}

    found = results([record("told", SURE + 1.0), record("open", SURE - 2.0)], [WORKFLOW])
    of = found["methods"][WORKFLOW]
    assert [of[which]["first name right"]["value"] for which in ("table", "identifiable")] == [0.5, 1.0]
    found["provenance"] = {"command_line": "python -m x", "date": "today"}
    assert "Not told from a rival by so much: open (0.3)." in page(found)


def test_what_is_not_there_is_said(tmp_path):
    with pytest.raises(InputError, match="no method guess"):
        bench.benchmark(out=tmp_path, methods=("guess",))
    with pytest.raises(InputError, match="no case of unknown-effect"):
        bench.benchmark(out=tmp_path, methods=(WORKFLOW,), only=("unknown-effect",))


def test_ties_are_hidden_in_logs_too_poor_to_tell_them():
    listed = tasks(Sizes(1, (2.0,), 1, 1, ("ur10",)), 3, ("tie",))
    assert {task.case.style for task in listed} == set(POOR)
    commanded = reference(robot_of("ur10"), "narrow", 10.0, 1, 100.0)
    assert np.all(np.ptp(commanded, axis=0) < 0.41)
    np.testing.assert_allclose(commanded[[0, -1]], commanded[[0, 0]], atol=1e-12)
