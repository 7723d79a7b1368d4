"""Physical poles among those of all model orders (LSCF), without any frequency guess.

Roots: all roots of a polynomial like one whose roots are known are improved at once by the method of Ehrlich and
Aberth (O. Aberth, Math. Comp. 27, 1973), Newton's step with the other roots divided out, which ends at single roots
with cubic speed. From the roots of the order before it takes a few steps of n**2 products, an eigenvalue solution some
ten times n**3. What does not end, or does not have the sum that the coefficients tell, is left to that.

Poles, by the least-squares complex-frequency method (LSCF): a common matrix denominator ``A`` and one numerator
``B_o`` for each output, polynomials in ``z = exp(-i theta)``, are fitted to ``H_o(f) A(z) = B_o(z)`` in the
least-squares sense. The numerators are eliminated output by output, which leaves the reduced normal equations

    D a = 0,   D = sum_o (T_o - S_o^H R^-1 S_o)

(Guillaume et al., A poly-reference implementation of the least-squares complex frequency-domain estimator,
IMAC XXI, 2003, eqs. 8-16). All blocks are Toeplitz, so that one set of Fourier sums fills the equations of
the highest order. The equations of every lower order are leading blocks in which the elimination uses fewer
rows of ``R^-1/2 S_o``; one Cholesky factor of ``R`` and one running sum therefore serve all orders.

The coefficient of the highest power is fixed to the identity, which drives the computational poles into the
unstable half-plane (Cauberghe, Guillaume, Verboven, Parloo and Vanlanduit, J. Sound Vib. 2005).

Clusters: a physical pole comes back at every order above some first one; a computational pole wanders. Poles of
neighbouring orders are linked one to one, so that two close modes stay two, and frequency and damping are
always compared within one pair of poles. A chain of links over enough orders is a cluster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ema.identification.functions import MAX_DAMPING, PartBand, part_bands
from ema.modal.mac import cmif
from ema.types.errors import IdentificationError
from ema.types.frf import FRF
from lamella_shared import Booleans, Complexes, Integers, Reals, arrays


def nearby_roots(
    coefficient: NDArray[Any],
    known: Complexes,
    *,
    ended: float = 1e-14,
    rounding: float = 1e-9,
    sum_error: float = 1e-9,
    rounds: int = 40,
) -> Complexes | None:
    """Return the roots of ``z**n + sum_k coefficient[k] z**k``, ``(n,)``, or None where they must be found otherwise.

    Parameters
    ----------
    coefficient : (n,) float or complex
    known : (n_known,) complex
        Where roots are sought, at most n; further ones begin between them around the unit circle.
    ended : float
        Relative step of a root that has settled.
    rounding : float
        Relative step below which one that does not shrink is rounding.
    sum_error : float
        Error of the sum of all roots, relative to the sum of their sizes.
    rounds : int
        Most steps.
    """
    n = coefficient.size
    root = np.concatenate([known, _between(known, n - known.size)])
    ascending = np.append(coefficient, 1.0).astype(complex)
    power = np.arange(n + 1)
    # Inside the unit circle the polynomial, outside of it the reversed one, so that no power overflows.
    rows = [ascending, np.roll(ascending * power, -1), ascending[::-1], np.roll(ascending[::-1] * power, -1)]
    table = np.stack(rows, axis=1)
    active, before = np.arange(n), np.full(n, np.inf)
    for _ in range(rounds):
        step = _steps(table, root, active)
        if not np.all(np.isfinite(step)):
            return None
        root[active] -= step
        size = np.abs(step) / np.maximum(np.abs(root[active]), np.finfo(float).tiny)
        settled = (size < ended) | ((size < rounding) & (size > 0.5 * before[active]))
        before[active] = size
        active = active[~settled]
        if not active.size:
            break
    off = abs(root.sum() + coefficient[-1])
    return None if active.size or off > sum_error * np.abs(root).sum() else root


def _steps(table: Complexes, root: Complexes, active: Integers) -> Complexes:
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


def _powers(base: Complexes, n: int) -> Complexes:
    """Return powers 0 to n, ``(n_base, n + 1)``."""
    power = np.ones((base.size, n + 1), dtype=complex)
    done, factor = 1, base[:, None]
    while done <= n:
        more = min(done, n + 1 - done)
        power[:, done : done + more] = power[:, :more] * factor
        done, factor = done + more, factor * factor
    return power


def _between(known: Complexes, n: int) -> Complexes:
    """Return places in the widest gaps of known roots around the unit circle, none of them real."""
    angle = np.sort(np.angle(known))
    gap = np.diff(angle, append=angle[0] + 2.0 * np.pi)
    widest = np.argsort(-gap)[:n]
    return np.asarray(1.01 * np.exp(1j * (angle[widest] + 0.5 * gap[widest] + 1e-3)))


def lscf_poles(frequency: Reals, value: Complexes, order: int, scale: Reals | None = None) -> list[Complexes]:
    """Return the upper half-plane poles of every model order up to `order`.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Frequency lines, Hz, ascending. Where they begin near 0 Hz (below 2 % of the last line) the
        coefficients are real and the lines are mapped on half the unit circle, so that every pole comes with
        its conjugate. Else the lines are mapped on the full circle with complex coefficients, so that a
        narrow band far from 0 Hz is as well conditioned as a full one.
    value : (n_output, n_reference, n_frequency) complex
        Functions to fit; the references share the matrix denominator.
    order : int
        Highest model order, the number of poles in the band per reference.
    scale : (n_output, n_reference) float, optional
        What each function is divided by, so that none dominates; each weighs as it is where not given.

    Returns
    -------
    list of (n_pole,) complex
        Entry ``k`` holds the poles of order ``k + 1``, rad/s, ``Im > 0``, computational ones included.

    Raises
    ------
    IdentificationError
        Fewer lines than unknowns, or a value that is not finite.
    """
    half = bool(frequency[0] <= 0.02 * frequency[-1])
    step = 2 if half else 1  # powers of z that an order adds: real coefficients have every pole with its conjugate
    _check(frequency, value, order, step)
    circle = _Circle.of(frequency, half=half)
    theta = circle.angle(frequency)
    poles = []
    root = np.empty(0, dtype=complex)
    scale = np.ones(value.shape[:2]) if scale is None else scale
    weight = circle.weight(theta)
    for coefficient in _denominators(theta, weight, value, scale, step * order, step, real=half):
        root = _roots(coefficient, root)
        pole = circle.pole(root)
        poles.append(pole[pole.imag > 0.0])
    return poles


def _check(frequency: Reals, value: Complexes, order: int, step: int) -> None:
    """Refuse values that are not finite, and fewer lines than unknowns."""
    n_output, n_reference, n_frequency = value.shape
    if not np.all(np.isfinite(value)):
        raise IdentificationError("LSCF needs finite values; a function holds NaN or infinity")
    if n_output * n_frequency * step < (step * order + 1) * (n_output + n_reference):
        raise IdentificationError(
            f"order {order} needs more lines than the {n_frequency} in "
            f"{frequency[0]:g}-{frequency[-1]:g} Hz: lower the order or widen the band"
        )


@dataclass(frozen=True, kw_only=True)
class _Circle:
    """The unit circle that lines are mapped on: `half` of it from 0 Hz on, or all of it."""

    half: bool
    origin: float  # frequency at z = 1, Hz
    span: float  # of the whole circle, Hz

    @classmethod
    def of(cls, frequency: Reals, *, half: bool) -> _Circle:
        """Return the circle of which lines fill half or all."""
        first, last, n_frequency = float(frequency[0]), float(frequency[-1]), frequency.size
        if half:
            return cls(half=True, origin=0.0, span=2.0 * last)
        return cls(half=False, origin=first, span=(last - first) * n_frequency / (n_frequency - 1))

    def angle(self, frequency: Reals) -> Reals:
        """Return the angles of lines, rad."""
        return 2.0 * np.pi * (frequency - self.origin) / self.span

    def weight(self, theta: Reals) -> Reals:
        """Return what lines count: one at 0 or pi of the half circle is its own conjugate, the others count twice."""
        return np.where(np.isclose(np.sin(theta), 0.0, atol=1e-12) & self.half, 0.5, 1.0)

    def pole(self, root: Complexes) -> Complexes:
        """Return the poles, rad/s, of roots in z."""
        logarithm = -np.log(root)
        if not self.half:
            # The band fills the whole circle, so its upper half belongs to angles from pi to 2 pi.
            logarithm.imag %= 2.0 * np.pi
        return np.asarray(logarithm * self.span + 2j * np.pi * self.origin)


def _denominators(
    theta: Reals,
    weight: Reals,
    value: Complexes,
    scale: Reals,
    degree: int,
    step: int,
    *,
    real: bool,
    at_once: int = 1 << 18,
) -> list[NDArray[Any]]:
    """Solve for the denominators ``(k, m, m)`` of every degree ``k``, the monic coefficient left out.

    `at_once`: values of functions that are summed over at once.
    """
    n_output, m, n_frequency = value.shape
    size = degree + 1
    kernel = np.exp(1j * np.outer(np.arange(size), theta))
    cross_power, lags = np.zeros((m, m, n_frequency), complex), []
    few = max(1, at_once // (m * n_frequency))
    for first in range(0, n_output, few):
        some = value[first : first + few] / scale[first : first + few, :, None]
        weighted = some * weight
        lags.append(_lags(kernel, weighted.reshape(-1, n_frequency), real=real))
        cross_power += np.einsum("oaf,obf->abf", weighted.conj(), some, optimize=True)
    data, power = np.concatenate(lags, axis=1), cross_power.reshape(m * m, n_frequency)
    regression = _lags(kernel, weight[None].astype(complex), real=real)[size - 1 :, 0]
    response = _lags(kernel, power, real=real).reshape(-1, m, m)

    # Entry (j, k) of every Toeplitz block is the sum of lag j - k.
    index = np.arange(size)[:, None] - np.arange(size)[None, :] + degree
    total = response[index].transpose(0, 2, 1, 3).reshape(size * m, size * m)
    factor = _cholesky(scipy.linalg.toeplitz(regression, regression.conj()))
    inverse = scipy.linalg.solve_triangular(factor, np.eye(size), lower=True, check_finite=False)
    # Rows of all outputs stand together, so that each order's are one block of memory.
    outputs = np.arange(n_output)[None, :, None]
    cross = data.reshape(-1, n_output, m).swapaxes(0, 1)[outputs, index[:, None, :]]  # (size, n_output, size, m)
    (multiply,) = scipy.linalg.get_blas_funcs(("trmm",), (inverse, cross))
    # BLAS stores by columns, hence the transposes.
    whitened = multiply(1.0, inverse.T, cross.reshape(size, -1).T, side=1, overwrite_b=True)
    whitened = whitened.T.reshape(size, n_output, size * m)

    explained = np.zeros_like(total)
    row = 0
    coefficients: list[NDArray[Any]] = []
    for k in range(step, degree + 1, step):
        used, free = (k + 1) * m, k * m
        new = whitened[row : k + 1].reshape(-1, size * m)
        explained += new.conj().T @ new
        row = k + 1
        reduced = total[:used, :used] - explained[:used, :used]
        coefficients.append(_solve(reduced[:free, :free], -reduced[:free, free:]).reshape(k, m, m))
    return coefficients


def _lags(kernel: Complexes, value: Complexes, *, real: bool) -> NDArray[Any]:
    """Sum ``value exp(i lag theta)`` over the lines for lags ``-degree..degree``: ``(n_lag, n_row)``."""
    if real:
        even, odd = kernel.real @ value.real.T, kernel.imag @ value.imag.T
        return np.concatenate([(even + odd)[:0:-1], even - odd])
    return np.concatenate([(kernel.conj() @ value.T)[:0:-1], kernel @ value.T])


def _cholesky(matrix: NDArray[Any]) -> NDArray[Any]:
    """Lower Cholesky factor; lines that leave part of the circle empty need a shift of rounding size."""
    try:
        return scipy.linalg.cholesky(matrix, lower=True)
    except scipy.linalg.LinAlgError:
        shift = 1e-13 * np.trace(matrix).real
        return scipy.linalg.cholesky(matrix + shift * np.eye(len(matrix)), lower=True)


def _solve(matrix: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solve, with the minimum-norm answer where exact data leave an over-modelled order singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(matrix, right, rcond=None)[0]


def _roots(coefficient: NDArray[Any], known: Complexes, *, many: int = 30) -> Complexes:
    """Roots of ``det(sum_k coefficient[k] z**k + I z**n)`` as eigenvalues of the block companion matrix.

    The coefficients stand in the first block row, the form that LAPACK reduces fastest. Many roots of one polynomial
    are found from `known` ones, those of the order before.

    `many`: roots from which on those of the order before them save time.
    """
    n, m, _ = coefficient.shape
    if m == 1 and n > many:
        near = nearby_roots(coefficient[:, 0, 0], known)
        if near is not None:
            real = np.abs(near.imag) < 1e-12 * np.abs(near)  # to rounding, which eigenvalues do not have
            return np.where(real & np.isrealobj(coefficient), near.real, near)
    companion = np.zeros((n * m, n * m), dtype=coefficient.dtype, order="F")
    companion[:m] = -coefficient[::-1].transpose(1, 0, 2).reshape(m, n * m)
    companion[np.arange(m, n * m), np.arange((n - 1) * m)] = 1.0
    return scipy.linalg.eigvals(companion, overwrite_a=True, check_finite=False).astype(complex)


MIN_CHAIN = 6
"""Fewest poles in a cluster, or a third of the orders where they are few."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "order pole cluster", "any": "chosen", "line": "frequency", "any line": "indicator"})
class StabilizationDiagram:
    """Poles over model orders and the clusters found among them.

    Attributes
    ----------
    order : (n_pole,) int
        Model order of each pole.
    pole : (n_pole,) complex
        Stable poles (Re < 0) in the band, rad/s.
    cluster : (n_pole,) int
        Cluster that each pole belongs to, -1 where none.
    chosen : (n_cluster,) complex
        Representative pole of each cluster, rad/s, ascending in frequency.
    frequency : (n_frequency,) float
        Lines of the functions, Hz.
    indicator : (n_indicator, n_frequency) float
        Complex mode indicator function, drawn behind the poles.
    """

    order: Integers
    pole: Complexes
    cluster: Integers
    chosen: Complexes
    frequency: Reals
    indicator: Reals

    @property
    def stable(self) -> Booleans:
        """Whether each pole belongs to a cluster, ``(n_pole,)``."""
        return self.cluster >= 0


