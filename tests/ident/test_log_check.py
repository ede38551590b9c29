import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ident.errors import InputError
from ident.log import JointLog
from ident.log_check import LogChecker, check
from ident.readers import open_log
from ident.robot import load_robot

ROBOT = load_robot("vs060")
N = ROBOT.n


def motion(rows=60, rate=100.0):
    t = np.arange(rows) / rate
    q = 0.3 * np.sin(2 * t[:, None] + np.arange(N))
    return JointLog(t, q, 5.0 * np.cos(t[:, None] + np.arange(N)))


def refusal(log):
    with pytest.raises(InputError) as caught:
        check(log, ROBOT, "some.csv")
    return caught.value


def changed(log, key, row, value):
    array = np.array(getattr(log, key))
    array[row] = value
    return log.replace(**{key: array})


def test_a_good_log_passes_unchanged():
    log = motion()
    assert check(log, ROBOT, "some.csv") is log


def test_a_joint_that_moves_in_few_rows_has_no_spikes():
    log = motion(2000)
    current = np.full(log.current.shape, 1e-4)
    current[1000:1020, 1] = 3.0
    assert check(log.replace(current=current), ROBOT, "some.csv") is not None


@pytest.mark.parametrize(
    ("key", "row", "value", "what", "where"),
    [
        ("q", (3, 1), np.nan, "q2 is empty or NaN", "row 4"),
        ("current", (0, 5), np.inf, "i6 is infinite", "row 1"),
        ("t", 9, np.nan, "t is empty or NaN", "row 10"),
        ("t", 9, 0.08, "t = 0.08 s is repeated", "row 10"),
        ("t", 9, 0.075, "t = 0.075 s goes backward by 0.005 s", "row 10"),
        ("q", (7, 0), 40.0, "q1 = 40 looks like degrees", "row 8"),
        ("q", (7, 0), -3.6, "q1 = -3.6 rad is outside the limits", "row 8"),
        ("current", (9, 1), 1e9, "i2 = 1e+09 is ", "row 10"),
    ],
)
def test_one_bad_value_is_named_with_its_row(key, row, value, what, where):
    error = refusal(changed(motion(), key, row, value))
    assert error.what.startswith(what)
    assert error.where == f"some.csv {where}"


def test_stamps_may_begin_anew_in_another_segment():
    log = motion()
    t = np.concatenate([log.t[:30], log.t[:30]])
    check(log.replace(t=t, segment=np.repeat([0, 1], 30)), ROBOT, "some.csv")
    assert "goes backward" in refusal(log.replace(t=t)).what


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e-4])
def test_time_in_other_units_is_refused(factor):
    log = motion()
    error = refusal(log.replace(t=log.t * factor))
    assert "does not look like seconds" in error.what
    assert "scale time" in error.how


def test_time_ten_times_too_fast_shows_in_the_speed():
    log = motion(200)
    error = refusal(log.replace(t=log.t * 0.03))
    assert "times its limit" in error.what
    assert "unit of t" in error.how


def test_velocity_in_degrees_is_refused():
    log = motion(200)
    assert "scale velocity" in refusal(log.replace(dq=np.full(log.q.shape, 30.0))).how


def test_whole_log_in_degrees_is_refused_as_such():
    error = refusal(motion().replace(q=np.rad2deg(motion().q)))
    assert "looks like degrees" in error.what
    assert "0.0174533" in error.how


def test_wrong_joint_order_is_refused_where_limits_show_it():
    log = motion()
    q = np.array(log.q)
    q[:, 5] = 5.5 * np.sin(2.5 * log.t)  # joint 6 turns past what joint 1 can
    swapped = log.replace(q=q[:, ::-1])
    error = refusal(swapped)
    assert "joint 1" in error.what
    assert "order of the joints" in error.how


def test_real_robots_overrun_their_limits_a_little():
    log = motion()
    check(changed(log, "q", (5, 0), ROBOT.limits.upper[0] + 0.15), ROBOT, "some.csv")


