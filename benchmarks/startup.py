"""How long ``sensorless --help`` takes, beside a bare Python that imports numpy: ``python benchmarks/startup.py``."""

import statistics
import subprocess
import sys
import time

ROUNDS = 15
PROGRAMS = {
    "import numpy": "import numpy",
    "import cyclopts": "import cyclopts",
    "sensorless --help": "from comparisons.cli import main; main(['--help'])",
}


def seconds(code: str) -> float:
    """Wall time of a fresh Python that runs some code."""
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begun


if __name__ == "__main__":
    # In turn, so that whatever else the machine does falls on all of them alike.
    rounds = [{name: seconds(code) for name, code in PROGRAMS.items()} for _ in range(ROUNDS)]
    for name in PROGRAMS:
        print(f"{name:<20}{statistics.median(r[name] / r['import numpy'] for r in rounds):.2f}")
