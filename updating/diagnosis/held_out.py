"""How well an explanation predicts a mode that it has not seen."""

from __future__ import annotations

import numpy as np

from updating.diagnosis.residual import Residual

_FARTHEST = 1.0  # of the logarithm of a frequency: to first order, more says only that a prediction fails
_UNKNOWN = 1e-9  # share of a parameter that data without the mode determine, below which they do not


def held_out_error(found: Residual) -> float:
    """Return the mean relative error of frequencies when each mode is predicted from all other data.

    To first order nothing has to be fitted again: with H the projection on what the coordinates can change, what is
    left of the rows b of one mode becomes (I - H_bb)^-1 r_b when they are left out (Allen 1974; Cook and Weisberg
    1982). A mode without which a parameter is not determined is passed over.

    Parameters
    ----------
    found : Residual
        Of a fit. Rows of the same label are one mode of one configuration.

    Returns
    -------
    float
        NaN where no mode can be predicted from the others.
    """
    span, label = found.span, np.array(found.label)
    errors = []
    for i, std in zip(np.flatnonzero(found.kind == "frequency"), found.log_frequency_std, strict=True):
        rows = np.flatnonzero(label == label[i])
        own = span[rows]
        others = np.eye(span.shape[1]) - own.T @ own
        if np.linalg.eigvalsh(others)[0] < _UNKNOWN:
            continue
        left = found.value[i] + span[i] @ np.linalg.solve(others, own.T @ found.value[rows])
        errors.append(abs(np.expm1(np.clip(-left * std, -_FARTHEST, _FARTHEST))))
    return float(np.mean(errors)) if errors else float("nan")
