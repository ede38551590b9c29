"""A training of HRDL-MD killed again and again, against the same training left in peace.

Run ``python benchmarks/learned_kills.py``: the training runs once from end to end; then it is begun anew, killed with
SIGKILL at random moments, and begun again each time, until it has been killed so often; the last attempt goes through.
It prints whether the weights are equal to the bit.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

TRAINING = """
import sys
from pathlib import Path
import torch
torch.set_num_threads(1)
from comparisons.protocols import named
from comparisons.virtual_robot import VirtualRobot
from ident.robot import load_robot
from learned.options import TrainingOptions
from learned.training import train
virtual = VirtualRobot(load_robot("vs060"))
log = virtual.record(named("stop_and_go")(virtual.robot, seconds=200.0, seed=5), 5)
options = TrainingOptions(epochs=10, width=64, batch=256, device="cpu", checkpoint_seconds=0.5)
print("begun", flush=True)
train(virtual.robot, [log], None, "hrdl-md", options, Path(sys.argv[1]))
"""


def begin(out: Path) -> subprocess.Popen[bytes]:
    """Begin the training and return when its logs are there."""
    process = subprocess.Popen([sys.executable, "-c", TRAINING, str(out)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    return process


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as name:
        whole, killed = Path(name) / "whole", Path(name) / "killed"
        start = time.monotonic()
        if begin(whole).wait() != 0:
            raise SystemExit("the training failed")
        seconds = time.monotonic() - start
        kills, ended = 0, 0
        while kills < given.kills:
            process = begin(killed)
            time.sleep(rng.uniform(0.0, 2.0 * seconds / given.kills))
            process.kill()
            ended += process.wait() == 0
            kills += 1
        if begin(killed).wait() != 0:
            raise SystemExit("the training failed after a kill")
        weights = [np.load(folder / "weights.npz") for folder in (whole, killed)]
        equal = all(np.array_equal(weights[0][key], weights[1][key]) for key in weights[0].files)
    print(json.dumps({"kills": kills, "of them after the end": ended, "seconds": seconds, "weights equal": equal}))


if __name__ == "__main__":
    main()
