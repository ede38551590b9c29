"""Designed excitation against random feasible motions of the same family, and how reliably designs end feasible.

python benchmarks/excitation.py [vs060 ur10 panda] [--random 2000] [--starts 20] [--jobs 2] [--json FILE]
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from importlib.metadata import files
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from ident.arrays import FloatArray
from ident.card import RobotCard
from ident.excitation.design import Attempt, Designer, Request
from ident.multibody import Multibody
from ident.robot import JointLimits, Robot, load_robot

EXAMPLES = {
    "ur10": ("ur_description/urdf/ur10_robot.urdf", None),
    "panda": ("panda_description/urdf/panda.urdf", [f"panda_joint{k}" for k in range(1, 8)]),
}
TRIALS = 200  # identifications with simulated noise
SPACING = 0.1  # [s] between samples of independent noise


def designer(name: str) -> Designer:
    """Set up the design of a robot's excitation with the defaults: 10 s, 5 harmonics, the ground at the base."""
    if name == "vs060":
        return Designer(load_robot(name), Request())
    path, joints = EXAMPLES[name]
    wanted = f"example-robot-data/robots/{path}"
    urdf = next(Path(str(f.locate())) for f in files("example-robot-data") or [] if str(f).endswith(wanted))
    body = Multibody.from_urdf(urdf, joints)
    limits = JointLimits(body.lower, body.upper, body.velocity, np.full(body.n, np.inf), body.effort)
    return Designer(Robot(RobotCard(name=name, urdf=str(urdf), joints=joints), body, limits, urdf), Request())


def random_motions(name: str, seeds: range) -> list[tuple[int, float, float, float]]:
    """Seed, log-det, condition number and geometric mean deviation of random feasible motions."""
    design = designer(name)
    found = []
    for seed in seeds:
        matrix = design.gain(design.draw(np.random.default_rng([1, seed])))
        information = design.information
        spread = float(np.exp(np.mean(np.log(information.deviations(matrix)))))
        found.append((seed, information.log_det(matrix), information.condition_number(matrix), spread))
    return found


def designs(name: str, seeds: range) -> list[tuple[Attempt, dict[str, Any]]]:
    """Design from random starts; every answer is verified anew."""
    design = designer(name)
    found = []
    for seed in seeds:
        begun = time.process_time()
        attempt = design.attempt(design.start(np.random.default_rng([2, seed])))
        spent = time.process_time() - begun
        found.append((attempt, {**_account(design, attempt), "seconds": spent, "seed": seed}))
    return found


def _account(design: Designer, attempt: Attempt) -> dict[str, Any]:
    matrix = design.gain(attempt.trajectory)
    verdict = design.feasibility.verify(attempt.trajectory)
    return {
        "feasible": verdict.feasible,
        "violations": verdict.violations,
        "clearance": verdict.closest.least,
        "log_det": attempt.log_det,
        "condition": attempt.condition_number,
        "links_condition": design.information.condition_number(matrix, links_only=True),
        "spread": float(np.exp(np.mean(np.log(design.information.deviations(matrix))))),
        "kept": attempt.kept,
        "coefficients": attempt.trajectory.coefficients.tolist(),
    }


def identified_spread(name: str, coefficients: FloatArray) -> float:
    """Geometric mean deviation of parameters identified by least squares from simulated noisy torques."""
    from ident.excitation.fourier import Trajectory

    design = designer(name)
    rng = np.random.default_rng(3)
    motion = Trajectory(design.family, coefficients).sample(1.0 / SPACING)
    rows = design.information.rows(motion).reshape(-1, design.information.size)
    truth = rng.standard_normal(design.information.size)
    noise = rng.standard_normal((len(rows), TRIALS))  # the rows are in units of the noise
    identified = np.linalg.lstsq(rows, (rows @ truth)[:, None] + noise, rcond=None)[0]
    return float(np.exp(np.mean(np.log(np.std(identified - truth[:, None], axis=1)))))


