"""How well an explanation predicts a mode that it has not seen, in any configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from updating.diagnosis.evidence import Evidence
from updating.diagnosis.residual import Residual

_FARTHEST = 1.0  # of the logarithm of a frequency: to first order, more says only that a prediction fails
_UNKNOWN = 1e-9  # share of a parameter that data without the mode determine, below which they do not


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Errors of modes that are predicted from all others.

    Attributes
    ----------
    frequency : float
        Mean relative error of their frequencies; NaN where none can be predicted.
    misfit : float
        Mean square of their frequencies and damping ratios over the standard deviations of noise and discrepancy.
    """

    frequency: float
    misfit: float


def left_out(evidence: Evidence, found: Residual) -> LeftOut:
    """Predict each mode of the stack, in all configurations at once, from all other modes.

    To first order nothing has to be fitted again: with H the projection on what the coordinates can change, what is
    left of the rows b of one mode becomes (I - H_bb)^-1 r_b when they are left out (Allen 1974; Cook and Weisberg
    1982). A mode without which a parameter is not determined is passed over.

    Parameters
    ----------
    evidence : Evidence
        What was fitted.
    found : Residual
        Of the fit.
    """
    span, errors, squares = found.span, [], []
    growth, size = evidence.covariance.growth, evidence.sizes.of(evidence.rows.kind)
    std = np.sqrt(1.0 + size**2 * growth)
    for block in evidence.covariance.blocks:
        kind, mode = evidence.rows.kind[block.row[0]], evidence.rows.mode[block.row[0]]
        if kind == "shape":
            continue
        rows = np.flatnonzero(found.mode == mode)
        own = span[rows]
        others = np.eye(span.shape[1]) - own.T @ own
        if np.linalg.eigvalsh(others)[0] < _UNKNOWN:
            continue
        moved = np.linalg.solve(others, own.T @ found.value[rows])
        left = found.value[block.row] + span[block.row] @ moved
        squares.append(left**2)
        if kind == "frequency":
            logarithm = np.linalg.solve(block.rotation, left * std[block.row])
            errors.append(np.abs(np.expm1(np.clip(-logarithm, -_FARTHEST, _FARTHEST))))
    if not errors:
        return LeftOut(frequency=float("nan"), misfit=float("nan"))
    return LeftOut(
        frequency=float(np.mean(np.concatenate(errors))), misfit=float(np.mean(np.concatenate(squares)))
    )