def highest_order(n_line: int, *, default_order: int = 60) -> int:
    """Return the highest model order where none is asked for: 60, less in bands of few lines."""
    return max(1, min(default_order, n_line // 3))


def stabilization(frf: FRF, *, order: int | None = None) -> StabilizationDiagram:
    """Compute the poles of all orders and cluster them; a band of very many lines is taken in parts (`part_bands`).

    Parameters
    ----------
    frf : FRF
        Functions, cut to the band to identify (`FRF.band`). Where there are more inputs than outputs the
        roles are exchanged: LSCF takes the shorter side as the references.
    order : int, optional
        Highest model order; where not given that of `highest_order`.

    Raises
    ------
    IdentificationError
        Too few lines for the order, or values that are not finite.
    """
    value = frf.value if frf.value.shape[0] >= frf.value.shape[1] else frf.value.swapaxes(0, 1)
    parts = [_of_part(frf.frequency, value, part, order) for part in part_bands(value)]
    first = np.cumsum([0, *(chosen.size for *_, chosen in parts)])
    orders, poles, clusters, chosen = zip(*parts, strict=True)
    numbers = [np.where(cluster >= 0, cluster + n, cluster) for cluster, n in zip(clusters, first, strict=False)]
    return StabilizationDiagram(
        order=np.concatenate(orders),
        pole=np.concatenate(poles),
        cluster=np.concatenate(numbers),
        chosen=np.concatenate(chosen),
        frequency=frf.frequency,
        indicator=_indicator(value),
    )


def _indicator(value: Complexes, *, at_once: int = 1 << 18) -> Reals:
    """Return the complex mode indicator of functions of a mean square of 1.

    `at_once`: values that are worked on at once.
    """
    rms, few = _rms(value)[..., None], max(1, at_once // value[..., 0].size)
    blocks = range(0, value.shape[-1], few)
    return np.concatenate([cmif(value[..., start : start + few] / rms) for start in blocks], axis=-1)


def _rms(value: Complexes) -> Reals:
    """Return the root mean square of each function, (n_output, n_input), 1 of those that are zero."""
    rms = np.array([[np.sqrt(np.mean(np.abs(one) ** 2)) for one in of_output] for of_output in value])
    return np.where(rms > 0.0, rms, 1.0)


def _of_part(
    frequency: Reals, value: Complexes, part: PartBand, order: int | None
) -> tuple[Integers, Complexes, Integers, Complexes]:
    """Return order, pole and cluster of the poles of one part of the band, and the representatives of the clusters."""
    lines = frequency[part.lines]
    order = highest_order(lines.size) if order is None else order
    lower, upper = frequency[part.core.start], frequency[min(part.core.stop, frequency.size - 1)]
    orders: list[Integers] = []
    poles: list[Complexes] = []
    there = value[..., part.lines]
    for k, of_order in enumerate(lscf_poles(lines, there, order, _rms(there)), start=1):
        hertz = np.abs(of_order) / (2.0 * np.pi)
        inside = (hertz >= lower) & (hertz <= upper)
        damped = (of_order.real < 0.0) & (-of_order.real <= MAX_DAMPING * np.abs(of_order))
        kept = np.sort_complex(1j * of_order[inside & damped]) / 1j
        poles.append(kept)
        orders.append(np.full(kept.size, k))
    chain = _chain(poles)
    all_orders, all_poles = np.concatenate(orders), np.concatenate(poles)
    return all_orders, all_poles, *_clusters(all_orders, all_poles, chain, order)


def _chain(poles: list[Complexes], *, link_distance: float = 0.01, max_gap: int = 2) -> Integers:
    """Give each pole the number of its chain, in the order of the concatenated poles.

    `link_distance`: largest distance of linked poles of neighbouring orders over the magnitude of the pole.
    `max_gap`: a chain survives this many orders without its pole.
    """
    numbers: list[Integers] = []
    n_chain = 0
    end_pole = np.empty(0, dtype=complex)  # last pole, its order and number of every chain still alive
    end_order = np.empty(0, dtype=int)
    end_number = np.empty(0, dtype=int)
    for k, current in enumerate(poles):
        alive = k - end_order <= max_gap + 1
        end_pole, end_order, end_number = end_pole[alive], end_order[alive], end_number[alive]
        number = np.full(current.size, -1)
        if current.size and end_pole.size:
            distance = np.abs(current[:, None] - end_pole) / np.abs(current)[:, None]
            nearest_end, nearest_pole = distance.argmin(axis=1), distance.argmin(axis=0)
            mutual = nearest_pole[nearest_end] == np.arange(current.size)
            linked = mutual & (distance[np.arange(current.size), nearest_end] <= link_distance)
            number[linked] = end_number[nearest_end[linked]]
        new = number < 0
        number[new] = n_chain + np.arange(np.count_nonzero(new))
        n_chain += int(np.count_nonzero(new))
        kept = ~np.isin(end_number, number)
        end_pole = np.concatenate([end_pole[kept], current])
        end_order = np.concatenate([end_order[kept], np.full(current.size, k)])
        end_number = np.concatenate([end_number[kept], number])
        numbers.append(number)
    return np.concatenate(numbers)


def _clusters(order: Integers, pole: Complexes, chain: Integers, highest: int) -> tuple[Integers, Complexes]:
    """Clusters are the long chains; one pole stands for each, the median over its upper half of orders."""
    cluster = np.full(pole.size, -1)
    members: list[Integers] = []
    chosen: list[complex] = []
    fewest = min(MIN_CHAIN, -(-highest // 3))
    for number, count in enumerate(np.bincount(chain)):
        if count >= fewest:
            member = np.flatnonzero(chain == number)
            upper = pole[member[order[member] >= np.median(order[member])]]
            members.append(member)
            chosen.append(complex(np.median(upper.real), np.median(upper.imag)))
    rank = np.argsort(np.abs(np.array(chosen, dtype=complex)))
    for position, original in enumerate(rank):
        cluster[members[original]] = position
    return cluster, np.array(chosen, dtype=complex)[rank]
