"""What the gap workflow names on the measured logs beside the project, with test errors before and after.

Run ``python benchmarks/measured_gaps.py [emps ur10 ur3 lwr4 panda panda-lag]``; prints the findings as sentences.
"""

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from measured_logs import DATA, Case, cases, panda_log, split

from comparisons.report.gap import nameless, sentence
from ident.gap import baseline_model, find_gap


def with_logged_velocity(case: Case) -> Case:
    """The Panda log with the velocities as logged, which lag behind the positions by about 5 ms."""
    dq = np.loadtxt(DATA / "panda_inria/exciting_traj_velocity.txt").reshape(-1, 7)
    train, test = split(panda_log().replace(dq=dq))
    return replace(case, name="panda-lag", train=train, test=test)


def chosen(folder: Path) -> Iterator[Case]:
    for case in cases(folder):
        yield case
        if case.name == "panda":
            yield with_logged_velocity(case)


def main() -> None:
    wanted = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        for case in chosen(Path(folder)):
            if case.name == "emps-pulses" or (wanted and case.name not in wanted):
                continue
            begun = time.perf_counter()
            model = baseline_model(case.robot, case.train)
            found = find_gap(model, case.train, case.test)
            seconds = sum(log.read().t[-1] - log.read().t[0] for log in case.train)
            print(f"\n{case.name}: {seconds:.0f} s of logs, {time.perf_counter() - begun:.0f} s of work", flush=True)
            for finding in found.findings:
                print("-", sentence(found, finding))
            for one in found.unexplained:
                print("-", nameless(one))
            assert found.evidence is not None
            print(
                "  test errors before", np.round(found.evidence.before, 4), "after", np.round(found.evidence.after, 4)
            )


if __name__ == "__main__":
    main()
