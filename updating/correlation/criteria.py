"""How alike mode shapes are: node-line classes, MAC of subspaces, MACX, MACXP and cross-orthogonality."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from model import Modes, Observation, Observed, ReducedSystem, Stack, solve_modes


def subspace_mac(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Squared cosines of the principal angles between the spans of two sets of shapes, descending.

    The last one is the MAC of the worst direction: 1 where one span holds the other. For one shape on each side it
    is the MAC. Source: Björck and Golub, Math. Comput. 27, 1973.

    Parameters
    ----------
    a : (n_dof, n_a) array_like
    b : (n_dof, n_b) array_like
        Shapes at the same DOFs, real or complex.

    Returns
    -------
    (min(rank a, rank b),) float
    """
    cosine = la.svdvals(_span(a).conj().T @ _span(b))
    return np.minimum(cosine, 1.0) ** 2


def span_mac(shape: ArrayLike, span: ArrayLike) -> NDArray[np.float64]:
    """MAC of each shape with what comes nearest to it in the span of others.

    Parameters
    ----------
    shape : (n_dof, n_mode) array_like
    span : (n_dof, n_span) array_like

    Returns
    -------
    (n_mode,) float
    """
    vectors = np.asarray(shape)
    inside = _span(span).conj().T @ vectors
    return np.sum(np.abs(inside) ** 2, axis=0) / np.sum(np.abs(vectors) ** 2, axis=0)


def rotate_onto(shape: ArrayLike, target: ArrayLike) -> NDArray[Any]:
    """Turn the shapes of a subspace so that they come as near to a target as a rotation allows.

    Lengths and angles among the columns of `shape` stay (orthogonal Procrustes problem; Schönemann, Psychometrika 31,
    1966), so mass-normalised shapes of equal frequency stay mass-normalised modes.

    Parameters
    ----------
    shape, target : (n, k) array_like
        Each target column is used without its length.

    Returns
    -------
    (n, k)
    """
    source, wanted = np.asarray(shape), np.asarray(target)
    u, _, v = la.svd(source.conj().T @ (wanted / np.linalg.norm(wanted, axis=0)))
    return source @ (u @ v)


def cluster_of(groups: Sequence[NDArray[np.int64]], n_mode: int) -> NDArray[np.int64]:
    """Return the number of the cluster of each mode, (n_mode,)."""
    number = np.zeros(n_mode, dtype=np.int64)
    for i, group in enumerate(groups):
        number[group] = i
    return number


def _span(shape: ArrayLike) -> NDArray[Any]:
    """Return an orthonormal basis of the span of some columns, each counted without its length."""
    columns = np.asarray(shape)
    return la.orth(columns / np.linalg.norm(columns, axis=0))


def poles(frequency: ArrayLike, damping: ArrayLike) -> NDArray[np.complex128]:
    """Poles, rad/s, of undamped natural frequencies (Hz) and damping ratios."""
    omega, ratio = 2.0 * np.pi * np.asarray(frequency, dtype=float), np.asarray(damping, dtype=float)
    return omega * (-ratio + 1j * np.sqrt(1.0 - ratio**2))


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
            raise ValueError(
                f"{name}: MACXP needs decaying modes, but pole {int(np.argmax(pole.real))} is {pole.max():g}"
            )
    same = np.abs(first.conj().T @ second) / np.abs(pole_1.conj()[:, None] + pole_2)
    mirrored = np.abs(first.T @ second) / np.abs(pole_1[:, None] + pole_2)
    norm_1, norm_2 = (
        np.sum(np.abs(s) ** 2, axis=0) / (2.0 * np.abs(p.real)) + np.abs(np.sum(s**2, axis=0)) / (2.0 * np.abs(p))
        for s, p in ((first, pole_1), (second, pole_2))
    )
    return (same + mirrored) ** 2 / np.outer(norm_1, norm_2)


def cross_orthogonality(a: ArrayLike, b: ArrayLike, mass: ArrayLike) -> NDArray[np.float64]:
    """Return abs(a' M b) of vectors brought to unit mass, (n_a, n_b): 1 for the same mode, 0 for different ones.

    ``cross_orthogonality(a, a, mass)`` is the orthogonality check of one set.

    Parameters
    ----------
    a, b : (n, n_a), (n, n_b) array_like
        Modes in the coordinates of `mass`, such as `Modes.coordinate` or `Expansion.coordinate`.
    mass : (n, n) array_like
        Mass matrix, such as ``system.matrix("M", theta)``.
    """
    first, second, matrix = np.asarray(a), np.asarray(b), np.asarray(mass)
    product = matrix @ second
    length_a = np.sqrt(np.sum(first.conj() * (matrix @ first), axis=0).real)
    length_b = np.sqrt(np.sum(second.conj() * product, axis=0).real)
    return np.abs(first.conj().T @ product) / np.outer(length_a, length_b)


CLASS_STATIONS, CLASS_ROWS = 41, 3


def class_grid(stack: Stack) -> Observation:
    """Return the DOFs from which modes are named: w and u, v on stations by rows at mid-height.

    The DOFs are ordered direction (z, x, y), station, row.
    """
    x = np.linspace(-0.5, 0.5, CLASS_STATIONS) * stack.length
    y = np.linspace(-0.5, 0.5, CLASS_ROWS) * stack.width
    location = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    return Observation(
        node=np.arange(3 * len(location)),
        location=np.tile(location, (3, 1)),
        direction=np.repeat(np.eye(3)[[2, 0, 1]], len(location), axis=0),
    )


def shape_classes(modes: Modes) -> tuple[str, ...]:
    """Name each mode sampled on `class_grid`.

    Returns "bending n", "torsion n" (n counts the order from 1), or "other" where the motion at mid-height is mostly in
    the plane of the sheets.
    """
    field = modes.shape.reshape(3, CLASS_STATIONS, CLASS_ROWS, -1)
    names = []
    for r in range(field.shape[-1]):
        w, in_plane = field[0, ..., r], field[1:, ..., r]
        even, odd = w[:, 1], (w[:, -1] - w[:, 0]) / 2
        if np.sum(w**2) < np.sum(in_plane**2):
            names.append("other")
        elif np.sum(even**2) >= np.sum(odd**2):
            names.append(_order("bending", _n_sign_change(even) - 1))
        else:
            names.append(_order("torsion", _n_sign_change(odd)))
    return tuple(names)


def solve_by_class(
    system: ReducedSystem, grid: Observation | Observed, wanted: tuple[str, ...], *, G_f: float, n_mode: int = 22
) -> tuple[Modes, NDArray[np.int64]]:
    """Elastic modes of the model and the column of the lowest mode of each wanted class; -1 where there is none."""
    modes = solve_modes(system, G_f=G_f, d_f=0.0, n_mode=n_mode, observation=grid).elastic()
    names = shape_classes(modes)
    return modes, np.array([names.index(name) if name in names else -1 for name in wanted], np.int64)


def _order(family: str, order: int) -> str:
    return f"{family} {order}" if order > 0 else "other"


def _n_sign_change(values: NDArray[np.float64]) -> int:
    sign = np.sign(values[np.abs(values) > 1e-3 * np.max(np.abs(values))])
    return int(np.count_nonzero(np.diff(sign)))