def cost(name: str) -> float:
    """Processor time of a start over that of verifying its answer once, median of three."""
    design = designer(name)
    design.attempt(design.start(np.random.default_rng([2, 0])))  # sets up and compiles
    ratios = []
    for seed in range(1, 4):
        times = [time.process_time()]
        attempt = design.attempt(design.start(np.random.default_rng([2, seed])))
        times.append(time.process_time())
        design.feasibility.verify(attempt.trajectory)
        times.append(time.process_time())
        ratios.append((times[1] - times[0]) / (times[2] - times[1]))
    return float(np.median(ratios))


def study(name: str, random: int, starts: int, jobs: int) -> dict[str, Any]:
    """Measure one robot."""
    pool = Parallel(n_jobs=jobs)
    tried = [d for part in pool(delayed(designs)(name, part) for part in _parts(starts, jobs)) for d in part]
    drawn = [r for part in pool(delayed(random_motions)(name, part) for part in _parts(random, jobs)) for r in part]
    made = [account for _, account in tried]
    design = designer(name)
    chosen = design.choose([attempt for attempt, _ in tried])
    best = next(account for attempt, account in tried if attempt is chosen)
    by_spread = sorted(drawn, key=lambda r: r[3])
    median = by_spread[len(by_spread) // 2]
    ordinary = design.draw(np.random.default_rng([1, median[0]]))
    ratio = identified_spread(name, np.array(best["coefficients"])) / identified_spread(name, ordinary.coefficients)
    return {
        "robot": name,
        "parameters": design.information.size,
        "feasible": sum(d["feasible"] for d in made),
        "starts": starts,
        "condition": best["condition"],
        "links_condition": best["links_condition"],
        "worst_condition": max(d["condition"] for d in made),
        "log_det": best["log_det"],
        "worst_log_det": min(d["log_det"] for d in made),
        "random": random,
        "best_random_log_det": max(r[1] for r in drawn),
        "best_random_condition": min(r[2] for r in drawn),
        "median_random_log_det": float(np.median([r[1] for r in drawn])),
        "interval_ratio": best["spread"] / median[3],
        "interval_ratio_best_random": best["spread"] / by_spread[0][3],
        "identified_ratio": ratio,
        "clearance": best["clearance"],
        "seconds": float(np.median([d["seconds"] for d in made])),
        "most_seconds": max(d["seconds"] for d in made),
        "cost": cost(name),
    }


def _parts(count: int, jobs: int) -> list[range]:
    edges = np.linspace(0, count, jobs + 1).astype(int)
    return [range(a, b) for a, b in itertools.pairwise(edges)]


def table(results: list[dict[str, Any]]) -> str:
    """Lay the results out in Markdown, a column a robot."""
    lines = [
        ("parameters (links, rotors, friction)", "{parameters}"),
        ("starts that ended feasible", "{feasible} of {starts}"),
        ("condition number, columns of unit length", "{condition:.1f}"),
        ("that of the links' columns alone", "{links_condition:.1f}"),
        ("condition number of the worst start", "{worst_condition:.1f}"),
        ("log det", "{log_det:.1f}"),
        ("log det, worst start", "{worst_log_det:.1f}"),
        ("log det, best of the random feasible motions", "{best_random_log_det:.1f}"),
        ("log det, their median", "{median_random_log_det:.1f}"),
        ("condition number, best of the random feasible motions", "{best_random_condition:.1f}"),
        ("random feasible motions", "{random}"),
        ("interval over that of the median random motion", "{interval_ratio:.3f}"),
        ("the same, identified from simulated noise", "{identified_ratio:.3f}"),
        ("interval over that of the best random motion", "{interval_ratio_best_random:.3f}"),
        ("least distance along the path [mm]", "{millimetres:.0f}"),
        ("processor time of a start, median [s]", "{seconds:.1f}"),
        ("processor time of a start, longest [s]", "{most_seconds:.1f}"),
        ("processor time of a start over verifying its answer once", "{cost:.0f}"),
    ]
    rows = [["", *(r["robot"] for r in results)], ["---", *("---" for _ in results)]]
    for label, form in lines:
        rows.append([label, *(form.format(**r, millimetres=1e3 * r["clearance"]) for r in results)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("robots", nargs="*", default=["vs060", "ur10", "panda"])
    parser.add_argument("--random", type=int, default=2000)
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results = [study(name, options.random, options.starts, options.jobs) for name in options.robots]
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))
    print(table(results))


if __name__ == "__main__":
    main()
