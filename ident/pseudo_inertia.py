"""Inertial parameters of a body as one matrix, which is positive definite exactly for bodies that can exist."""

from __future__ import annotations

import numpy as np

from ident.arrays import FloatArray


def pseudo_inertia(parameters: FloatArray) -> FloatArray:
    """Pseudo-inertia [[Sigma, h], [h', m]] (..., 4, 4) of bodies' parameters (..., 10) (Wensing et al. 2018, eq. 12).

    ``Sigma = tr(I)/2 - I`` is the second moment of mass and ``h`` the first; a body of positive mass density has a
    positive definite one, and each positive definite one belongs to such a body. Parameters are in Pinocchio's order,
    ``m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``, about any one point.
    """
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = np.moveaxis(np.asarray(parameters, dtype=float), -1, 0)
    rows = [
        [(yy + zz - xx) / 2, -xy, -xz, hx],
        [-xy, (xx + zz - yy) / 2, -yz, hy],
        [-xz, -yz, (xx + yy - zz) / 2, hz],
        [hx, hy, hz, m],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def body_parameters(matrix: FloatArray) -> FloatArray:
    """Parameters (10,) of the body with a pseudo-inertia (4, 4), the inverse of `pseudo_inertia`."""
    second, first, mass = matrix[:3, :3], matrix[:3, 3], matrix[3, 3]
    inertia = inertia_of(second)
    xx, yy, zz = np.diag(inertia)
    return np.array([mass, *first, xx, inertia[0, 1], yy, inertia[0, 2], inertia[1, 2], zz])


def inertia_of(second_moment: FloatArray) -> FloatArray:
    """Rotational inertia (3, 3) [kg m^2] of a second moment of mass (3, 3): ``tr(S) 1 - S``."""
    inertia: FloatArray = np.trace(second_moment) * np.eye(3) - second_moment
    return inertia
