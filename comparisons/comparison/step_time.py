"""How long an estimator takes for a sample: real samples, one after another, in this process."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ident.arrays import FloatArray
from ident.log import JointLog, Sample
from observers.residual import ResidualEstimator

WARM, TIMED = 200, 1000
"""Samples stepped through before any is timed, and those timed."""

ROUNDS = 3
"""Times that is done; the quietest counts, since the machine may be at something else too."""


@dataclass(frozen=True)
class StepTime:
    """Median and 99th percentile of the time a step takes [us]."""

    p50: float
    p99: float


def step_time(estimator: ResidualEstimator, log: JointLog) -> StepTime:
    """Step through the beginning of a log and time each step by itself; NaN where it is shorter than the warming up."""
    samples = list(itertools.islice(log.samples(), WARM + TIMED))
    if len(samples) <= WARM:
        return StepTime(np.nan, np.nan)
    with threadpool_limits(1, "blas"):
        rounds = np.array([_round(estimator, samples) for _ in range(ROUNDS)])
    p50, p99 = np.quantile(rounds, (0.5, 0.99), axis=1).min(axis=1) / 1e3
    return StepTime(float(p50), float(p99))


def _round(estimator: ResidualEstimator, samples: list[Sample]) -> FloatArray:
    """Time [ns] of each step but the first."""
    estimator.reset()
    for sample in samples[:WARM]:
        estimator.step(sample)
    taken = np.empty(len(samples) - WARM)
    for k, sample in enumerate(samples[WARM:]):
        start = time.perf_counter_ns()
        estimator.step(sample)
        taken[k] = time.perf_counter_ns() - start
    return taken
