"""One-to-one pairing of measured and model modes by the modal assurance criterion (MAC).

What the MAC leaves open is settled by subspaces, where frequencies are close, and by mass cross-orthogonality,
frequency and damping, where several modes look alike at the measured points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ema.modal.configurations import CLOSE, clusters
from ema.modal.mac import mac
from ema.types.modal_model import ModalModel
from lamella_shared import Complexes, Integers, Reals, arrays
from model import Modes
from updating.correlation.registration import pseudo_orthogonality, visible
from updating.errors import PairingError

MARGIN = 0.05
"""Difference of MAC below which frequency, damping and cross-orthogonality may decide instead."""

N_MODE = 22
"""Modes of the model that are solved for pairing, the six rigid-body modes included."""
LEAST_MAC = 0.8
"""Smallest MAC that makes a pair of modes where nothing else is asked for."""


class ModeSet(Protocol):
    """What pairing needs to know of modes, measured or modelled."""

    @property
    def frequency(self) -> Reals:
        """Natural frequencies (n_mode,), Hz."""

    @property
    def damping(self) -> Reals:
        """Damping ratios (n_mode,)."""

    @property
    def shape(self) -> NDArray[np.inexact]:
        """Mode shapes (n_dof, n_mode)."""

    @property
    def node(self) -> Integers:
        """Point number of each DOF (n_dof,)."""

    @property
    def direction(self) -> Reals:
        """Direction of each DOF (n_dof, 3)."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any any": "mac", "n": "measured model subspace subspace_mac", "any": "unpaired_measured unpaired_model"})
class Pairing:
    """Which measured mode belongs to which mode of the model.

    Attributes
    ----------
    mac : (n_measured, n_model) float
        MAC of every measured mode with every mode of the model.
    measured, model : (n_pair,) int
        Column numbers of the paired modes, ascending in the measured ones.
    unpaired_measured, unpaired_model : (n,) int
        Column numbers of those left over.
    threshold : float
        Smallest MAC that makes a pair.
    subspace : (n_pair,) int
        Pairs with the same number belong together only as a whole: close modes that are mixed differently in
        measurement and model. Which of them goes with which then means little.
    subspace_mac : (n_pair,) float
        MAC of the worst direction of that subspace; the pair's own MAC where it stands alone.
    """

    mac: Reals
    measured: Integers
    model: Integers
    unpaired_measured: Integers
    unpaired_model: Integers
    threshold: float
    subspace: Integers
    subspace_mac: Reals

    @property
    def paired_mac(self) -> Reals:
        """MAC of each pair (n_pair,)."""
        return self.mac[self.measured, self.model]

    def partners(self, measured: ModeSet, model: ModeSet) -> Complexes:
        """Return the model's shape of each pair, (n_dof, n_pair), those of a subspace turned onto the measured ones."""
        shape = np.array(model.shape[:, self.model], dtype=complex)
        for number in np.unique(self.subspace):
            inside = self.subspace == number
            if np.count_nonzero(inside) > 1:
                shape[:, inside] = rotate_onto(shape[:, inside], measured.shape[:, self.measured[inside]])
        return shape


