"""``sensorless identify``: results as the contract has them, predictions row for row, bad input in one line."""

import json

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest

from comparisons import cli
from comparisons.hidden_effects.cases import Case, make
from comparisons.virtual_robot import simulate
from ident.log_writer import write_log
from ident.readers import open_log
from ident.robot import load_robot

EFFECTS = ("--effects", "coulomb", "viscous")


@pytest.fixture(scope="module")
def robot():
    return load_robot("vs060")


@pytest.fixture(scope="module")
def logs(robot, tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for name, seed in (("train", 1), ("test", 2), ("more", 3)):
        log, _ = simulate(robot, protocol="sinusoid", seconds=25.0, seed=seed)
        write_log(log, folder / f"{name}.csv")
    return folder


def call(capsys, *words):
    with pytest.raises(SystemExit) as exit_:
        cli.main(["identify", *(str(word) for word in words)])
    captured = capsys.readouterr()
    return int(exit_.value.code or 0), captured.out, captured.err


@pytest.fixture(scope="module")
def done(logs, tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "out"
    tests = ("--test", logs / "test.csv", logs / "more.csv")
    words = ["identify", "vs060", "--train", logs / "train.csv", *tests, "--out", out, *EFFECTS]
    with pytest.raises(SystemExit) as exit_:
        cli.main([str(word) for word in words])
    assert not exit_.value.code
    return out


def test_result_is_as_the_contract_says(done, robot):
    result = json.loads((done / "result.json").read_text())
    assert result["command"] == "identify"
    assert result["joints"] == list(robot.joints)
    assert result["unit"] == "%Use"
    assert result["condition_number"] > 1
    for part in ("train", "test"):
        assert len(result[part]["rmse"]) == len(result[part]["relative_error_percent"]) == 6
        assert result[part]["skipped"] == 0
    for parameter in result["parameters"]:
        assert {"name", "value", "std", "unit"} <= set(parameter)
        low, high = parameter["interval"]
        if parameter["std"] is not None:
            assert low <= parameter["value"] <= high
    names = [parameter["name"] for parameter in result["parameters"]]
    assert len(names) == len(set(names))
    made = {"model.json", "report.html", "result.json", "predictions/test.parquet", "predictions/more.parquet"}
    assert set(result["files"]) == made
    assert {p.relative_to(done).as_posix() for p in done.rglob("*") if p.is_file()} == made


def test_figures_are_those_of_the_predictions_row_for_row(done, logs, robot):
    squares, power, rows = np.zeros(6), np.zeros(6), 0
    for name in ("test", "more"):
        log = open_log(logs / f"{name}.csv", robot).read()
        table = pyarrow.parquet.read_table(done / "predictions" / f"{name}.parquet")
        assert table.schema.names == ["t", *(f"i{j}" for j in range(1, 7)), *(f"p{j}" for j in range(1, 7))]
        np.testing.assert_array_equal(table["t"].to_numpy(), log.t)
        measured = np.column_stack([table[f"i{j}"].to_numpy() for j in range(1, 7)])
        predicted = np.column_stack([table[f"p{j}"].to_numpy() for j in range(1, 7)])
        np.testing.assert_array_equal(measured, log.current)
        squares += np.sum((measured - predicted) ** 2, axis=0)
        power += np.sum(measured**2, axis=0)
        rows += len(measured)
    test = json.loads((done / "result.json").read_text())["test"]
    assert test["rows"] == rows
    np.testing.assert_allclose(test["rmse"], np.sqrt(squares / rows), rtol=1e-12)
    np.testing.assert_allclose(test["relative_error_percent"], 100 * np.sqrt(squares / power), rtol=1e-12)
    assert np.all(squares < 0.3 * power)


def test_rows_that_cannot_be_predicted_are_counted(capsys, logs, robot, tmp_path):
    log = open_log(logs / "test.csv", robot).read()
    segment = np.zeros(len(log), dtype=np.int64)
    segment[-4:] = 1  # too short to derive velocity from
    write_log(log.replace(segment=segment), tmp_path / "cut.parquet")
    words = ("--train", logs / "train.csv", "--test", tmp_path / "cut.parquet", "--out", tmp_path / "out", *EFFECTS)
    assert call(capsys, "vs060", *words)[0] == 0
    assert json.loads((tmp_path / "out" / "result.json").read_text())["test"]["skipped"] == 4
    table = pyarrow.parquet.read_table(tmp_path / "out" / "predictions" / "cut.parquet")
    assert len(table) == len(log)
    assert np.isnan(table["p3"].to_numpy()[-4:]).all()


def test_report_is_one_page_that_says_what_there_is(done):
    page = (done / "report.html").read_text()
    assert 'src="http' not in page
    for text in ("Condition number", "What these logs leave open", "coulomb.3.force", "Measured and predicted"):
        assert text in page


def test_warnings_name_the_joint(capsys, logs, robot, tmp_path):
    log = open_log(logs / "train.csv", robot).read()
    flipped = log.current * np.where(np.arange(6) == 2, -1.0, 1.0)
    write_log(log.replace(current=flipped), tmp_path / "flipped.csv")
    status, out, err = call(capsys, "vs060", "--train", tmp_path / "flipped.csv", "--out", tmp_path / "out", *EFFECTS)
    assert (status, err) == (0, "")
    assert "warning: Joint 3 (joint_3)" in out
    assert "flipped" in (tmp_path / "out" / "report.html").read_text()
    assert not (tmp_path / "out" / "predictions").exists()


def cut_row(rows):
    rows[7] = rows[7].rsplit(",", 3)[0]


def no_number(rows):
    rows[9] = rows[9].replace(rows[9].split(",")[4], "nan")


def repeated(rows):
    rows[12] = rows[11]


def backward(rows):
    rows[12], rows[13] = rows[13], rows[12]


def degrees(rows):
    for k in range(1, len(rows)):
        cells = rows[k].split(",")
        cells[1:7] = [str(np.rad2deg(float(cell))) for cell in cells[1:7]]
        rows[k] = ",".join(cells)


def five_joints(rows):
    for k, row in enumerate(rows):
        cells = row.split(",")
        rows[k] = ",".join(cells[:6] + cells[7:12])


def short(rows):
    del rows[8:]


def empty(rows):
    del rows[1:]


SPOILT = [
    (cut_row, "row 7"),
    (no_number, "row 9"),
    (repeated, "is repeated"),
    (backward, "goes backward"),
    (degrees, "looks like degrees"),
    (five_joints, "missing columns"),
    (empty, "no rows"),
]


@pytest.mark.parametrize(
    ("where", "spoil", "text"),
    # A short test log is predicted as far as it can be.
    [("--train", short, "too short"), *((where, *case) for where in ("--train", "--test") for case in SPOILT)],
)
def test_bad_logs_are_refused_in_one_line_and_leave_earlier_results(capsys, logs, tmp_path, where, spoil, text):
    rows = (logs / "train.csv").read_text().splitlines()
    spoil(rows)
    (tmp_path / "bad.csv").write_text("\n".join(rows) + "\n")
    out = tmp_path / "out"
    out.mkdir()
    (out / "result.json").write_text('{"command": "identify", "files": ["result.json"]}')
    good = "--test" if where == "--train" else "--train"
    words = (where, tmp_path / "bad.csv", good, logs / "more.csv", "--out", out, *EFFECTS)
    refused(call(capsys, "vs060", *words), text)
    assert [p.name for p in out.iterdir()] == ["result.json"]
    assert json.loads((out / "result.json").read_text())["files"] == ["result.json"]


def refused(answer, text):
    status, _, err = answer
    assert status == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert text in err


FLOATING = """<robot name="r"><link name="w"/><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="floating"><parent link="w"/><child link="a"/></joint></robot>"""


@pytest.mark.parametrize(
    ("urdf", "text"),
    [("<robot", "arm.urdf"), ("not xml", "arm.urdf"), (FLOATING, "floating"), (None, "arm.urdf")],
    ids=["cut off", "no xml", "floating base", "missing"],
)
def test_robots_that_cannot_be_read_are_refused(capsys, logs, tmp_path, urdf, text):
    if urdf is not None:
        (tmp_path / "arm.urdf").write_text(urdf)
    (tmp_path / "robot.toml").write_text('name = "r"\nurdf = "arm.urdf"\n')
    refused(call(capsys, tmp_path / "robot.toml", "--train", logs / "train.csv", "--out", tmp_path / "out"), text)
    assert not (tmp_path / "out").exists()


def test_a_log_of_another_robot_is_refused(capsys, logs, tmp_path, urdf_path):
    joints = [f"panda_joint{k}" for k in range(1, 8)]
    card = f'name = "panda"\nurdf = "{urdf_path("panda")}"\njoints = {json.dumps(joints)}\n'
    (tmp_path / "robot.toml").write_text(card)
    answer = call(capsys, tmp_path / "robot.toml", "--train", logs / "train.csv", "--out", tmp_path / "out")
    refused(answer, "missing columns q7")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--effects", "coulom"), "no effect is named 'coulom'"),
        (("--gains", "known"), "the drive gains are not known"),
        (("--gains", "guessed"), "gains"),
        (("--cutoff", "70"), "cut-off of 70 Hz"),
        (("--payload-mass", "2"), "go together"),
        (("--test",), "no logs"),
    ],
)
def test_wrong_calls_are_refused(capsys, logs, tmp_path, words, text):
    refused(call(capsys, "vs060", "--train", logs / "train.csv", "--out", tmp_path / "out", *words), text)
    assert not (tmp_path / "out").exists()


