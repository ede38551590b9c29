"""What every model of the motor current offers, physical or learned."""

from typing import Protocol, runtime_checkable

from ident.arrays import FloatArray
from ident.log import JointLog, Sample


@runtime_checkable
class CurrentPredictor(Protocol):
    """Predicts the motor currents of a robot that touches nothing.

    ``step`` after ``reset``, sample by sample, gives what ``predict(log, causal=True)`` gives for the whole log
    (to 1e-9).
    """

    @property
    def unit(self) -> str:
        """Unit of the predicted current (the robot card's ``current_unit``)."""

    @property
    def n(self) -> int:
        """Number of joints."""

    def reset(self) -> None:
        """Forget all memory, as at the start of a log or segment."""

    def step(self, sample: Sample) -> FloatArray:
        """Predict the current (n,) at one sample; NaN where history is still too short."""

    def predict(self, log: JointLog, causal: bool = False) -> FloatArray:
        """Predict the current (N, n) of a whole log; ``causal`` uses the filters that run online."""
