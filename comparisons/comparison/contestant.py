"""One estimator of a comparison, with what is to be known of it besides its figures."""

from __future__ import annotations

from dataclasses import dataclass

from ident.arrays import FloatArray
from ident.coupling import Coupling
from ident.log import JointLog
from ident.model import CurrentModel
from ident.predictor import CurrentPredictor
from learned.predictor import LearnedModel
from observers.direct import DirectEstimator
from observers.methods import make_estimator
from observers.residual import ResidualEstimator


@dataclass(frozen=True, eq=False)
class Contestant:
    """An estimator of a comparison.

    Attributes:
        name: of the run; of several seeds each has its own.
        method: whose run it is.
        model: what predicts, or what the observer stands on.
        observer: name of the observer; None compares the prediction with the current itself.
        bandwidth: of an observer's residual [Hz].
        gain: joint torque per unit of current (n,), where known.
        seconds: what identifying or training took [s], also where it was interrupted; None where it is not known.
        seed: of a network's weights and batches.
        coupling: of the motors, if gears couple joints.
    """

    name: str
    method: str
    model: CurrentModel | LearnedModel
    observer: str | None = None
    bandwidth: float = 5.0
    gain: FloatArray | None = None
    seconds: float | None = None
    seed: int | None = None
    coupling: Coupling | None = None

    @property
    def learned(self) -> bool:
        """Whether a network has a part in it."""
        return isinstance(self.model, LearnedModel)

    @property
    def memory(self) -> bool:
        """Whether it remembers motion long past, so that it cannot know how a joint came to rest before it moved."""
        return _remembers(self.model)

    @property
    def parameters(self) -> int:
        """Number of fitted numbers: coefficients and shapes of effects, weights of networks."""
        return _count(self.model)

    def estimator(self, log: JointLog) -> ResidualEstimator:
        """Return the estimator for logs like this one; a prediction is compared with the current as logged."""
        if self.observer is not None and isinstance(self.model, CurrentModel):
            return make_estimator(self.observer, self.model, [log], self.bandwidth)
        return DirectEstimator(self._at(log.rate), log.rate, None, self.gain, self.coupling)

    def in_step(self, log: JointLog) -> ResidualEstimator:
        """Return the same with the current delayed by the filter that delays a physical model's motion."""
        if self.observer is not None or not isinstance(self.model, CurrentModel):
            return self.estimator(log)
        return DirectEstimator(self.model, log.rate, self.model.cutoff, self.gain, self.coupling)

    def _at(self, rate: float) -> CurrentPredictor:
        return self.model.at_rate(rate) if isinstance(self.model, LearnedModel) else self.model


def _remembers(model: CurrentPredictor) -> bool:
    if isinstance(model, LearnedModel):
        own = model.method == "lstm" or model.trained.discriminator.count > 0
        return own or (model.physics is not None and _remembers(model.physics))
    return isinstance(model, CurrentModel) and any(term.effect.start().size for term in model.terms)


def _count(model: CurrentPredictor) -> int:
    if isinstance(model, LearnedModel):
        return len(model.trained.weights) + (0 if model.physics is None else _count(model.physics))
    terms = model.terms if isinstance(model, CurrentModel) else ()
    return sum(len(term.coefficients) + len(term.shape) for term in terms)
