import numpy as np
import pyarrow.parquet
import pytest

from ident.convert import convert
from ident.errors import InputError
from ident.log import JointLog
from ident.log_writer import LogWriter, write_log
from ident.readers import open_log
from ident.robot import load_robot

ROBOT = load_robot("vs060")
N = ROBOT.n


def motion(rows=500, start=0.0):
    t = start + np.arange(rows) / 100
    q = 0.3 * np.sin(2 * t[:, None] + np.arange(N))
    return JointLog(t, q, 5.0 * np.cos(t[:, None] + np.arange(N)), segment=np.arange(rows) // 200)


def left(tmp_path):
    return sorted(path.name for path in tmp_path.iterdir())


@pytest.mark.parametrize("source", ["a.csv", "a.parquet"])
@pytest.mark.parametrize("target", ["b.csv", "b.parquet"])
def test_conversion_loses_nothing(tmp_path, source, target):
    log = motion()
    write_log(log, tmp_path / source)
    assert convert(ROBOT, tmp_path / source, tmp_path / target) == 500
    back = open_log(tmp_path / target, ROBOT).read()
    for key in ("t", "q", "current", "segment"):
        assert np.array_equal(getattr(back, key), getattr(log, key))
    assert left(tmp_path) == [source, target]


@pytest.mark.parametrize(
    ("start", "stop", "first", "rows"),
    [(None, None, 7.0, 500), (1.5, None, 8.5, 350), (None, 1.5, 7.0, 150), (1.5, 3.0, 8.5, 150), (4.99, 9.0, 11.99, 1)],
)
def test_cut_counts_from_the_first_sample(tmp_path, start, stop, first, rows):
    write_log(motion(start=7.0), tmp_path / "a.csv")
    assert convert(ROBOT, tmp_path / "a.csv", tmp_path / "b.csv", start, stop) == rows
    back = open_log(tmp_path / "b.csv", ROBOT).read()
    assert len(back) == rows
    assert back.t[0] == pytest.approx(first, abs=0.0051)


@pytest.mark.parametrize(("start", "stop"), [(100.0, None), (2.0, 1.0), (None, -1.0)])
def test_an_empty_cut_is_refused_and_writes_nothing(tmp_path, start, stop):
    write_log(motion(), tmp_path / "a.csv")
    with pytest.raises(InputError, match="no sample from"):
        convert(ROBOT, tmp_path / "a.csv", tmp_path / "b.csv", start, stop)
    assert left(tmp_path) == ["a.csv"]


@pytest.mark.parametrize("target", ["b.csv", "b.parquet"])
def test_a_log_that_breaks_midway_leaves_what_was_there(tmp_path, target):
    write_log(motion(80_000).replace(segment=np.zeros(80_000, dtype=np.int64)), tmp_path / "a.csv")
    with (tmp_path / "a.csv").open("a") as file:
        file.write("800.0,oops\n")
    (tmp_path / target).write_text("as before")
    with pytest.raises(InputError, match="row 80001"):
        convert(ROBOT, tmp_path / "a.csv", tmp_path / target)
    assert (tmp_path / target).read_text() == "as before"
    assert left(tmp_path) == ["a.csv", target]


def test_targets_that_cannot_be_are_refused(tmp_path):
    write_log(motion(), tmp_path / "a.csv")
    for target, words in (("a.csv", "same file"), ("b.bag", "not written as .bag"), ("none/b.csv", "no such folder")):
        with pytest.raises(InputError, match=words):
            convert(ROBOT, tmp_path / "a.csv", tmp_path / target)
    assert left(tmp_path) == ["a.csv"]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_blocks_written_one_by_one_are_one_log(tmp_path, suffix):
    log = motion(1000)
    with LogWriter(tmp_path / f"a{suffix}") as writer:
        for block in log.blocks(64):
            writer.write(block)
            assert not (tmp_path / f"a{suffix}").exists()
    assert np.array_equal(open_log(tmp_path / f"a{suffix}", ROBOT).read().q, log.q)


def test_many_small_blocks_make_few_row_groups(tmp_path):
    with LogWriter(tmp_path / "a.parquet") as writer:
        for block in motion(70_000).blocks(100):
            writer.write(block)
    assert pyarrow.parquet.ParquetFile(tmp_path / "a.parquet").num_row_groups == 2


def test_blocks_with_other_columns_are_refused(tmp_path):
    log = motion()
    writer = LogWriter(tmp_path / "a.csv")

    def write_both():
        with writer:
            writer.write(log)
            writer.write(log.replace(dq=log.q))

    with pytest.raises(InputError, match="same columns"):
        write_both()
    assert left(tmp_path) == []


def test_an_error_of_the_caller_leaves_nothing(tmp_path):
    writer = LogWriter(tmp_path / "a.parquet")

    def fail():
        with writer:
            writer.write(motion(70_000))
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert left(tmp_path) == []
