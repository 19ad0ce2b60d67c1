"""The equations of Adamov & Kobrin (2018) written out once more, for the tests to compare with.

Nothing here calls the library: symbols and signs are those of eq. (3) to (7) of the paper, for four
mecanum wheels fl, fr, rl, rr.
"""

from typing import NamedTuple

import numpy as np


class Sizes(NamedTuple):
    """l, h, R, r in m and m1 in kg, as printed in the paper."""

    half_track: float = 0.15
    half_base: float = 0.2355
    R: float = 0.0475
    r: float = 0.014
    m1: float = 1.4

    @property
    def L(self):
        return self.half_track + self.half_base

    @classmethod
    def drawn(cls, rng):
        """Some other robot."""
        R = rng.uniform(0.03, 0.12)
        return cls(*rng.uniform(0.1, 0.4, 2), R, rng.uniform(0.1, 0.6) * R, rng.uniform(0.2, 2))


def jacobian(sizes):
    """Wheel speeds from body velocities, eq. (3)."""
    L = sizes.L
    return np.array([[1, -1, -L], [1, 1, L], [1, 1, -L], [1, -1, L]]) / sizes.R


def roller_jacobian(sizes):
    """Roller rates from body velocities: -(V_Y + rho_x Omega) / (r cos 45 deg)."""
    rho_x = sizes.half_base * np.array([1, 1, -1, -1])
    return -np.column_stack([np.zeros(4), np.ones(4), rho_x]) / (sizes.r * np.sqrt(0.5))


def friction(sizes, mu1, mu2):
    """D_X, D_Y, D_Omega."""
    D_X, roller = 4 * mu1 / sizes.R**2, 8 * mu2 / sizes.r**2
    return D_X, D_X + roller, D_X * sizes.L**2 + roller * sizes.half_base**2


def wrench(sizes, M):
    """F_X, F_Y, M_O of the shaft torques M."""
    M1, M2, M3, M4 = M
    F = [M1 + M2 + M3 + M4, -M1 + M2 + M3 - M4, sizes.L * (-M1 + M2 - M3 + M4)]
    return np.array(F) / sizes.R


def mass_matrix(sizes, p):
    """What multiplies (V_X', V_Y', Omega') in eq. (4), for parameters p by name."""
    m, spin = p["m0"] - 4 * sizes.m1, 4 * p["I1"] / sizes.R**2
    return np.array(
        [
            [p["m0"] + spin, 0, -m * p["a_y"]],
            [0, p["m0"] + spin, m * p["a_x"]],
            [-m * p["a_y"], m * p["a_x"], p["I0"] + spin * sizes.L**2],
        ]
    )


def remaining(sizes, p, v):
    """The rest of the left side of eq. (4): what depends on velocities alone."""
    m, (V_X, V_Y, Om) = p["m0"] - 4 * sizes.m1, v
    D_X, D_Y, D_O = friction(sizes, p["mu1"], p["mu2"])
    return np.array(
        [
            -p["m0"] * V_Y * Om - m * p["a_x"] * Om**2 + D_X * V_X,
            p["m0"] * V_X * Om - m * p["a_y"] * Om**2 + D_Y * V_Y,
            m * p["a_y"] * V_Y * Om + m * p["a_x"] * V_X * Om + D_O * Om,
        ]
    )


def acceleration(sizes, p, v, forces):
    """(V_X', V_Y', Omega') under generalized forces: eq. (4) solved."""
    return np.linalg.solve(mass_matrix(sizes, p), np.asarray(forces) - remaining(sizes, p, v))


def regressor(sizes, v, a):
    """H of eq. (7), (3, 7), for velocities v and accelerations a."""
    L, eta = sizes.L, sizes.L / sizes.half_base
    (o_X, o_Y, Om), (oX, oY, dOm) = v / [L, L, 1], a / [L, L, 1]
    return np.array(
        [
            [oX - o_Y * Om, 0, oX, -(Om**2), -dOm, o_X, 0],
            [oY + o_X * Om, 0, oY, dOm, -(Om**2), o_Y, eta**2 * o_Y],
            [0, dOm, dOm, oY + o_X * Om, o_Y * Om - oX, Om, Om],
        ]
    )
