"""What roving accelerometers read beside the first one, as a fit finds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation


@dataclass(frozen=True, kw_only=True)
class SensorGain:
    """The gain of an accelerometer that roves, relative to that of the first.

    Attributes
    ----------
    sensor : int
        Its place among the outputs of a run, from 1.
    excess : float
        By which share it reads higher.
    std : float
        Standard deviation of that.
    """

    sensor: int
    excess: float
    std: float


def sensor_gains(evidence: Evidence, own: Explanation) -> tuple[SensorGain, ...]:
    """Return the gains of all roving accelerometers but the first, as an explanation was fitted with them."""
    gain = slice(evidence.n_sized, evidence.n_sized + evidence.n_gain)
    variance = np.diag(la.pinvh(own.residual.jacobian.T @ own.residual.jacobian))[gain]
    return tuple(
        SensorGain(sensor=i, excess=float(np.expm1(value)), std=float(np.sqrt(max(spread, 0.0))))
        for i, (value, spread) in enumerate(zip(own.nuisance[gain], variance, strict=True), 2)
    )
