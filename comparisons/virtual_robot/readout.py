"""What the drives report of the motors: currents smoothed, late and noisy, positions counted."""

from __future__ import annotations

import numpy as np

from comparisons.virtual_robot.electrical import DelayLine, LowPass
from comparisons.virtual_robot.sensors import Sensors
from comparisons.virtual_robot.truth import Truth
from ident.arrays import FloatArray

INNER_RATE = 1000.0  # [Hz] friction and drives are followed at least this finely


class Readout:
    """Turns motor positions and torques on the inner time grid into the samples of a log.

    Args:
        laws: what is true of the robot.
        rate: sampling rate of the log [Hz].
        seed: draws the sensors' noise.

    Attributes:
        substeps: inner steps to a sample.
        dt: length of an inner step [s].
    """

    def __init__(self, laws: Truth, rate: float, seed: int) -> None:
        self.substeps = max(1, int(np.ceil(INNER_RATE / rate - 1e-9)))
        self.dt = 1.0 / (rate * self.substeps)
        self._drive = laws.drive
        self._sensors = Sensors(laws.sensors, rate, seed)
        self._stages: list[LowPass | DelayLine] = [
            LowPass(laws.smoothing, 2, self.dt),
            LowPass(laws.filter_lag, 1, self.dt),
            DelayLine(laws.delay, self.dt),
        ]
        self._settled = False

    def restart(self) -> None:
        """Take the next sample as if its current had flowed for ever."""
        self._settled = False

    def read(self, t: FloatArray, q: FloatArray, torque: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return reported positions and currents (N, n) from inner steps: times (N substeps,), q and torque (.., n)."""
        current = self._drive.current(torque, t)
        for stage in self._stages:
            if not self._settled:
                stage.reset(current[0])
            current = stage.filter(current)
        self._settled = True
        logged = slice(self.substeps - 1, None, self.substeps)
        return self._sensors.read(q[logged], current[logged])
