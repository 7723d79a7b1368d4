"""MAC for complex modes, without and with the poles: MACX and MACXP.

Source: Vacher, Jacquier and Bucharles, Extensions of the MAC criterion to complex modes, Proc. ISMA 2010. Both
compare the free decays Re(shape exp(pole t)) of two modes instead of the shapes: MACX for motions of one frequency,
MACXP with their own poles, so that equal shapes at different frequencies do not count as one mode.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def poles(frequency: ArrayLike, damping: ArrayLike) -> NDArray[np.complex128]:
    """Poles, rad/s, of undamped natural frequencies (Hz) and damping ratios."""
    omega, ratio = 2.0 * np.pi * np.asarray(frequency, dtype=float), np.asarray(damping, dtype=float)
    return omega * (-ratio + 1j * np.sqrt(1.0 - ratio**2))


def macx(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Compare complex shapes by the extended MAC, (n_a, n_b), which is the MAC where both are real.

    Parameters
    ----------
    a : (n_dof, n_a) array_like
    b : (n_dof, n_b) array_like
        Shapes at the same DOFs.
    """
    first, second = np.asarray(a, dtype=complex), np.asarray(b, dtype=complex)
    cross = np.abs(first.conj().T @ second) + np.abs(first.T @ second)
    norm_a, norm_b = (np.sum(np.abs(s) ** 2, axis=0) + np.abs(np.sum(s**2, axis=0)) for s in (first, second))
    return cross**2 / np.outer(norm_a, norm_b)


def macxp(a: ArrayLike, pole_a: ArrayLike, b: ArrayLike, pole_b: ArrayLike) -> NDArray[np.float64]:
    """Compare complex modes by the pole-weighted MAC, (n_a, n_b): 1 only where shape, frequency and damping agree.

    For light damping it is about the MAC times 4 d_a d_b / ((d_a + d_b)**2 + (omega_a - omega_b)**2) with the decay
    rates d = damping omega: a mode of the model that is off by more than its half-power bandwidth counts as
    another mode. So it compares tests with each other, and a model that is off by less than that.

    Parameters
    ----------
    a, b : (n_dof, n_a), (n_dof, n_b) array_like
        Shapes at the same DOFs.
    pole_a, pole_b : (n_a,), (n_b,) array_like
        Poles with negative real parts, rad/s.

    Raises
    ------
    ValueError
        A pole does not decay, so its motion has no finite norm.
    """
    first, second = np.asarray(a, dtype=complex), np.asarray(b, dtype=complex)
    pole_1, pole_2 = np.asarray(pole_a, dtype=complex), np.asarray(pole_b, dtype=complex)
    for name, pole in (("pole_a", pole_1), ("pole_b", pole_2)):
        if not np.all(pole.real < 0.0):
            message = (
                f"{name}: MACXP needs decaying modes, but pole {int(np.argmax(pole.real))} is {pole.max():g}"
            )
            raise ValueError(message)
    same = np.abs(first.conj().T @ second) / np.abs(pole_1.conj()[:, None] + pole_2)
    mirrored = np.abs(first.T @ second) / np.abs(pole_1[:, None] + pole_2)
    norm_1, norm_2 = (
        np.sum(np.abs(s) ** 2, axis=0) / (2.0 * np.abs(p.real))
        + np.abs(np.sum(s**2, axis=0)) / (2.0 * np.abs(p))
        for s, p in ((first, pole_1), (second, pole_2))
    )
    return (same + mirrored) ** 2 / np.outer(norm_1, norm_2)