@pytest.fixture(scope="module")
def ur3(urdf_path, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ur3")
    mapping = '[log]\ntime = "mt"\nposition = "mq"\ncurrent = "mtorque"\n'
    (folder / "robot.toml").write_text(f'name = "ur3"\nurdf = "{urdf_path("ur3")}"\n{mapping}')
    return load_robot(folder / "robot.toml")  # all its limits are a turn to either side


def test_joints_that_turn_freely_may_pass_their_limits(ur3):
    log = motion()
    for joint in (0, 5):
        check(changed(log, "q", slice(None), log.q - 15.8 * (np.arange(N) == joint)), ur3, "some.csv")
    assert ROBOT.limits.upper[0] - ROBOT.limits.lower[0] < 2 * np.pi - 0.1
    assert "outside the limits" in refusal(changed(log, "q", (7, 0), -3.6)).what


def test_measured_wrist_that_turned_two_and_a_half_times(ur3, measured):
    log = open_log(measured("ur3_aspectum/id2.mat"), ur3).read()
    assert log.q[:, 5].min() < -15.5


@pytest.mark.parametrize(("offset", "size"), [(90.0, 1.0), (0.0, 20.0), (12.0, 1.0)])
def test_degrees_are_refused_where_joints_turn_freely(ur3, offset, size):
    log = motion()
    q = offset + size * np.sin(2 * log.t[:, None] + np.arange(N))
    with pytest.raises(InputError) as caught:
        check(log.replace(q=q), ur3, "some.csv")
    assert "looks like degrees" in caught.value.what


def test_slow_degrees_of_one_joint_show_in_the_speed(ur3):
    log = motion(200)
    q = np.array(log.q)
    q[:, 5] = np.rad2deg(q[:, 5])
    with pytest.raises(InputError, match="times its limit"):
        check(log.replace(q=q), ur3, "some.csv")


@pytest.mark.parametrize("n", [N - 1, N + 1])
def test_wrong_number_of_joints(n):
    log = motion()
    q = np.zeros((len(log), n))
    assert f"{n} joints where vs060 has {N}" in refusal(log.replace(q=q, current=q)).what


def test_an_empty_log_is_refused():
    assert refusal(motion()[:0]).what == "no rows"


def test_segment_numbers_are_whole():
    log = motion()
    assert check(log.replace(segment=np.zeros(60)), ROBOT, "some.csv").segment.dtype == np.int64
    error = refusal(log.replace(segment=np.linspace(0, 1, 60)))
    assert "not a whole number" in error.what
    assert error.where.endswith("row 2")


@pytest.mark.parametrize("size", [1, 7, 30])
@pytest.mark.parametrize(("row", "value"), [(29, 0.28), (30, 0.29), (31, 0.1), (45, np.nan)])
def test_pieces_are_refused_as_the_whole_is(size, row, value):
    log = changed(motion(), "t", row, value)
    whole = refusal(log)
    checker = LogChecker(ROBOT, "some.csv")

    def walk():
        for start in range(0, len(log), size):
            checker.check(log[start : start + size])

    with pytest.raises(InputError) as caught:
        walk()
    assert str(caught.value) == str(whole)


GOOD = motion(40)
HEADER = ["t", *(f"q{j + 1}" for j in range(N)), *(f"i{j + 1}" for j in range(N))]
CELLS = [[repr(float(x)) for x in (GOOD.t[k], *GOOD.q[k], *GOOD.current[k])] for k in range(len(GOOD))]
fast = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def read(tmp_path, rows, header=HEADER):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")
    return open_log(path, ROBOT).read()


def refused_csv(tmp_path, rows, header=HEADER):
    with pytest.raises(InputError) as caught:
        read(tmp_path, rows, header)
    assert "\n" not in str(caught.value)
    assert "log.csv" in caught.value.where
    return caught.value


def test_the_good_csv_is_good(tmp_path):
    assert np.array_equal(read(tmp_path, CELLS).q, GOOD.q)


@fast
@given(
    row=st.integers(0, 39),
    column=st.integers(0, 2 * N),
    bad=st.sampled_from(["", "nan", "inf", "-inf", "abc", "1.2.3", "1,5", "0x1f", "--", "1_000", "1e999", "é"]),
)
def test_a_bad_cell_is_named_with_its_row(tmp_path, row, column, bad):
    rows = [list(cells) for cells in CELLS]
    rows[row][column] = bad
    error = refused_csv(tmp_path, rows)
    assert error.where.endswith(f"log.csv row {row + 1}")
    if "," not in bad:
        assert error.what.startswith(HEADER[column])


@fast
@given(row=st.integers(0, 39), keep=st.integers(1, 2 * N))
def test_a_row_cut_off_is_named(tmp_path, row, keep):
    rows = [list(cells) for cells in CELLS]
    rows[row] = rows[row][:keep]
    error = refused_csv(tmp_path, rows)
    assert error.where.endswith(f"row {row + 1}")
    assert error.what == f"{keep} values where the header names {2 * N + 1} columns"


@fast
@given(row=st.integers(1, 39), back=st.integers(0, 39))
def test_stamps_that_do_not_increase_are_named(tmp_path, row, back):
    rows = [list(cells) for cells in CELLS]
    back = back % row
    rows[row][0] = rows[back][0]
    error = refused_csv(tmp_path, rows)
    assert error.where.endswith(f"row {row + 1}")
    assert ("repeated" in error.what) == (back == row - 1)


@fast
@given(st.sets(st.integers(0, 2 * N), min_size=1, max_size=2 * N))
def test_missing_columns_are_all_listed(tmp_path, gone):
    kept = [k for k in range(len(HEADER)) if k not in gone]
    error = refused_csv(tmp_path, [[row[k] for k in kept] for row in CELLS], [HEADER[k] for k in kept])
    assert error.what == f"missing columns {', '.join(HEADER[k] for k in sorted(gone))}"


def test_columns_of_another_robot(tmp_path):
    more = ["q7", "i7"]
    error = refused_csv(tmp_path, [[*row, "0", "0"] for row in CELLS], [*HEADER, *more])
    assert "q7 belongs to more joints" in error.what


@pytest.mark.parametrize(
    ("header", "rows", "what"),
    [
        (HEADER, [], "no rows"),
        (CELLS[0], CELLS[1:], "no header"),
        ([*HEADER[:-1], "q1"], CELLS, "column q1 appears twice"),
    ],
)
def test_headers_that_are_wrong(tmp_path, header, rows, what):
    assert what in refused_csv(tmp_path, rows, header).what


def test_a_bad_row_far_down_a_long_file_is_named(tmp_path):
    rows = [[f"{k / 100:.2f}", *CELLS[0][1:]] for k in range(60_000)]
    rows[54_321][3] = "oops"
    error = refused_csv(tmp_path, rows)
    assert error.where.endswith("row 54322")
    assert error.what == "q3 = 'oops' is not a number"


@fast
@given(st.binary(max_size=300), st.integers(0, 3))
def test_no_bytes_break_the_reader(tmp_path, junk, lines):
    good = "\n".join(",".join(row) for row in [HEADER, *CELLS[:lines]]) + "\n" if lines else ""
    path = tmp_path / "log.csv"
    path.write_bytes(good.encode() + junk)
    try:
        outcome = f"{len(open_log(path, ROBOT).read())} rows"
    except InputError as error:
        outcome = str(error)
    assert outcome != "0 rows"
    assert "\n" not in outcome
