"""Roots of a polynomial that is like one whose roots are known, as those of neighbouring model orders are.

All roots are improved at once by the method of Ehrlich and Aberth (O. Aberth, Math. Comp. 27, 1973), Newton's step with
the other roots divided out, which ends at single roots with cubic speed. From the roots of the order before it takes a
few steps of n**2 products, an eigenvalue solution some ten times n**3. What does not end, or does not have the sum that
the coefficients tell, is left to that.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_ROUNDS = 40
_ENDED = 1e-14  # relative step of a root that has settled
_ROUNDING = 1e-9  # relative step below which one that does not shrink is rounding
_SUM = 1e-9  # error of the sum of all roots, relative to the sum of their sizes


def nearby_roots(coefficient: NDArray[Any], known: NDArray[np.complex128]) -> NDArray[np.complex128] | None:
    """Return the roots of ``z**n + sum_k coefficient[k] z**k``, ``(n,)``, or None where they must be found otherwise.

    Parameters
    ----------
    coefficient : (n,) float or complex
    known : (n_known,) complex
        Where roots are sought, at most n; further ones begin between them around the unit circle.
    """
    n = coefficient.size
    root = np.concatenate([known, _between(known, n - known.size)])
    ascending = np.append(coefficient, 1.0).astype(complex)
    power = np.arange(n + 1)
    # Inside the unit circle the polynomial, outside of it the reversed one, so that no power overflows.
    rows = [ascending, np.roll(ascending * power, -1), ascending[::-1], np.roll(ascending[::-1] * power, -1)]
    table = np.stack(rows, axis=1)
    active, before = np.arange(n), np.full(n, np.inf)
    for _ in range(_ROUNDS):
        step = _steps(table, root, active)
        if not np.all(np.isfinite(step)):
            return None
        root[active] -= step
        size = np.abs(step) / np.maximum(np.abs(root[active]), np.finfo(float).tiny)
        settled = (size < _ENDED) | ((size < _ROUNDING) & (size > 0.5 * before[active]))
        before[active] = size
        active = active[~settled]
        if not active.size:
            break
    off = abs(root.sum() + coefficient[-1])
    return None if active.size or off > _SUM * np.abs(root).sum() else root


def _steps(
    table: NDArray[np.complex128], root: NDArray[np.complex128], active: NDArray[np.int64]
) -> NDArray[np.complex128]:
    """Return the step of each active root."""
    z, n = root[active], len(table) - 1
    with np.errstate(all="ignore"):  # what is not finite is seen by the caller
        outside = np.abs(z) > 1.0
        base = np.where(outside, 1.0 / z, z)
        value, slope, turned, turned_slope = (_powers(base, n) @ table).T
        newton = np.where(outside, z * turned / (n * turned - base * turned_slope), value / slope)
        gap = z[:, None] - root
        gap[np.arange(z.size), active] = np.inf
        return np.asarray(newton / (1.0 - newton * (1.0 / gap).sum(axis=1)))


def _powers(base: NDArray[np.complex128], n: int) -> NDArray[np.complex128]:
    """Return powers 0 to n, ``(n_base, n + 1)``."""
    power = np.ones((base.size, n + 1), dtype=complex)
    done, factor = 1, base[:, None]
    while done <= n:
        more = min(done, n + 1 - done)
        power[:, done : done + more] = power[:, :more] * factor
        done, factor = done + more, factor * factor
    return power


def _between(known: NDArray[np.complex128], n: int) -> NDArray[np.complex128]:
    """Return places in the widest gaps of known roots around the unit circle, none of them real."""
    angle = np.sort(np.angle(known))
    gap = np.diff(angle, append=angle[0] + 2.0 * np.pi)
    widest = np.argsort(-gap)[:n]
    return np.asarray(1.01 * np.exp(1j * (angle[widest] + 0.5 * gap[widest] + 1e-3)))
