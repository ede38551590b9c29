"""Links and drive gains as a model's rows and the URDF together tell them: a load in N m asks for both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ident.arrays import FloatArray
from ident.effects.base import Term
from ident.effects.rigid_body import Links
from ident.model import NEWTON_METRE, CurrentModel

OFF = 0.1
"""What a URDF's links are off by, in shares of their mass, their mass times its distance, and their inertia."""

NEAREST = 0.02
"""Distance [m] from its joint's frame that a link's mass has at least, whatever the URDF says of it."""

LIGHTEST = 0.01
"""Share of all links' mass that a link has at least."""

ROTOR = 30.0
"""Times its link's inertia that a rotor's may be where it is fitted as part of the link's."""

EXACT, UNKNOWN = 0.1, 1.0
"""Share of what the URDF leaves open of a base parameter that a fit does, however little noise it had, and one whose
errors are not known."""

BENT = 3.0
"""Times its standard deviation that a fitted base parameter is off by: what the model lacks has bent it, too."""

OPEN = 3.0
"""Times the usual gain, or its own, that a joint's is off by before its row is asked."""

TURNS, CLOSE = 30, 1e-4
"""Rounds in which gains are found, at most, and the relative change at which they are."""

DIAGONAL = (4, 6, 9)
"""Where a body's moments of inertia stand among its ten parameters."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Links and gains.

    Attributes:
        parameters: inertial parameters (10 n,) of the links [SI].
        per_newton_metre: force units per N m of each joint, (n,).
    """

    parameters: FloatArray
    per_newton_metre: FloatArray


def bodies_of(model: CurrentModel) -> Bodies:
    """The likeliest links, given the URDF's and a model's, and the gains with which they are the model's.

    The URDF's links are off by a share of each parameter, the fitted base parameters by more than their covariance.
    Unknown gains are free, one a joint: since all rows are of the same links, they are known far better beside one
    another than all of them together. A joint whose row does not tell its gain gets what is usual among the others.
    """
    urdf, links = _Guess.of(model), [term for term in model.terms if isinstance(term.effect, Links)]
    rows = [row for row in (_Row.of(model, term, urdf) for term in links) if row.gain > 0.0]
    gains = np.ones(model.n)
    if not rows:
        return Bodies(urdf.values[: 10 * model.n], gains)
    found = np.ones(len(rows)) if model.force_unit == NEWTON_METRE else _gains(rows, urdf)
    for row, gain in zip(rows, found, strict=True):
        gains[row.joints] = gain
    seen, scatter = _seen(rows, found, urdf)
    left = np.concatenate([row.fitted for row in rows]) - seen @ urdf.values
    likeliest = urdf.values + urdf.spread**2 * (seen.T @ np.linalg.solve(scatter, left))
    return Bodies(likeliest[: 10 * model.n], gains)


@dataclass(frozen=True, eq=False)
class _Guess:
    """What is known of a robot before any log.

    Attributes:
        values: inertial parameters of the links and inertias of the rotors, (11 n,) [SI].
        spread: their standard deviations (11 n,).
    """

    values: FloatArray
    spread: FloatArray

    @classmethod
    def of(cls, model: CurrentModel) -> _Guess:
        """What the URDF says, and nothing of rotors that the model has no term for."""
        body = model.robot.multibody.parameters.reshape(-1, 10)
        mass = np.maximum(body[:, 0], max(LIGHTEST * body[:, 0].sum(), 1e-9))  # a URDF may have no masses
        away = np.maximum(np.linalg.norm(body[:, 1:4], axis=1) / mass, NEAREST)
        inertia = np.maximum(0.5 * body[:, DIAGONAL].sum(axis=1), mass * away**2)
        links = OFF * np.column_stack([mass, *[mass * away] * 3, *[inertia] * 6])
        rotors = np.where(model.rotor_inertia == 0.0, ROTOR * inertia, 0.0)
        return cls(np.append(body.ravel(), np.zeros(len(body))), np.append(links.ravel(), rotors))


@dataclass(frozen=True, eq=False)
class _Row:
    """Base parameters as fitted, of one joint's row or of all joints', each over what the URDF leaves open of it.

    Attributes:
        joints: whose.
        made_of: what each is made of, (b, 11 n), per unit of the gain.
        expected: what the URDF says of them, (b,) per unit of the gain.
        fitted: as fitted, (b,) in force units.
        gain: by how much they are larger, roughly.
        noise: covariance (b, b) of what they are off by.
    """

    joints: slice | int
    made_of: FloatArray
    expected: FloatArray
    fitted: FloatArray
    gain: float
    noise: FloatArray

    @classmethod
    def of(cls, model: CurrentModel, term: Term, urdf: _Guess) -> _Row:
        """A model's links; a rotor that does not show beside them acts as a ball does that turns with its link."""
        links, n = term.effect, model.n
        assert isinstance(links, Links)
        of_links = links.base(model.robot).projection
        of_rotors = of_links.reshape(-1, n, 10)[:, :, DIAGONAL].sum(axis=2)
        if links.joint is not None:
            of_rotors[:, np.arange(n) != links.joint] = 0.0
        made_of = np.hstack([of_links, of_rotors])
        unit = 1.0 / np.linalg.norm(made_of * urdf.spread, axis=1)
        made_of, fitted = made_of * unit[:, None], term.coefficients * unit
        expected = made_of @ urdf.values
        size = float(np.linalg.norm(expected))
        gain = float(np.linalg.norm(fitted)) / size if size > 0.0 else 0.0
        known = term.errors.shape[1] > 0
        noise = ((EXACT if known else UNKNOWN) * gain) ** 2 * np.eye(len(unit))
        if known:
            errors = BENT * term.errors * unit[:, None]
            noise += errors @ errors.T
        joints = slice(None) if links.joint is None else links.joint
        return cls(joints, made_of, expected, fitted, gain, noise)


def _seen(rows: Sequence[_Row], gains: FloatArray, urdf: _Guess) -> tuple[FloatArray, FloatArray]:
    """What all base parameters are made of at these gains, (p, 11 n), and the covariance (p, p) of what is expected."""
    seen = np.concatenate([gain * row.made_of for row, gain in zip(rows, gains, strict=True)])
    return seen, (seen * urdf.spread**2) @ seen.T + block_diag(*[row.noise for row in rows])


def _gains(rows: Sequence[_Row], urdf: _Guess) -> FloatArray:
    """Gains (rows,) by generalised least squares; their weights depend on the gains, so they are found in rounds."""
    fitted = np.concatenate([row.fitted for row in rows])
    expected = block_diag(*[row.expected[:, None] for row in rows])
    gains = np.array([row.gain for row in rows])
    for _ in range(TURNS):
        usual, before = float(np.median(gains)), gains
        _, scatter = _seen(rows, gains, urdf)
        weighed = np.linalg.solve(scatter, expected).T
        least = 1.0 / (OPEN * np.maximum(abs(usual), np.abs(gains))) ** 2
        gains = np.linalg.solve(weighed @ expected + np.diag(least), weighed @ fitted + least * usual)
        if np.abs(gains - before).max() < CLOSE * abs(usual):
            break
    return gains
