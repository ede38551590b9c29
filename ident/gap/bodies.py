"""Links and drive gains as a model's rows and the URDF together tell them: a load in N m asks for both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.optimize import minimize

from ident.arrays import FloatArray, IntArray
from ident.effects.base import Term
from ident.effects.rigid_body import Links, RotorInertia
from ident.model import NEWTON_METRE, CurrentModel

OFF = (0.01, 0.5)
"""What a URDF's links are off by, least and most, in shares of their mass, that times its distance, their inertia."""

USUAL = 0.1
"""Such a share, by which a base parameter's unit is taken and the search starts."""

NEAREST = 0.02
"""Distance [m] from its joint's frame that a link's mass has at least, whatever the URDF says of it."""

LIGHTEST = 0.01
"""Share of all links' mass that a link has at least."""

TOOL = (1e-4, 1.0)
"""Share of all links' mass that something weighs, least and most, which the last link carries and the URDF lacks."""

ROTOR = (0.01, 30.0)
"""Times its link's inertia, or mass, that a rotor's is, least and most, where it is fitted as part of the link's."""

EXACT, UNKNOWN = 0.1, 1.0
"""Share of what the URDF leaves open of a base parameter that a fit does, however little noise it had, and one whose
errors are not known."""

BENT = 3.0
"""Times its standard deviation that a fitted base parameter is off by: what the model lacks has bent it, too."""

OPEN = 10.0
"""Times the usual gain that a joint's is off by before its row is asked."""

FAR = 1e4
"""Times a rough gain that the likeliest is off by, at most."""

