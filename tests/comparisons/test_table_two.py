"""The experiments behind the paper's Tables II and III: their pages and their data."""

import json

import numpy as np
import pytest

from comparisons.comparison.methods import training_options
from comparisons.comparison.run import summary
from comparisons.experiments.data import paper_data
from comparisons.experiments.table_three import deadzones, table_three, table_three_page
from comparisons.experiments.table_two_page import CLAIMS, PAPER, REGIMES, table_two_page
from comparisons.protocols import dataset
from comparisons.virtual_robot import VirtualRobot
from ident.errors import InputError
from ident.robot import load_robot


def run(level, joints=6):
    """Figures of one training whose errors are ``level`` on every joint."""
    figures = {key: np.full(joints, level) for key in REGIMES}
    return figures | {"step_us_p50": 10.0, "step_us_p99": 20.0, "parameters": 5, "training_seconds": 3.0}


@pytest.fixture
def result():
    levels = {"model-based, from sinusoids": [9.0], "RDL": [5.0, 6.0, 7.0], "RDL-MD": [4.0, 6.5, 5.0]}
    rows = {row: summary({str(k): run(v) for k, v in enumerate(of)}) for row, of in levels.items()}
    note = {"command_line": "python -m x", "date": "today", "versions": {"python": "3"}}
    return {
        "unit": "%Use", "rows": rows, "frames": {"train": 1000, "test": 500}, "preset": "quick", "data": "quick",
        "epochs": None, "seeds": 3, "provenance": note,
    }  # fmt: skip


def test_page_gives_means_spread_and_the_least(result):
    page = table_two_page(result)
    spread = np.std([4.0, 6.5, 5.0], ddof=1)
    assert f"| RDL-MD | {' | '.join(['**5.17**'] * 6)} | **5.17** ± {spread:.2f} |" in page
    assert f"| model-based, from sinusoids | {' | '.join(['9.00'] * 6)} | 9.00 |" in page
    assert page.count("| RDL |") == len(REGIMES) + 2  # in each regime, in the paper's table and in that of costs
    assert "1,000 training and 500 test frames" in page


def test_claims_are_counted_training_by_training(result):
    page = table_two_page(result)
    assert "| the discriminator helps at rest | static frames | RDL-MD 5.17 | RDL 6.00 | 2 of 3 |" in page
    # rows that are not there are claimed nothing of
    assert "hierarchy helps" not in page


def test_claims_and_the_papers_rows_name_rows_that_there_are():
    from comparisons.experiments.table_two import HIERARCHIES, MODELS, NETWORKS

    rows = {*MODELS, *(set(NETWORKS) - {"HRDL-MD"}), *HIERARCHIES}
    assert set(PAPER) <= rows
    assert {row for _, _, *pair in CLAIMS for row in pair} <= rows
    assert {key for _, key, *_ in CLAIMS} <= set(REGIMES)


def tiny_preset(monkeypatch, frames):
    """Make a preset of a few frames a set, ``tiny``."""
    tiny = {name: (kind, {"frames": frames}) for name, (kind, _) in dataset.PRESETS["quick"].items()}
    monkeypatch.setitem(dataset.PRESETS, "tiny", tiny)
    monkeypatch.setattr("comparisons.experiments.data.EXCITATION", 3.0)


def test_data_are_recorded_once_and_anew_for_another_seed(tmp_path, monkeypatch):
    tiny_preset(monkeypatch, 300)
    virtual, told = VirtualRobot(load_robot("vs060")), []

    def progress(what, share):
        told.append(what)

    data = paper_data(virtual, "tiny", tmp_path / "data", 1, progress)
    assert [log.name for log in data.train] == ["continuous_000", "hysteresis_000"]
    assert [len(log.read()) for log in [*data.test, *data.excitation]] == [120, 180, 300]
    assert len(told) > 0
    told.clear()
    paper_data(virtual, "tiny", tmp_path / "data", 1, progress)
    assert told == []
    paper_data(virtual, "tiny", tmp_path / "data", 2, progress)
    assert len(told) > 0
    assert json.loads((tmp_path / "data" / "data.json").read_text()) == {"preset": "tiny", "seed": 2}


def test_deadzones_in_current_and_torque():
    figures = {"smoothed": {"peak": [6.0, 12.0, 6.0, 9.0, 11.0, 11.0]}, "detectable_current": [3.0] * 6}
    measured = {"unit": "%Use", "frames": {"test": 500}, "rows": {"RDL": figures}}
    result = deadzones(measured)
    np.testing.assert_allclose(result["rows"]["RDL"]["peak_torque"], [4.26, 9.72, 2.42, 1.01, 1.58, 0.84])
    np.testing.assert_allclose(result["rows"]["RDL"]["hourly_torque"][0], 2.13)
    page = table_three_page(result | {"provenance": {"command_line": "x", "date": "today"}})
    assert "| RDL | **6.00** | **12.00** |" in page


def test_table_three_asks_for_table_two(tmp_path):
    with pytest.raises(InputError, match=r"no table_two\.json"):
        table_three(out=tmp_path)


def test_quick_networks_see_more_data_in_larger_batches_and_the_papers_are_the_papers():
    from comparisons.experiments.table_two import network_options
    from learned.options import TrainingOptions

    quick = network_options("hybrid", "quick", None, 3, "cpu")
    own = training_options("hybrid", "quick", None, 3, "cpu")
    assert (quick.epochs, quick.batch, quick.seed, quick.width) == (4, 512, 3, own.width)
    assert quick.learning_rate / quick.batch == own.learning_rate / own.batch
    assert network_options("hybrid", "quick", 2, 3, "cpu").epochs == 2
    assert network_options("mlp", "paper", None, 0, None) == TrainingOptions()


def test_page_says_what_was_named(result):
    page = table_two_page(result | {"named": {"payload": [], "maxwell-slip": [4, 2]}})
    assert "Named effects: `payload` on the whole robot; `maxwell-slip` on joints 2, 4." in page


def test_methods_fitted_side_by_side_are_found_done(tmp_path, monkeypatch):
    from comparisons.cluster import workers
    from comparisons.experiments import table_two
    from comparisons.progress import show_nothing

    tiny_preset(monkeypatch, 4000)
    monkeypatch.setattr(table_two, "MODELS", {table_two.SLIP: table_two.MODELS[table_two.SLIP]})
    monkeypatch.setattr(table_two, "NETWORKS", {"MLP": "mlp"})
    data = paper_data(VirtualRobot(load_robot("vs060")), "tiny", tmp_path / "data", 1, show_nothing)
    rows = table_two.Rows(data, tmp_path / "models", "quick", 1, 2, "cpu", show_nothing)
    with workers(None, 1):
        rows.fit()
    done = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("fit.json")}
    assert len(done) == 3
    assert [one.name for one in rows.all()] == ["maxwell-slip", "mlp-seed0", "mlp-seed1"]
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("fit.json")} == done
