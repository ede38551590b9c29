"""Waypoints of a designed motion for controllers: CSV or Parquet tables and a ``trajectory_msgs/JointTrajectory``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ident.arrays import FloatArray
from ident.errors import InputError
from ident.excitation.fourier import FourierFamily
from ident.signals import Motion

FORMATS = ("csv", "parquet")
LOWEST_SAMPLES = 10  # a period of the highest harmonic, below which a controller's interpolation is another motion


def check_rate(family: FourierFamily, rate: float) -> None:
    """Refuse a rate of waypoints [Hz] that is too low to carry motions of the family.

    Raises:
        InputError: it is.
    """
    lowest = LOWEST_SAMPLES * family.harmonics / family.period
    if not lowest <= rate < np.inf:
        raise InputError(f"a rate of {rate:g} Hz", "waypoints", f"give at least {lowest:g} Hz for this motion")


def write_table(motion: Motion, path: Path) -> None:
    """Write ``t``, ``q1..qn``, ``dq1..dqn`` and ``ddq1..ddqn`` [s, rad, m] as CSV or Parquet, by suffix."""
    write_columns(motion.t, {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq}, path)


def write_columns(t: FloatArray, joints: Mapping[str, FloatArray], path: Path) -> None:
    """Write ``t`` (N,) and what each joint does, (N, n) by name, with columns ``name1..namen``; CSV or Parquet."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    columns: dict[str, FloatArray] = {"t": t}
    for name, values in joints.items():
        columns |= {f"{name}{k + 1}": values[:, k] for k in range(values.shape[1])}
    table = pa.table(columns)
    if path.suffix == ".parquet":
        pyarrow.parquet.write_table(table, path)
    else:
        options = pyarrow.csv.WriteOptions(quoting_style="none", quoting_header="none")
        pyarrow.csv.write_csv(table, path, options)


def write_joint_trajectory(motion: Motion, joints: Sequence[str], path: Path) -> None:
    """Write a ``trajectory_msgs/JointTrajectory`` as YAML, as ``ros2 topic pub`` and rosbag tools take it."""
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''", "joint_names:"]
    lines += [f"- {_quoted(joint)}" for joint in joints]
    lines.append("points:")
    for t, q, dq, ddq in zip(motion.t, motion.q, motion.dq, motion.ddq, strict=True):
        seconds, nanoseconds = divmod(round(1e9 * float(t)), 1_000_000_000)
        lines += [
            f"- positions: {_flow(q)}",
            f"  velocities: {_flow(dq)}",
            f"  accelerations: {_flow(ddq)}",
            "  effort: []",
            f"  time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}",
        ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _flow(values: FloatArray) -> str:
    # YAML 1.1 reads an exponent only after a decimal point, so numbers are written without one.
    return f"[{', '.join(f'{value:.9f}' for value in values)}]"


def _quoted(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"
