"""A long study is run by no test; the one that times the gap workflow is, on a log that is short."""

import re
import runpy
from pathlib import Path

from comparisons.hidden_effects.styles import Style

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_the_gap_workflow_is_timed_beside_identification(capsys):
    script = runpy.run_path(str(BENCHMARKS / "gap_time.py"))
    script["main"](Style((("fourier", 15.0), ("slow", 15.0), ("stop_and_go", 15.0))))
    told = capsys.readouterr().out
    assert "'load-friction', [4]" in told
    assert re.search(r"^4\d s of log: \d+ s, [\d.]+ times identify", told, re.MULTILINE)