PRECISE = {"ftol": 1e-12, "gtol": 1e-4}
"""Where the search for them ends: a gain of which little is told changes the likelihood little, too."""

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

    The URDF's links are off by a share of each parameter, the last one by a tool besides, the fitted base parameters by
    more than their covariance; by how much, the rows themselves tell. Unknown gains are free, one a joint: since all
    rows are of the same links, they are known far better beside one another than all of them together. A joint whose
    row does not tell its gain gets what is usual among the others.
    """
    urdf, links = _Guess.of(model), [term for term in model.terms if isinstance(term.effect, Links)]
    rows = [row for row in (_Row.of(model, term, urdf) for term in links) if row.gain > 0.0]
    if not rows or not urdf.values.any():
        return Bodies(urdf.values[: 10 * model.n], np.ones(model.n))
    together = _Rows.of(rows, urdf)
    found, scales = together.likeliest(known=model.force_unit == NEWTON_METRE)
    gains = np.full(model.n, np.exp(np.log(found).mean()))
    for row, gain in zip(rows, found, strict=True):
        gains[row.joints] = gain
    return Bodies(together.bodies(found, scales)[: 10 * model.n], gains)


@dataclass(frozen=True, eq=False)
class _Guess:
    """What is known of a robot before any log.

    Attributes:
        values: inertial parameters of the links and inertias of the rotors, (11 n,) [SI].
        spreads: their standard deviations (3, 11 n), of links that are off by all that they weigh, of something at the
            last link that weighs as much as all of them, and of rotors as large as their links.
    """

    values: FloatArray
    spreads: FloatArray

    def spread(self, scales: FloatArray) -> FloatArray:
        """Their standard deviations (11 n,), of links, tool and rotors that are off by these shares, (3,)."""
        return np.asarray(np.linalg.norm(scales[:, None] * self.spreads, axis=0))

    @classmethod
    def of(cls, model: CurrentModel) -> _Guess:
        """What the URDF says; of rotors that the model does not tell from links, by a term of their own, nothing."""
        tree = model.robot.multibody.tree
        inertias = [term for term in model.terms if isinstance(term.effect, RotorInertia)]
        shown = [term.effect.at for term in inertias if term.coefficients.any()]
        body = model.robot.multibody.parameters.reshape(-1, 10)
        mass = np.maximum(body[:, 0], max(LIGHTEST * body[:, 0].sum(), 1e-9))  # a URDF may have no masses
        away = np.maximum(np.linalg.norm(body[:, 1:4], axis=1) / mass, NEAREST)
        inertia = np.maximum(0.5 * body[:, DIAGONAL].sum(axis=1), mass * away**2)
        links = np.column_stack([mass, *[mass * away] * 3, *[inertia] * 6])
        arm = max(float(np.mean(np.linalg.norm(tree.translation, axis=1))), NEAREST)  # as far as a link is long
        tool = np.zeros_like(links)
        tool[tree.order[-1]] = mass.sum() * np.array([1.0, *[arm] * 3, *[arm**2] * 6])
        rotors = np.where(tree.prismatic, mass, inertia)
        rotors[shown] = 0.0
        none = np.zeros(len(body))
        spreads = np.append(links, none), np.append(tool, none), np.append(np.zeros(body.size), rotors)
        return cls(np.append(body, none), np.stack(spreads))


@dataclass(frozen=True, eq=False)
class _Row:
    """Base parameters as fitted, of one joint's row or of all joints', each over what the URDF leaves open of it.

    Attributes:
        joints: whose.
        made_of: what each is made of, (b, 11 n), per unit of the gain.
        fitted: as fitted, (b,) in force units.
        gain: by how much they are larger than the URDF says, roughly.
        errors: independent parts (b, k) of what they are off by, in force units.
        open: share of what the URDF leaves open of them that a fit does, too.
    """

    joints: slice | int
    made_of: FloatArray
    fitted: FloatArray
    gain: float
    errors: FloatArray
    open: float

    @classmethod
    def of(cls, model: CurrentModel, term: Term, urdf: _Guess) -> _Row:
        """A model's links; a rotor that does not show beside them acts as a ball that turns or slides with its link."""
        links, n = term.effect, model.n
        assert isinstance(links, Links)
        of_links = links.base(model.robot).projection
        of_bodies = of_links.reshape(-1, n, 10)
        slides = model.robot.multibody.prismatic
        of_rotors = np.where(slides, of_bodies[:, :, 0], of_bodies[:, :, DIAGONAL].sum(axis=2))
        if links.joint is not None:
            of_rotors[:, np.arange(n) != links.joint] = 0.0
        made_of = np.hstack([of_links, of_rotors])
        unit = 1.0 / np.linalg.norm(made_of * urdf.spread(np.array([USUAL, 0.0, ROTOR[1]])), axis=1)
        made_of, fitted = made_of * unit[:, None], term.coefficients * unit
        expected = made_of @ urdf.values
        # What the URDF leaves open of each is one.
        gain = float(np.linalg.norm(fitted) / np.sqrt(expected @ expected + len(expected)))
        known = term.errors.shape[1] > 0
        errors = BENT * term.errors * unit[:, None] if known else np.zeros((len(unit), 0))
        joints = slice(None) if links.joint is None else links.joint
        return cls(joints, made_of, fitted, gain, errors, EXACT if known else UNKNOWN)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Base parameters of all rows, (p,) in all.

    Attributes:
        urdf: what is known before.
        made_of: what they are made of per unit of gain, (p, 11 n).
        fitted: as fitted, (p,).
        row: number of each one's row, (p,).
        start: gains of the rows, roughly, (r,).
        errors: covariance (p, p) of their errors.
        open: share (p,) of what the URDF leaves open of each that a fit does, too.
    """

    urdf: _Guess
    made_of: FloatArray
    fitted: FloatArray
    row: IntArray
    start: FloatArray
    errors: FloatArray
    open: FloatArray

    @classmethod
    def of(cls, rows: Sequence[_Row], urdf: _Guess) -> _Rows:
        """Put rows together."""
        count = [len(row.fitted) for row in rows]
        return cls(
            urdf, np.concatenate([row.made_of for row in rows]), np.concatenate([row.fitted for row in rows]),
            np.repeat(np.arange(len(rows)), count), np.array([row.gain for row in rows]),
            block_diag(*[row.errors @ row.errors.T for row in rows]), np.repeat([row.open for row in rows], count),
        )  # fmt: skip

    def likeliest(self, known: bool) -> tuple[FloatArray, FloatArray]:
        """The likeliest gains (r,), all of them positive, and shares (3,) that links, tool and rotors are off by.

        Args:
            known: whether all gains are one.
        """
        count = len(self.start)
        gains, reach = (np.zeros(count), 0.0) if known else (np.log(self.start), np.log(FAR))
        bounds = [*((one - reach, one + reach) for one in gains), *(tuple(np.log(ends)) for ends in (OFF, TOOL, ROTOR))]
        ends = product(TOOL, ROTOR if self.urdf.spreads[2].any() else ROTOR[:1])
        starts = (np.append(gains, np.log([USUAL, *scales])) for scales in ends)
        tried = [minimize(self._unlikely, start, jac=True, bounds=bounds, options=PRECISE) for start in starts]
        found = np.exp(min(tried, key=lambda one: float(one.fun)).x)
        return found[:-3], found[-3:]

    def bodies(self, gains: FloatArray, scales: FloatArray) -> FloatArray:
        """The likeliest inertial parameters of links and inertias of rotors, (11 n,), at gains (r,)."""
        gain, open_ = gains[self.row], self.urdf.spread(scales) ** 2
        scatter = np.outer(gain, gain) * np.tensordot(scales**2, self._parts, 1) + self.errors
        left = np.linalg.solve(scatter, self.fitted - gain * self._expected)
        likeliest: FloatArray = self.urdf.values + open_ * (self.made_of.T @ (gain * left))
        return likeliest

    @cached_property
    def _expected(self) -> FloatArray:
        """What the URDF says of them, (p,) per unit of gain."""
        return self.made_of @ self.urdf.values

    @cached_property
    def _parts(self) -> FloatArray:
        """Their covariances per unit of gain, by links that are off, tools and rotors: (3, p, p)."""
        parts = np.stack([(self.made_of * spread**2) @ self.made_of.T for spread in self.urdf.spreads])
        parts[0] += np.diag((self.open / USUAL) ** 2)
        return parts

    def _unlikely(self, logs: FloatArray) -> tuple[float, FloatArray]:
        """Minus twice the log-likelihood at logarithms of gains and scales, (r + 3,), and its gradient."""
        gain, parts = np.exp(logs[:-3])[self.row], np.exp(2.0 * logs[-3:])[:, None, None] * self._parts
        parts *= np.outer(gain, gain)
        every, expected = parts.sum(axis=0), gain * self._expected
        factor = cho_factor(every + self.errors, lower=True)
        left = self.fitted - expected
        pull, inverse = cho_solve(factor, left), cho_solve(factor, np.eye(len(left)))
        steep = inverse - np.outer(pull, pull)
        apart = (logs[:-3] - logs[:-3].mean()) / np.log(OPEN)
        by_row = 2.0 * ((steep * every).sum(axis=1) - pull * expected)
        by_gain = np.bincount(self.row, by_row) + 2.0 * apart / np.log(OPEN)
        value = left @ pull + 2.0 * np.log(np.diag(factor[0])).sum() + apart @ apart
        return float(value), np.append(by_gain, 2.0 * np.einsum("ij,kij->k", steep, parts))
