"""``sensorless demo``: every step, its files, its table and its report. Minutes, so run by hand."""

import json
import re

import pytest

from comparisons import cli

STEPS = ("excite", "record", "identify", "gap", "train", "compare", "comply")


@pytest.mark.slow
def test_demo_does_the_main_job(tmp_path, capsys):
    out = tmp_path / "demo"
    with pytest.raises(SystemExit) as exit_:
        cli.main(["demo", "--out", str(out)])
    assert not exit_.value.code
    lines = capsys.readouterr().out.splitlines()
    assert tuple(line.split()[0] for line in lines[:-1]) == STEPS
    assert lines[-1] == str(out / "report.html")
    result = json.loads((out / "result.json").read_text())
    assert set(result["seconds"]) == set(STEPS)
    # the hidden tool is found, weighed, and nothing else is named
    (finding,) = result["gap"]["findings"]
    assert finding["effect"] == "payload"
    assert finding["parameters"]["mass"] == pytest.approx(result["gap"]["hidden"]["mass"], rel=0.15)
    before, after = (sum(result["gap"]["rmse"][when]) for when in ("before", "after"))
    assert after < 0.75 * before
    # memory pays, in a model and in a network
    static = {name: sum(one["smoothed"]["rmse_static"]) for name, one in result["methods"].items()}
    assert max(static["physics"], static["gmo"], static["hrdl-md"]) < static["coulomb-viscous"]
    (episode,) = result["comply"]["episodes"]
    assert episode["yielded"][0] > 0.02
    assert episode["stopped_after"] < 0.5
    assert result["comply"]["untouched"]["moving_share"] == 0.0
    page = (out / "report.html").read_text()
    for title in ("In short", "Excite", "Identify", "Gap", "Train", "Compare", "Comply", "How this was made"):
        assert f"<h2>{title}</h2>" in page
    assert page.count("<svg") == 8
    assert re.findall(r'(?:src|href)="(?!#|data:)', page) == []
    # whatever the report points to is there, and nothing that the steps kept for themselves
    for name in re.findall(r"<code>([a-z]+/[a-z]+\.html)</code>", page):
        assert (out / name).is_file()
    assert sorted(p.name for p in out.iterdir() if p.is_dir()) == sorted({*STEPS, "logs"} - {"record", "comply"})
