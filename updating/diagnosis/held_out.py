"""How well an explanation predicts a mode, or a configuration, that it has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.diagnosis.evidence import Evidence
from updating.diagnosis.residual import Residual

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
    misfit : float
        Mean square of both over the standard deviations of noise and discrepancy.
    """

    frequency: float
    damping: float
    misfit: float


def left_out(evidence: Evidence, found: Residual, by: Literal["mode", "configuration"] = "mode") -> LeftOut:
    """Predict each mode of the stack, in all configurations at once, or each configuration, from all other data.

    To first order nothing has to be fitted again: rows that are left out are rows with a shift of their own, which is
    estimated beside all coordinates and is what the others mispredict them by (Cook and Weisberg 1982). What other
    data do not determine is passed over.

    Parameters
    ----------
    evidence : Evidence
        What was fitted.
    found : Residual
        Of the fit.
    by : "mode" or "configuration"
        What is left out at a time.
    """
    rows, errors, squares = evidence.rows, {"frequency": [], "damping": []}, []  # type: ignore[var-annotated]
    group = rows.mode if by == "mode" else rows.configuration
    for number in np.unique(group):
        out = np.flatnonzero(group == number)
        shift = _shift(evidence, found, out)
        if shift is None:
            continue
        for kind, each in errors.items():
            own = rows.kind[out] == kind
            if np.any(own):
                each.append(np.abs(np.expm1(np.clip(-shift[own], -_FARTHEST, _FARTHEST))))
                squares.append(_whitened(evidence, out[own], shift[own]) ** 2)
    if not squares:
        return LeftOut(frequency=float("nan"), damping=float("nan"), misfit=float("nan"))
    frequency, damping = (
        float(np.mean(np.concatenate(each))) if each else float("nan") for each in errors.values()
    )
    return LeftOut(frequency=frequency, damping=damping, misfit=float(np.mean(np.concatenate(squares))))


def _shift(evidence: Evidence, found: Residual, out: NDArray[np.intp]) -> Vector | None:
    """Return what rows are off by when they are predicted from all others; None where these do not determine them."""
    columns = np.zeros((found.value.size, out.size))
    for block, half in _halves(evidence):
        own = np.flatnonzero(np.isin(out, block))
        place = {int(row): i for i, row in enumerate(block)}
        columns[np.ix_(block, own)] = half[:, [place[int(row)] for row in out[own]]]
    seen = found.span.T @ columns
    whole = columns.T @ columns
    left = whole - seen.T @ seen
    scale = 1.0 / np.sqrt(np.diag(whole))
    left, whole = left * np.outer(scale, scale), whole * np.outer(scale, scale)
    if la.eigh(left, whole, eigvals_only=True, subset_by_index=(0, 0))[0] < _UNKNOWN:
        return None
    pull = columns.T @ found.value - seen.T @ (found.span.T @ found.value)
    return np.asarray(scale * la.solve(left, scale * pull, assume_a="pos"))


def _halves(evidence: Evidence) -> Iterator[tuple[NDArray[np.intp], Vector]]:
    """Yield the rows of each block of data and the matrix that whitens them, at the sizes of the evidence."""
    for block in evidence.covariance.blocks:
        size = evidence.sizes.of(evidence.rows.kind[block.row])
        yield block.row, block.rotation / np.sqrt(1.0 + size**2 * block.growth)[:, None]


def _whitened(evidence: Evidence, rows: NDArray[np.intp], value: Vector) -> Vector:
    """Return values of rows of one kind over their standard deviations of noise and discrepancy."""
    variance = np.empty(rows.size)
    for block, half in _halves(evidence):
        own = np.flatnonzero(np.isin(rows, block))
        if own.size:
            covariance = la.inv(half.T @ half)
            place = {int(row): i for i, row in enumerate(block)}
            at = [place[int(row)] for row in rows[own]]
            variance[own] = np.diag(covariance)[at]
    return np.asarray(value / np.sqrt(variance))
