"""Screening of thresholds: the grid, the ranking, a run that is killed and goes on, and the same on a Dask cluster."""

import json

import numpy as np
import pytest

from comparisons.experiments import screening as experiment
from comparisons.experiments.candidates import GRID, Candidate, load_grid
from comparisons.experiments.screening import screening, workers
from comparisons.experiments.screening_page import ranked, screening_figure, screening_page
from ident.errors import InputError
from learned.motion_discriminator import TABLE_I
from learned.options import TrainingOptions

TINY = """
[[candidate]]
name = "none"
method = "mlp"

[[candidate]]
name = "play"
thresholds = [0.001, 0.003]
signal = "displacement"
"""
SMALL = {"folds": 2, "seconds": 60.0, "epochs": 1, "width": 8}


@pytest.fixture
def grid(tmp_path):
    (tmp_path / "grid.toml").write_text(TINY)
    return tmp_path / "grid.toml"


def result(**folds):
    keys = ("rmse", "rmse_static", "rmse_moving", "rmse_transition")
    candidates = {
        name: {"thresholds": [0.002], "folds": [{key: [v, v] for key in keys} for v in values]}
        for name, values in folds.items()
    }
    note = {"command_line": "x", "date": "today"}
    return {"unit": "A", "by": "rmse", "folds": [["a"], ["b"], ["c"]], "width": 8, "epochs": 1, "provenance": note,
            "candidates": candidates}  # fmt: skip


def test_built_in_grid_holds_the_papers_groups():
    thresholds = {one.thresholds for one in GRID}
    assert {*TABLE_I, sum(TABLE_I, ())} <= thresholds
    assert len({one.name for one in GRID}) == len(GRID)
    three = next(one for one in GRID if one.hierarchies == 3)
    options = three.options(TrainingOptions(width=16))
    assert (options.thresholds, options.hierarchies, options.width) == (sum(TABLE_I, ()), 3, 16)


def test_grid_from_a_file(grid):
    assert load_grid(grid) == (
        Candidate("none", method="mlp"),
        Candidate("play", (0.001, 0.003), signal="displacement"),
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no \\[\\[candidate\\]\\]"),
        ("x = [", "not valid TOML"),
        ("[[candidate]]\nthresholds = [0.1]", "name is None"),
        ("[[candidate]]\nname = 'a'\nthresholds = [-0.1]", "thresholds of 'a'"),
        ("[[candidate]]\nname = 'a'\nmethod = 'hybrid'", "method of 'a'"),
        ("[[candidate]]\nname = 'a'\nsignal = 'q'", "signal of 'a'"),
        ("[[candidate]]\nname = 'a'\nhierarchies = 0", "hierarchies of 'a'"),
        ("[[candidate]]\nname = 'a'\nwidth = 3", "unknown key 'width'"),
        ("[[candidate]]\nname = 'a'\n[[candidate]]\nname = 'a'", "two candidates"),
    ],
)
def test_mistakes_in_a_grid_are_named(text, told, tmp_path):
    (tmp_path / "g.toml").write_text(text)
    with pytest.raises(InputError, match=told):
        load_grid(tmp_path / "g.toml")


def test_candidates_are_compared_fold_by_fold():
    """Folds differ more than candidates do: a candidate worse in every fold is told apart all the same."""
    made = result(good=[1.0, 5.0, 9.0], worse=[1.5, 5.6, 9.4], level=[1.4, 4.8, 9.1])
    places = ranked(made)
    assert [place.name for place in places] == ["good", "level", "worse"]
    assert places[2].behind == pytest.approx(0.5)
    assert places[2].spread == pytest.approx(np.std([0.5, 0.6, 0.4], ddof=1) / np.sqrt(3))
    page = screening_page(made)
    assert "`good` is chosen, by all frames; not told from it by two standard errors: level." in page
    assert "| worse | 2 | 5.50 | 5.50 | 5.50 | 5.50 | 0.50 ± 0.06 |" in page
    assert [t.get_text() for t in screening_figure(made).axes[0].get_yticklabels()] == ["good", "level", "worse"]


def test_killed_run_goes_on_and_ends_the_same(grid, tmp_path, monkeypatch, capsys):
    screening(out=tmp_path / "whole", grid=grid, **SMALL)
    whole = json.loads((tmp_path / "whole" / "screening.json").read_text())
    assert capsys.readouterr().out.startswith(f"{whole['chosen']}: ")
    assert all(len(one["folds"]) == 2 for one in whole["candidates"].values())
    assert (tmp_path / "whole" / "screening.png").stat().st_size > 5000
    judged, real = [], experiment.judge

    def killed(model, logs):
        judged.append(model.method)
        if len(judged) == 3:
            raise KeyboardInterrupt
        return real(model, logs)

    monkeypatch.setattr(experiment, "judge", killed)
    with pytest.raises(KeyboardInterrupt):
        screening(out=tmp_path / "killed", grid=grid, **SMALL)
    assert not (tmp_path / "killed" / "screening.json").exists()
    models = {p: p.stat().st_mtime_ns for p in (tmp_path / "killed" / "models").glob("*/*/weights.npz")}
    assert len(models) == 3
    monkeypatch.setattr(experiment, "judge", real)
    screening(out=tmp_path / "killed", grid=grid, **SMALL)
    assert models.items() <= {p: p.stat().st_mtime_ns for p in tmp_path.glob("killed/models/*/*/weights.npz")}.items()
    assert json.loads((tmp_path / "killed" / "screening.json").read_text())["candidates"] == whole["candidates"]


def test_mistakes_of_the_call_are_named(tmp_path, grid):
    with pytest.raises(InputError, match="--folds"):
        screening(out=tmp_path, grid=grid, folds=1)
    log = experiment.recorded(experiment.load_robot("vs060"), tmp_path / "logs", 1, 20.0, 0, lambda what, share: None)
    with pytest.raises(InputError, match="1 logs for 2 folds"):
        screening(out=tmp_path, grid=grid, logs=[log[0].path], folds=2)


def test_no_scheduler_is_said_in_a_line():
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no scheduler answers"), workers("nonsense://nowhere"):
        pass


def test_a_dask_cluster_gives_the_same(grid, tmp_path):
    distributed = pytest.importorskip("distributed")
    screening(out=tmp_path / "here", grid=grid, **SMALL)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        screening(out=tmp_path / "there", grid=grid, scheduler=cluster.scheduler_address, **SMALL)
    here, there = (json.loads((tmp_path / name / "screening.json").read_text()) for name in ("here", "there"))
    assert here["candidates"] == there["candidates"]
