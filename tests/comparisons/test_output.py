"""Output directories: whole or not at all, and nothing of anybody else's touched."""

import json
from pathlib import Path

import numpy as np
import pytest

from comparisons.output import OutputDirectory, to_json
from comparisons.progress import show_progress
from ident.errors import InputError


def tree(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): p.read_text() if p.is_file() else "" for p in folder.rglob("*")}


def write(directory: Path, files: dict[str, str], command: str = "identify") -> None:
    with OutputDirectory(directory, command) as output:
        for name, content in files.items():
            (output.path / name).parent.mkdir(exist_ok=True)
            (output.path / name).write_text(content)
        output.result({"files made": len(files)})


def fail(directory: Path, error: type[BaseException]) -> None:
    with OutputDirectory(directory, "identify") as output:
        (output.path / "model.json").write_text("new")
        raise error


def test_makes_the_directory_with_its_parents(tmp_path):
    write(tmp_path / "a" / "b", {"model.json": "m", "predictions/x.parquet": "x"})
    result = json.loads((tmp_path / "a" / "b" / "result.json").read_text())
    assert result["files made"] == 2
    assert result["files"] == ["model.json", "predictions/x.parquet", "result.json"]
    assert set(tree(tmp_path / "a" / "b")) == {"model.json", "predictions", "predictions/x.parquet", "result.json"}
    assert (tmp_path / "a" / "b").stat().st_mode & 0o777 == (tmp_path / "a").stat().st_mode & 0o777


def test_a_failing_run_leaves_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fail(tmp_path / "a" / "b", ZeroDivisionError)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_a_failing_run_leaves_the_directory_as_it_was(tmp_path, error):
    write(tmp_path, {"model.json": "old", "predictions/x": "old"})
    before = tree(tmp_path)
    with pytest.raises(error):
        fail(tmp_path, error)
    assert tree(tmp_path) == before


def test_a_new_run_replaces_the_old_and_keeps_what_is_not_its_own(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    write(tmp_path, {"model.json": "old", "predictions/old": "old", "predictions/both": "old"})
    (tmp_path / "predictions" / "mine").write_text("mine")
    write(tmp_path, {"model.json": "new", "predictions/both": "new"})
    after = tree(tmp_path)
    assert after.pop("result.json")
    assert after == {
        "notes.txt": "mine",
        "model.json": "new",
        "predictions": "",
        "predictions/both": "new",
        "predictions/mine": "mine",
    }


def test_a_folder_that_falls_empty_goes_too(tmp_path):
    write(tmp_path, {"predictions/old": "old"})
    write(tmp_path, {"model.json": "new"})
    assert set(tree(tmp_path)) == {"model.json", "result.json"}


def test_another_command_leaves_the_files_of_the_first(tmp_path):
    write(tmp_path, {"model.json": "m"}, "identify")
    write(tmp_path, {"residual.parquet": "r"}, "observe")
    assert set(tree(tmp_path)) == {"model.json", "residual.parquet", "result.json"}


def test_an_edited_list_of_files_cannot_reach_outside(tmp_path):
    (tmp_path / "precious").write_text("p")
    out = tmp_path / "out"
    write(out, {"model.json": "m"})
    listed = ["../precious", str(tmp_path / "precious"), 3, None]
    (out / "result.json").write_text(json.dumps({"command": "identify", "files": listed}))
    write(out, {"model.json": "m"})
    assert (tmp_path / "precious").read_text() == "p"


def test_a_collision_at_the_end_is_undone(tmp_path):
    write(tmp_path, {"a.json": "old", "stale": "old"})
    (tmp_path / "z.json").mkdir()
    before = tree(tmp_path)
    with pytest.raises(InputError, match=r"z\.json"):
        write(tmp_path, {"a.json": "new", "z.json": "new"})
    assert tree(tmp_path) == before


def test_a_file_in_the_way_is_refused_before_any_work(tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"), OutputDirectory(tmp_path / "out", "identify"):
        pytest.fail("the block must not run")
    with pytest.raises(InputError, match="--out"), OutputDirectory(tmp_path / "out" / "deeper", "identify"):
        pytest.fail("the block must not run")


def test_json_takes_numpy_and_writes_null_for_what_json_lacks():
    result = {
        "array": np.array([[1.0, np.nan], [np.inf, 2.5]]),
        "scalar": np.float32(0.5),
        "count": np.int64(3),
        "flag": np.bool_(True),
        "empty": np.array([]),
        "nan": float("nan"),
        "tuple": (1, None, "%Use µ"),
        "path": Path("a/b"),
        1: "number as key",
    }
    text = to_json(result)
    assert json.loads(text) == {
        "array": [[1.0, None], [None, 2.5]],
        "scalar": 0.5,
        "count": 3,
        "flag": True,
        "empty": [],
        "nan": None,
        "tuple": [1, None, "%Use µ"],
        "path": "a/b",
        "1": "number as key",
    }
    assert "NaN" not in text


def test_json_refuses_what_it_would_have_to_guess():
    with pytest.raises(TypeError, match="set"):
        to_json({"a": {1, 2}})


def test_progress_is_quiet_in_a_pipe(capsys):
    with show_progress() as progress:
        progress("reading", 0.5)
        progress("reading", 1.0)
    assert capsys.readouterr() == ("", "")


def test_progress_shows_each_stage_on_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with show_progress() as progress:
        progress("reading", 0.5)
        progress("fitting", 2.0)
    out, err = capsys.readouterr()
    assert out == ""
    assert "reading" in err
    assert "fitting" in err
    assert "100 %" in err
