"""How well an explanation predicts a mode, or a configuration, that it has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation, free_coordinates
from updating.diagnosis.residual import reweighed, span_of

Vector = NDArray[np.float64]

_FARTHEST = 1.0  # of the logarithm of a frequency: to first order, more says only that a prediction fails
_ROUNDING = 1e-11  # of the squared length of a column
_UNKNOWN = 1e-9  # share of a direction that other data determine, below which they do not


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Errors of what is predicted from all other data.

    Attributes
    ----------
    frequency, damping, shape : float
        Mean relative errors of frequencies and damping ratios, and of shapes the mean length of what is wrong over
        that of the shape; NaN where none can be predicted.
    score : (n_group,) float
        Logarithm of the probability density of each mode, or configuration, given all other data; NaN where these do
        not determine it.
    """

    frequency: float
    damping: float
    shape: float
    score: tuple[float, ...] = ()


def left_out(evidence: Evidence, own: Explanation, by: Literal["mode", "configuration"] = "mode") -> LeftOut:
    """Predict each mode of the stack, in all configurations at once, or each configuration, from all other data.

    To first order nothing has to be fitted again: rows that are left out are rows with a shift of their own, which is
    estimated beside all coordinates and is what the others mispredict them by (Cook and Weisberg 1982). What other
    data do not determine is passed over.

    Parameters
    ----------
    evidence : Evidence
        What was fitted.
    own : Explanation
        The fit; data are weighed with the discrepancy that it leaves.
    by : "mode" or "configuration"
        What is left out at a time.
    """
    evidence = replace(evidence.supposing(own.effects), sizes=own.likeliest)
    found = reweighed(own.residual, evidence)
    free = free_coordinates(evidence, np.concatenate([own.nuisance, own.coordinate]), own.at_bound)
    return mispredicted(evidence, found.value, found.jacobian[:, free], by)


def mispredicted(
    evidence: Evidence, value: Vector, jacobian: Vector, by: Literal["mode", "configuration"] = "mode"
) -> LeftOut:
    """Return `left_out` of a whitened residual (n,) and its derivatives by the coordinates that are free."""
    rows, span = evidence.rows, span_of(jacobian)
    errors: dict[str, list[Vector]] = {"frequency": [], "damping": [], "shape": []}
    score: list[float] = []
    group = rows.mode if by == "mode" else rows.configuration
    for number in np.unique(group):
        out = np.flatnonzero(group == number)
        shift, density = _shift(evidence, value, span, out)
        score.append(density)
        if np.isnan(density):
            continue
        for kind in ("frequency", "damping"):
            off = shift[rows.kind[out] == kind]
            errors[kind].append(np.abs(np.expm1(np.clip(-off, -_FARTHEST, _FARTHEST))))
        errors["shape"].append(_turned(evidence, out, shift))
    found = {kind: np.concatenate(each) if each else np.zeros(0) for kind, each in errors.items()}
    mean = {kind: float(np.mean(each)) if each.size else float("nan") for kind, each in found.items()}
    return LeftOut(**mean, score=tuple(score))


def _turned(evidence: Evidence, out: NDArray[np.intp], shift: Vector) -> Vector:
    """Return the lengths of what shapes of unit length are off by, 1 at most, without what is along them."""
    place = {int(row): i for i, row in enumerate(out)}
    lengths = []
    for key, own in evidence.rows.shape.items():
        if int(own[0]) in place:
            along, off = evidence.unit_shapes[key], shift[[place[int(row)] for row in own]]
            lengths.append(min(float(np.linalg.norm(off - along * (along @ off))), 1.0))
    return np.array(lengths)


def _shift(evidence: Evidence, value: Vector, span: Vector, out: NDArray[np.intp]) -> tuple[Vector, float]:
    """Return what rows are off by when they are predicted from all others, and the logarithm of its density.

    Both are NaN where the others do not determine them.

    `value` is the whitened residual, and the orthonormal columns of `span` are what coordinates can change of it.
    """
    columns = np.zeros((value.size, out.size))
    for block, half in _halves(evidence):
        own = np.flatnonzero(np.isin(out, block))
        place = {int(row): i for i, row in enumerate(block)}
        columns[np.ix_(block, own)] = half[:, [place[int(row)] for row in out[own]]]
    seen = span.T @ columns
    whole = columns.T @ columns
    left = whole - seen.T @ seen
    scale = 1.0 / np.sqrt(np.diag(whole))
    rounding = _ROUNDING * np.eye(out.size)  # columns that all but coincide leave the Gram matrices singular
    left, whole = left * np.outer(scale, scale) + rounding, whole * np.outer(scale, scale) + rounding
    if la.eigh(left, whole, eigvals_only=True, subset_by_index=(0, 0))[0] < _UNKNOWN:
        return np.full(out.size, np.nan), float("nan")
    pull = scale * (columns.T @ value - seen.T @ (span.T @ value))
    root = la.cho_factor(left)
    shift = la.cho_solve(root, pull)
    density = (
        np.sum(np.log(np.diag(root[0])) - np.log(scale) - 0.5 * np.log(2.0 * np.pi)) - 0.5 * pull @ shift
    )
    return np.asarray(scale * shift), float(density)


def _halves(evidence: Evidence) -> Iterator[tuple[NDArray[np.intp], Vector]]:
    """Yield the rows of each block of data and the matrix that whitens them, at the sizes of the evidence."""
    for block in evidence.covariance.blocks:
        size = evidence.sizes.of(evidence.rows.kind[block.row])
        yield block.row, block.rotation / np.sqrt(1.0 + size**2 * block.growth)[:, None]
