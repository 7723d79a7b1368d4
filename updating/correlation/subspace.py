"""Close modes as subspaces: principal angles, clusters of near frequencies, rotation within a cluster.

Where two natural frequencies nearly coincide, the smallest change of the structure turns their shapes within the plane
that they span. The plane is what measurement and model can have in common, the single shapes are not (D'Ambrogio and
Fregolent, Mech. Syst. Signal Process. 17, 2003, extend the MAC this way).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

CLOSE = 0.03
"""Relative gap of neighbouring frequencies below which modes count as close: an error of 6 % in stiffness closes it."""


def clusters(frequency: ArrayLike, close: float = CLOSE) -> tuple[NDArray[np.int64], ...]:
    """Split modes into clusters whose neighbours lie less than a relative gap apart.

    Parameters
    ----------
    frequency : (n_mode,) array_like
        Natural frequencies in any order, Hz; infinite ones stay alone.
    close : float
        Largest relative gap within a cluster.

    Returns
    -------
    tuple of (n,) int
        Column numbers, each cluster ascending in frequency; a mode alone is a cluster of one.
    """
    values = np.asarray(frequency, dtype=float)
    order = np.argsort(values, kind="stable")
    ascending = values[order]
    with np.errstate(invalid="ignore"):
        apart = ~(np.diff(ascending) <= close * ascending[1:])
    return tuple(part.astype(np.int64) for part in np.split(order, np.flatnonzero(apart) + 1) if part.size)


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
