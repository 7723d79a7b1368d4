"""Lowest natural modes by block Krylov iteration with a shifted, factorised stiffness matrix."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.stack.errors import SolveError

Vectors = NDArray[np.float64]
Product = Callable[[Vectors], Vectors]
Block = tuple[Vectors, Vectors]  # mass-orthonormal vectors and their product with the mass matrix

_MAX_STEPS = 40


def orthonormalize(x: Vectors, mass: Product, against: Sequence[Block] = ()) -> Block:
    """Return a mass-orthonormal basis of what `x` adds to `against`, and its product with the mass.

    Parameters
    ----------
    x : (n, k)
        Vectors.
    mass : callable
        Product with the mass matrix.
    against : sequence of ((n, m), (n, m))
        Vectors that are mass-orthonormal, all blocks together, and their products with the mass matrix.

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
        for basis, mass_basis in against:
            part = mass_basis.T @ x
            x -= basis @ part
            mass_x -= mass_basis @ part
        values, vectors = la.eigh(x.T @ mass_x)
        keep = values > 1e-14 * max(values[-1], 1.0)
        turn = vectors[:, keep] / np.sqrt(values[keep])
        x, mass_x = x @ turn, mass_x @ turn
    return x, mass_x


def lowest_modes(
    solve: Product,
    mass: Product,
    shift: float,
    start: Vectors,
    n_mode: int,
    tolerance: float,
    known: Sequence[Block] = (),
    min_steps: int = 2,
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
    known : sequence of ((n, m), (n, m))
        Modes known beforehand, such as rigid-body motion: mass-orthonormal, with their products with the
        mass matrix. The modes sought are those besides them.
    min_steps : int
        Steps at least. A start that holds some modes exactly and others hardly at all seems converged before
        the others have come up.

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
        The model has fewer modes, its numbers overflow, or there is no convergence within 40 steps.
    """
    blocks = [orthonormalize(start, mass, known)]
    projected = np.zeros((0, 0))
    before = np.zeros(0)
    for step in range(1, _MAX_STEPS + 1):
        image = solve(blocks[-1][1])
        projected = _grown(projected, np.vstack([mass_basis.T @ image for _, mass_basis in blocks]))
        inverse, vectors = la.eigh(projected)
        now = 1.0 / inverse[::-1][:n_mode]
        steady = now.size == n_mode == before.size and np.all(np.abs(now - before) <= tolerance * now)
        if (steady and step >= min_steps) or _exhausted(blocks, image, mass, known, n_mode - now.size):
            return now - shift, _combined(blocks, vectors[:, ::-1][:, : start.shape[1]])
        before = now
    message = f"the {n_mode} lowest modes did not converge in {_MAX_STEPS} steps"
    raise SolveError(message)


def _exhausted(
    blocks: list[Block], image: Vectors, mass: Product, known: Sequence[Block], missing: int
) -> bool:
    """Add what an image has beyond the blocks to them, and tell whether that is nothing: the space is invariant.

    Raises
    ------
    SolveError
        It is, and modes are still missing.
    """
    n = sum(basis.shape[1] for basis, _ in blocks)
    blocks.append(orthonormalize(image, mass, [*known, *blocks]))
    if blocks[-1][0].shape[1]:
        return False
    if missing > 0:
        message = f"the model has no more than {n} modes; ask for fewer, or refine its mesh"
        raise SolveError(message)
    return True


def _grown(projected: Vectors, coupling: Vectors) -> Vectors:
    """Return a projected matrix with the rows and columns of one more block.

    Raises
    ------
    SolveError
        The numbers overflow.
    """
    known, size = projected.shape[0], coupling.shape[0]
    grown = np.zeros((size, size))
    grown[:known, :known] = projected
    grown[:, known:] = coupling
    grown[known:] = coupling.T
    grown = (grown + grown.T) / 2.0
    if not np.isfinite(grown).all():
        message = "the model's numbers overflow; check the size of its stiffnesses, of contact above all"
        raise SolveError(message)
    return grown


def _combined(blocks: Sequence[Block], weight: Vectors) -> Vectors:
    """Return the sum of the blocks' vectors, each times its rows of `weight`."""
    parts = np.split(weight, np.cumsum([basis.shape[1] for basis, _ in blocks])[:-1])
    return np.asarray(sum(basis @ part for (basis, _), part in zip(blocks, parts, strict=True)))


def inverse_iterated(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve for one step of inverse iteration, also where the shift is an eigenvalue to the last digit.

    Parameters
    ----------
    matrix : (n, n)
        The shifted matrix, symmetric.
    right : (n,)
        Mass times the last vector.

    Returns
    -------
    (n,)
        x with right' x = 1 and matrix x along `right`; the border of that condition keeps a singular matrix solvable.
    """
    bordered, size = _bordered(matrix, right)
    return np.asarray(la.lu_solve(la.lu_factor(bordered), np.append(np.zeros(right.size), size))[:-1])


def orthogonal_answers(
    matrix: NDArray[np.float64], border: NDArray[np.float64], load: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve with a matrix that is singular along one mode, for what is orthogonal to that mode.

    Parameters
    ----------
    matrix : (n, n)
        The matrix shifted by the mode's eigenvalue, symmetric.
    border : (n,)
        Mass times the mode.
    load : (n, k)
        Right-hand sides; what of them lies along `border` is left out.

    Returns
    -------
    (n, k)
        x with border' x = 0.
    """
    bordered, _ = _bordered(matrix, border)
    right = np.vstack([load, np.zeros(load.shape[1])])
    return np.asarray(la.lu_solve(la.lu_factor(bordered), right)[:-1])


def _bordered(matrix: NDArray[np.float64], border: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return a symmetric matrix with one more row and column of its own size, and their factor to `border`."""
    n, size = border.size, float(np.abs(matrix).max() / np.abs(border).max())
    bordered = np.zeros((n + 1, n + 1))
    bordered[:n, :n], bordered[:n, n], bordered[n, :n] = matrix, size * border, size * border
    return bordered, size
