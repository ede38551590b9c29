"""How long ``sensorless --help`` takes, beside a bare Python that imports numpy."""

import statistics
import subprocess
import sys
import time

REPEATS = 15


def seconds(code: str) -> float:
    """Median wall time of a fresh Python that runs some code."""
    times = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - begun)
    return statistics.median(times)


def test_help_beside_numpy() -> None:
    """Print the ratio, and the part of it that is no more than Python and cyclopts."""
    bare = seconds("import numpy")
    library = seconds("import cyclopts") / bare
    help_page = seconds("from comparisons.cli import main; main(['--help'])") / bare
    print(f"\nimport numpy 1, import cyclopts {library:.2f}, sensorless --help {help_page:.2f}")
