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
_UNKNOWN = 1e-9  # share of a direction that other data determine, below which they do not


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Errors of what is predicted from all other data.

    Attributes
    ----------
    frequency, damping : float
        Mean relative errors of frequencies and damping ratios; NaN where none can be predicted.
    """

    frequency: float
    damping: float


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
    errors: dict[str, list[Vector]] = {"frequency": [], "damping": []}
    group = rows.mode if by == "mode" else rows.configuration
    for number in np.unique(group):
        out = np.flatnonzero(group == number)
        shift = _shift(evidence, value, span, out)
        if shift is None:
            continue
        for kind, each in errors.items():
            off = shift[rows.kind[out] == kind]
            if off.size:
                each.append(np.abs(np.expm1(np.clip(-off, -_FARTHEST, _FARTHEST))))
    frequency, damping = (
        float(np.mean(np.concatenate(each))) if each else float("nan") for each in errors.values()
    )
    return LeftOut(frequency=frequency, damping=damping)


def _shift(evidence: Evidence, value: Vector, span: Vector, out: NDArray[np.intp]) -> Vector | None:
    """Return what rows are off by when they are predicted from all others; None where these do not determine them.

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
    left, whole = left * np.outer(scale, scale), whole * np.outer(scale, scale)
    if la.eigh(left, whole, eigvals_only=True, subset_by_index=(0, 0))[0] < _UNKNOWN:
        return None
    pull = columns.T @ value - seen.T @ (span.T @ value)
    return np.asarray(scale * la.solve(left, scale * pull, assume_a="pos"))


def _halves(evidence: Evidence) -> Iterator[tuple[NDArray[np.intp], Vector]]:
    """Yield the rows of each block of data and the matrix that whitens them, at the sizes of the evidence."""
    for block in evidence.covariance.blocks:
        size = evidence.sizes.of(evidence.rows.kind[block.row])
        yield block.row, block.rotation / np.sqrt(1.0 + size**2 * block.growth)[:, None]
