"""The objectives of the paper, eq. (1), and its error measure, eq. (2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def opt_G(f_exp: ArrayLike, f_num: ArrayLike) -> float:
    """Objective of the contact stiffness, Hz: root of the summed squared frequency differences.

    Source: Pirnat, Čepon, Boltežar 2013, eq. (1), left.
    """
    return float(np.linalg.norm(np.asarray(f_exp, float) - np.asarray(f_num, float)))


def opt_d(xi_exp: ArrayLike, xi_num: ArrayLike) -> float:
    """Objective of the contact damping: root of the summed squared damping-ratio differences.

    Source: Pirnat, Čepon, Boltežar 2013, eq. (1), right.
    """
    return float(np.linalg.norm(np.asarray(xi_exp, float) - np.asarray(xi_num, float)))


def frequency_error(f_exp: ArrayLike, f_num: ArrayLike) -> float:
    """Mean relative frequency error as a ratio (0.144, not 14.4).

    Source: Pirnat, Čepon, Boltežar 2013, eq. (2), there in percent.
    """
    f_exp, f_num = np.asarray(f_exp, float), np.asarray(f_num, float)
    return float(np.mean(np.abs(f_exp - f_num) / f_exp))
