"""The time-series figure: its stretch, its marks, its rows, and a run in the small."""

import json

import numpy as np
import pytest

from comparisons.comparison.held_out import HeldOut
from comparisons.experiments.time_series import check_rows, stretch, time_series, time_series_figure
from comparisons.protocols import dataset, named
from comparisons.virtual_robot import VirtualRobot
from ident.errors import InputError
from ident.robot import load_robot


@pytest.fixture(scope="module")
def tests():
    virtual = VirtualRobot(load_robot("vs060"))
    log = virtual.record(named("stop_and_go")(virtual.robot, seconds=60.0, seed=4), 4)
    return HeldOut.of([log])


def test_stretch_is_the_busiest_or_the_one_asked_for(tests):
    marks = (tests.regimes.starts | tests.regimes.stops).sum(axis=1)
    busiest = stretch(tests, 10.0, None)
    assert busiest.stop - busiest.start == 1000
    assert marks[busiest].sum() == max(marks[k : k + 1000].sum() for k in range(len(marks) - 999))
    assert stretch(tests, 10.0, 20.0) == slice(2000, 3000)
    for seconds, begin, told in ((90.0, None, "--seconds"), (10.0, 55.0, "--begin"), (10.0, -1.0, "--begin")):
        with pytest.raises(InputError, match=told):
            stretch(tests, seconds, begin)


def test_marks_stand_where_joints_start_and_stop(tests):
    rows = stretch(tests, 20.0, None)
    log = tests.whole[rows]
    figure = time_series_figure(["a"] * 6, "%Use", log, {"RDL": log.current + 1.0}, tests.regimes, rows)
    for joint, axis in enumerate(figure.axes):
        lines = {line.get_label(): line for line in axis.lines}
        for label, marks in (("start", tests.regimes.starts), ("stop", tests.regimes.stops)):
            at = log.t[marks[rows, joint]] - log.t[0]
            np.testing.assert_allclose(lines[label].get_xdata(), at)
        assert {"measured", "RDL"} <= set(lines)


def test_rows_that_there_are_not_are_refused():
    check_rows(["RDL", "model-based, Maxwell slip", "HRDL-MD"])
    with pytest.raises(InputError, match="no row 'rdl'"):
        check_rows(["rdl"])
    with pytest.raises(InputError, match="0 methods"):
        check_rows([])


def test_run_in_the_small(tmp_path, monkeypatch, capsys):
    tiny = {name: (kind, {"frames": 3000}) for name, (kind, _) in dataset.PRESETS["quick"].items()}
    monkeypatch.setitem(dataset.PRESETS, "tiny", tiny)
    monkeypatch.setattr("comparisons.experiments.data.EXCITATION", 20.0)
    options = {"data": "tiny", "epochs": 1, "seconds": 10.0}
    time_series(out=tmp_path, methods=["HRDL-MD", "model-based, from sinusoids"], **options)
    assert capsys.readouterr().out.strip() == str(tmp_path / "time_series.png")
    result = json.loads((tmp_path / "time_series.json").read_text())
    assert list(result["rmse"]) == ["HRDL-MD", "model-based, from sinusoids"]
    assert np.all(np.isfinite(list(result["rmse"].values())))
    assert (tmp_path / "time_series.png").stat().st_size > 10_000
