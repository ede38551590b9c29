"""How long an estimator takes for a sample: real samples, one after another, in this process."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ident.log import JointLog
from observers.residual import ResidualEstimator

WARM, TIMED = 200, 2000
"""Samples stepped through before any is timed, and those timed."""


@dataclass(frozen=True)
class StepTime:
    """Median and 99th percentile of the time a step takes [us]."""

    p50: float
    p99: float


def step_time(estimator: ResidualEstimator, log: JointLog) -> StepTime:
    """Step through the beginning of a log and time each step by itself; NaN where it is shorter than the warming up."""
    samples = list(itertools.islice(log.samples(), WARM + TIMED))
    estimator.reset()
    with threadpool_limits(1, "blas"):
        for sample in samples[:WARM]:
            estimator.step(sample)
        taken = np.empty(len(samples[WARM:]) or 1)
        taken[:] = np.nan
        for k, sample in enumerate(samples[WARM:]):
            start = time.perf_counter_ns()
            estimator.step(sample)
            taken[k] = time.perf_counter_ns() - start
    p50, p99 = np.quantile(taken, (0.5, 0.99)) / 1e3
    return StepTime(float(p50), float(p99))
