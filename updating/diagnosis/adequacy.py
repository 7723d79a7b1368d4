"""Whether an explanation is enough: whether the discrepancy that it leaves is one that a right model may have."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from updating.diagnosis.calibration import P_ADEQUATE
from updating.diagnosis.discrepancy import KINDS, MEDIAN, SPREAD, Kind
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation


def p_value(evidence: Evidence, own: Explanation, kind: Kind) -> float:
    """Return the probability that a right model leaves a discrepancy as large in one kind of data.

    By the prior of its size; 1 where a laboratory states the size, which then is no question.
    """
    if kind in evidence.scatter.stated:
        return 1.0
    return float(ndtr(-np.log(getattr(own.mean, kind) / MEDIAN[kind]) / SPREAD))


def too_large(evidence: Evidence, own: Explanation) -> tuple[Kind, ...]:
    """Return the kinds of data in which an explanation leaves more than a right model does."""
    return tuple(kind for kind in KINDS if p_value(evidence, own, kind) < P_ADEQUATE)