def test_two_test_logs_of_one_name_are_refused(capsys, logs, tmp_path):
    (tmp_path / "test.csv").write_text((logs / "test.csv").read_text())
    words = ("--train", logs / "train.csv", "--test", logs / "test.csv", tmp_path / "test.csv")
    refused(call(capsys, "vs060", *words, "--out", tmp_path / "out", *EFFECTS), "two test logs are named test")


def identified(capsys, folder, style, *words):
    """A case in which nothing is hidden, and the result and report of its identification."""
    made, out = make(Case("vs060", (), 84, style=style)), folder / "out"
    for log in (*made.train, *made.test):
        write_log(log, folder / f"{log.name}.csv")
    train = [folder / f"{log.name}.csv" for log in made.train]
    test = ("--test", folder / f"{made.test[0].name}.csv")
    assert call(capsys, "vs060", "--train", *train, *test, "--out", out, *words)[0] == 0
    return made, json.loads((out / "result.json").read_text()), (out / "report.html").read_text()


def test_what_friction_holds_at_rest_is_left_out_and_said(capsys, tmp_path):
    made, result, report = identified(capsys, tmp_path, "sticks", *EFFECTS)
    assert result["rests_left_out"] == [1, 2, 3, 4, 5, 6]
    for part in ("train", "test"):
        np.testing.assert_allclose(result[part]["rmse_moving"], made.noise, rtol=0.1)
        assert np.all(np.array(result[part]["rmse"]) > 1.5 * made.noise)
    assert "Joints that stick: 1, 2, 3, 4, 5, 6." in report
    assert result["presliding"] == [0.0] * 6


def test_friction_that_yields_is_modelled_and_said(capsys, tmp_path):
    made, result, report = identified(capsys, tmp_path, "yields")
    assert np.all((np.array(result["presliding"]) > 1e-5) & (np.array(result["presliding"]) < 5e-4))
    assert np.all(result["test"]["rmse"] < 1.8 * made.noise)  # 1.6 to 4.5 times it with one exponent
    assert "Joints that yield before they slip" in report


def test_a_test_log_that_goes_further_than_the_train_log_is_said(capsys, robot, logs, tmp_path):
    log = open_log(logs / "train.csv", robot).read()
    write_log(log.replace(q=log.q * np.array([1.0, 0.3, 1.0, 1.0, 1.0, 1.0])), tmp_path / "near.csv")
    words = ("--train", tmp_path / "near.csv", "--test", logs / "test.csv", "--out", tmp_path / "out", *EFFECTS)
    status, out, _ = call(capsys, "vs060", *words)
    assert status == 0
    assert "so that the model extrapolates: joint" in out
    assert "joint 2 (joint_2) beyond" in out
    assert json.loads((tmp_path / "out" / "result.json").read_text())["warnings"] != []
    assert "joint 2 (joint_2) beyond" in (tmp_path / "out" / "report.html").read_text()
