"""Lowest natural modes by block Krylov iteration with a shifted, factorised stiffness matrix."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.errors import SolveError

Vectors = NDArray[np.float64]
Product = Callable[[Vectors], Vectors]

_MAX_STEPS = 40


def orthonormalize(
    x: Vectors, mass: Product, against: Vectors, mass_against: Vectors
) -> tuple[Vectors, Vectors]:
    """Return a mass-orthonormal basis of what `x` adds to `against`, and its product with the mass.

    Parameters
    ----------
    x : (n, k)
        Vectors.
    mass : callable
        Product with the mass matrix.
    against, mass_against : (n, m)
        Mass-orthonormal vectors and their product with the mass matrix.

    Returns
    -------
    basis, mass_basis : (n, j)
        Directions that are linearly dependent to 1e-7 are left out, so j may be below k.
    """
    mass_x = mass(x)
    scale = np.sqrt(np.einsum("ij,ij->j", x, mass_x))
    x, mass_x = x / scale, mass_x / scale
    for _ in range(2):  # the second pass removes what rounding left of the first
        if x.shape[1] == 0:
            break
        part = mass_against.T @ x
        x, mass_x = x - against @ part, mass_x - mass_against @ part
        values, vectors = la.eigh(x.T @ mass_x)
        keep = values > 1e-14 * max(values[-1], 1.0)
        turn = vectors[:, keep] / np.sqrt(values[keep])
        x, mass_x = x @ turn, mass_x @ turn
    return x, mass_x


def lowest_modes(
    solve: Product, mass: Product, shift: float, start: Vectors, n_mode: int, tolerance: float
) -> tuple[NDArray[np.float64], Vectors]:
    """Return the lowest eigenpairs of K x = lambda M x.

    Parameters
    ----------
    solve : callable
        Product with (K + shift M)^-1 for a block of vectors (n, k).
    mass : callable
        Product with M.
    shift : float
        Positive shift, (rad/s)**2, which makes a free body's stiffness positive definite.
    start : (n, k)
        First block; k should be at least the multiplicity of any eigenvalue.
    n_mode : int
        Number of modes.
    tolerance : float
        Relative change of ``lambda + shift`` from one step to the next at which the iteration ends.

    Returns
    -------
    eigenvalue : (n_mode,)
        Ascending, (rad/s)**2.
    vector : (n, k)
        Mass-normalised. Those beyond the first `n_mode` are further Ritz vectors, not converged, which the
        iteration gives away free.

    Raises
    ------
    SolveError
        No convergence within 40 steps.
    """
    nothing = np.empty((start.shape[0], 0))
    block, mass_block = orthonormalize(start, mass, nothing, nothing)
    basis, mass_basis, images = block, mass_block, nothing
    before = np.zeros(0)
    for _ in range(_MAX_STEPS):
        image = solve(mass_block)
        images = np.hstack([images, image])
        projected = mass_basis.T @ images
        inverse, vectors = la.eigh((projected + projected.T) / 2.0)
        now = 1.0 / inverse[::-1][:n_mode]
        if now.size == n_mode == before.size and np.all(np.abs(now - before) <= tolerance * now):
            return now - shift, basis @ vectors[:, ::-1][:, : start.shape[1]]
        before = now
        block, mass_block = orthonormalize(image, mass, basis, mass_basis)
        if block.shape[1] == 0 and now.size == n_mode:  # the space is invariant and its Ritz values exact
            return now - shift, basis @ vectors[:, ::-1][:, : start.shape[1]]
        basis, mass_basis = np.hstack([basis, block]), np.hstack([mass_basis, mass_block])
    message = f"the {n_mode} lowest modes did not converge in {_MAX_STEPS} steps"
    raise SolveError(message)