def pair(measured: ModeSet, model: ModeSet, *, threshold: float = LEAST_MAC) -> Pairing:
    """Pair modes one to one by an assignment over the whole MAC matrix.

    Each pair scores its MAC plus at most `MARGIN` for how well frequency, damping and mass cross-orthogonality fit. So
    the shapes decide wherever they differ by more than the margin. A frequency or damping error that all modes
    share does not count. Damping fits by 4 d_1 d_2 / (d_1 + d_2)**2 and frequency by a Lorentzian, the factors of
    MACXP (see `macxp.macxp`), with the half-power bandwidth widened to what a model before its fit may be off.
    Cross-orthogonality counts only where the model's shapes are independent enough at the measured points.

    Modes that this leaves over are paired with the spans of close modes (`clusters`), as a whole: where
    frequencies nearly meet, measurement and model may mix the same modes differently.

    Parameters
    ----------
    measured, model : ModeSet
        Modes on the same DOFs in the same order; the model's shapes mass-normalised.
    threshold : float
        Pairs whose MAC, and whose subspace's MAC, lie below it are dissolved and listed as unpaired.

    Raises
    ------
    PairingError
        The two do not have the same DOFs.
    """
    _require_same_dofs(measured, model)
    value = mac(measured.shape, model.shape)
    seen = visible(model.shape)
    value_seen = np.where(seen, value, 0.0)
    bonus = MARGIN * _tie_breaker(measured, model, value_seen, threshold)
    row, column = _assign(value_seen, bonus, threshold)

    groups = clusters(measured.frequency), clusters(np.where(seen, model.frequency, np.inf))
    left = np.ones(value.shape, dtype=bool)
    left[row], left[:, column] = False, False
    likeness = np.where(left & seen, _span_likeness(measured.shape, model.shape, groups), 0.0)
    more = _assign(likeness, bonus, threshold)
    row, column = np.concatenate([row, more[0]]), np.concatenate([column, more[1]])
    order = np.argsort(row)
    row, column = row[order], column[order]

    return _by_subspace(measured, model, _Scores(value, bonus, threshold), row, column, groups)


@dataclass(frozen=True, eq=False)
class _Scores:
    """MAC of all pairs, what may decide beside it, and the MAC that makes a pair."""

    mac: Reals
    bonus: Reals
    threshold: float


def _by_subspace(
    measured: ModeSet, model: ModeSet, scores: _Scores, row: Integers, column: Integers, groups: Groups
) -> Pairing:
    """Return the pairs that stand alone or, where close modes are mixed, as parts of a common subspace."""
    value, threshold = scores.mac, scores.threshold
    linked = _linked(cluster_of(groups[0], value.shape[0])[row], cluster_of(groups[1], value.shape[1])[column])
    whole = np.zeros(row.size, dtype=bool)  # paired as part of a subspace
    common = np.zeros(row.size)
    for number in np.unique(linked):
        inside = np.flatnonzero(linked == number)
        weak = inside[value[row[inside], column[inside]] < threshold]
        if weak.size:
            among = (value + scores.bonus)[np.ix_(row[weak], column[weak])]
            column[weak] = column[weak][scipy.optimize.linear_sum_assignment(among, maximize=True)[1]]
            whole[inside] = True
            common[inside] = _common_subspace(measured.shape, model.shape, row[inside], column[inside], groups)
    likeness = value[row, column]
    whole &= common >= threshold
    kept = whole | (likeness >= threshold)
    row, column, whole = row[kept], column[kept], whole[kept]
    subspace = np.unique(np.where(whole, linked[kept], value.size + row), return_inverse=True)[1]
    return Pairing(
        mac=value,
        measured=row,
        model=column,
        unpaired_measured=np.setdiff1d(np.arange(value.shape[0]), row),
        unpaired_model=np.setdiff1d(np.arange(value.shape[1]), column),
        threshold=threshold,
        subspace=subspace,
        subspace_mac=np.where(whole, common[kept], likeness[kept]),
    )


Groups = tuple[tuple[Integers, ...], tuple[Integers, ...]]
"""Clusters of close modes, of the measurement and of the model."""


def require_points(measured: ModalModel) -> None:
    """Refuse modes whose shapes cannot be resolved because there are more modes than degrees of freedom.

    Raises
    ------
    PairingError
        The message says how many of each there are.
    """
    n_dof, n_mode = measured.shape.shape
    if n_dof < n_mode:
        raise PairingError(
            f"{measured.name}: {n_mode} modes were measured at {n_dof} degrees of freedom, too few to resolve their "
            "shapes; measure at more points, or narrow band_Hz under [identification]"
        )


def _assign(likeness: Reals, bonus: Reals, threshold: float) -> tuple[Integers, Integers]:
    """Return rows and columns of the assignment of the largest sum, without those below the threshold."""
    allowed = likeness >= threshold
    row, column = scipy.optimize.linear_sum_assignment(np.where(allowed, likeness + bonus, 0.0), maximize=True)
    kept = allowed[row, column]
    return row[kept], column[kept]


def _span_likeness(measured: NDArray[np.inexact], model: NDArray[np.inexact], groups: Groups) -> Reals:
    """Return the MAC of every mode with the span of every cluster on the other side, (n_measured, n_model)."""
    likeness = np.zeros((measured.shape[1], model.shape[1]))
    for group in groups[1]:
        if group.size > 1:
            likeness[:, group] = span_mac(measured, model[:, group])[:, None]
    for group in groups[0]:
        if group.size > 1:
            likeness[group] = np.maximum(likeness[group], span_mac(model, measured[:, group]))
    return likeness


def _common_subspace(
    measured: NDArray[np.inexact], model: NDArray[np.inexact], row: Integers, column: Integers, groups: Groups
) -> float:
    """Return the worst MAC of the paired modes of one side in the span of those and their cluster of the other."""
    with_mates = [
        np.unique(np.concatenate([group for group in side if np.isin(group, inside).any()]))
        for side, inside in zip(groups, (row, column), strict=True)
    ]
    return max(
        float(subspace_mac(measured[:, row], model[:, with_mates[1]])[-1]),
        float(subspace_mac(measured[:, with_mates[0]], model[:, column])[-1]),
    )


def _linked(first: Integers, second: Integers) -> Integers:
    """Return one number for all pairs that share a cluster on either side, directly or through others."""
    n_first, n_second = int(first.max(initial=-1)) + 1, int(second.max(initial=-1)) + 1
    size = n_first + n_second
    graph = sp.coo_array((np.ones(first.size), (first, n_first + second)), shape=(size, size))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1][first], dtype=np.int64)


def _tie_breaker(measured: ModeSet, model: ModeSet, value: Reals, threshold: float) -> Reals:
    """Return how well frequency, damping and mass cross-orthogonality of every two modes fit, from 0 to 1."""
    # of the model's shapes at the measured points: above it their mass says nothing new
    worst_condition = 20.0
    frequency_scatter = 0.1  # relative error of model frequencies beyond the error that all share
    shift_free = [
        _without_common_factor(np.log(_ratio(getattr(model, name), getattr(measured, name))), value, threshold)
        for name in ("frequency", "damping")
    ]
    frequency = 1.0 / (1.0 + (shift_free[0] / frequency_scatter) ** 2)
    damping = 1.0 / np.cosh(shift_free[1] / 2.0) ** 2
    fit = frequency * damping
    cross, condition = pseudo_orthogonality(measured.shape, model.shape)
    return (fit + cross**2) / 2.0 if condition <= worst_condition else fit


def _ratio(model: Reals, measured: Reals) -> Reals:
    """Return model over measured for every two modes, 1 where one of them has no value."""
    positive = (measured[:, None] > 0.0) & (model > 0.0)
    return np.divide(model, measured[:, None], out=np.ones(positive.shape), where=positive)


def _without_common_factor(logarithm: Reals, value: Reals, threshold: float) -> Reals:
    """Subtract the median over the pairs that the MAC alone makes certain."""
    rank_row, rank_column = np.sort(value, axis=1), np.sort(value, axis=0)
    rival = np.maximum(
        rank_row[:, -2:-1] if value.shape[1] > 1 else 0.0, rank_column[-2:-1] if value.shape[0] > 1 else 0.0
    )
    certain = (value >= threshold) & (value > rival + MARGIN)
    return logarithm - np.median(logarithm[certain]) if certain.any() else logarithm


def _require_same_dofs(measured: ModeSet, model: ModeSet) -> None:
    if measured.node.size != model.node.size or np.any(measured.node != model.node):
        raise PairingError(
            f"modes on different DOFs cannot be paired: {measured.node.size} measured, {model.node.size} in the "
            "model. Sample the model at the measured DOFs (updating.register) first."
        )
    alignment = np.sum(measured.direction * model.direction, axis=1)
    if np.any(alignment < 1 - 1e-6):
        wrong = [int(n) for n in measured.node[alignment < 1 - 1e-6]]
        raise PairingError(f"measured and modelled directions differ at points {wrong}")


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"row mode": "column frequency cross_orthogonality"})
class Track:
    """Modes followed over the steps of a parameter.

    Attributes
    ----------
    column : (n_step, n_mode) int
        Which mode of each step is the continuation of mode `i` of the first.
    frequency : (n_step, n_mode) float
        Natural frequencies along each track, Hz.
    cross_orthogonality : (n_step, n_mode) float
        With the step before, within a cluster of close modes after turning it; 1 for the first step. A small
        value says that the step was too long or that the mode left the modes that were solved for.
    """

    column: Integers
    frequency: Reals
    cross_orthogonality: Reals


def track(steps: Sequence[Modes], mass: ArrayLike, *, n_mode: int, close: float = CLOSE) -> Track:
    """Follow the lowest modes of the first step through all others.

    Parameters
    ----------
    steps : sequence of Modes
        Elastic modes of one reduced system at consecutive values of a parameter, a few more of them than shall be
        followed, since others may cross from above.
    mass : (n, n) array_like
        Reduced mass matrix, ``system.matrix("M", theta)``.
    n_mode : int
        Number of modes to follow.
    close : float
        Relative gap below which neighbouring modes may be mixtures of each other.

    Raises
    ------
    PairingError
        A step has fewer modes than are to be followed.
    """
    for i, step in enumerate(steps):
        if step.frequency.size < n_mode:
            raise PairingError(
                f"step {i} has {step.frequency.size} modes, but {n_mode} are to be followed; solve for more"
            )
    matrix = np.asarray(mass, dtype=float)
    followed = np.array(steps[0].coordinate[:, :n_mode])
    columns, values = [np.arange(n_mode)], [np.ones(n_mode)]
    for step in steps[1:]:
        turned = _turned(step, followed, matrix, close)
        likeness = cross_orthogonality(followed, turned, matrix)
        column = scipy.optimize.linear_sum_assignment(likeness**2, maximize=True)[1]
        columns.append(column)
        values.append(likeness[np.arange(n_mode), column])
        followed = turned[:, column]
    column = np.array(columns)
    frequency = np.array([step.frequency[c] for step, c in zip(steps, column, strict=True)])
    return Track(column=column, frequency=frequency, cross_orthogonality=np.array(values))


def _turned(step: Modes, followed: Reals, mass: Reals, close: float) -> Reals:
    """Return the modes of a step, each cluster turned onto the followed modes that lie most in its span."""
    turned = np.array(step.coordinate)
    for group in clusters(step.frequency, close):
        if group.size == 1:
            continue
        inside = cross_orthogonality(followed, turned[:, group], mass)
        nearest = np.argsort(-np.sum(inside**2, axis=1))[: group.size]
        if nearest.size == group.size:
            root = np.linalg.cholesky(mass).T
            rotation = rotate_onto(root @ turned[:, group], root @ followed[:, nearest])
            alike = np.abs((root @ turned[:, group]).T @ rotation)
            order = scipy.optimize.linear_sum_assignment(alike, maximize=True)[1]
            turned[:, group] = np.linalg.solve(root, rotation[:, order])
    return turned


def subspace_mac(a: ArrayLike, b: ArrayLike) -> Reals:
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


def span_mac(shape: ArrayLike, span: ArrayLike) -> Reals:
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


def cluster_of(groups: Sequence[Integers], n_mode: int) -> Integers:
    """Return the number of the cluster of each mode, (n_mode,)."""
    number = np.zeros(n_mode, dtype=np.int64)
    for i, group in enumerate(groups):
        number[group] = i
    return number


def _span(shape: ArrayLike) -> NDArray[Any]:
    """Return an orthonormal basis of the span of some columns, each counted without its length."""
    columns = np.asarray(shape)
    return la.orth(columns / np.linalg.norm(columns, axis=0))


def poles(frequency: ArrayLike, damping: ArrayLike) -> Complexes:
    """Poles, rad/s, of undamped natural frequencies (Hz) and damping ratios."""
    omega, ratio = 2.0 * np.pi * np.asarray(frequency, dtype=float), np.asarray(damping, dtype=float)
    return omega * (-ratio + 1j * np.sqrt(1.0 - ratio**2))


def macxp(a: ArrayLike, pole_a: ArrayLike, b: ArrayLike, pole_b: ArrayLike) -> Reals:
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


def cross_orthogonality(a: ArrayLike, b: ArrayLike, mass: ArrayLike) -> Reals:
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
