"""Measured and modelled FRFs side by side, line by line and function by function, without any modes.

Sources: Heylen and Lammens, FRAC: a consistent way of comparing frequency response functions, Proc. Int. Conf.
Identification in Engineering Systems, Swansea 1996; Pascual, Golinval and Razeto, A frequency domain correlation
technique for model correlation and updating, Proc. IMAC XV, 1997 (FDAC); Dascotte and Strobbe, Updating finite
element models using FRF correlation functions, Proc. IMAC XVII, 1999 (CSAC, CSF).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.modal.mac import frac
from ema.types.arrays import readonly
from updating.errors import UpdatingError


@dataclass(frozen=True, eq=False, kw_only=True)
class FrfCorrelation:
    """How measured and modelled functions agree.

    Attributes
    ----------
    frequency : (n_frequency,) float
        Lines, Hz.
    frac : (n_output, n_input) float
        Frequency response assurance criterion of each function over all lines: 1 for equal ones up to a factor.
    csac : (n_frequency,) float
        Cross signature assurance criterion: the MAC of the operating deflection shapes at each line, all inputs
        together. It falls where resonances do not coincide.
    csf : (n_frequency,) float
        Cross signature scale factor: 1 only where the level agrees as well.
    """

    frequency: NDArray[np.float64]
    frac: NDArray[np.float64]
    csac: NDArray[np.float64]
    csf: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = np.size(self.frequency)
        for name, shape in (("frequency", (n,)), ("frac", (None, None)), ("csac", (n,)), ("csf", (n,))):
            object.__setattr__(self, name, readonly("FrfCorrelation", name, getattr(self, name), shape))


def correlate_frf(measured: ArrayLike, model: ArrayLike, frequency: ArrayLike) -> FrfCorrelation:
    """Correlate measured functions with those of the model at the same lines.

    Parameters
    ----------
    measured, model : (n_output, n_input, n_frequency) array_like
        Functions of the same quantity, such as `ema.FRF.value` and `model.frf`.
    frequency : (n_frequency,) array_like
        Lines, Hz.

    Raises
    ------
    UpdatingError
        The arrays do not have the same functions and lines.
    """
    first, second = _functions(measured, model)
    lines = np.asarray(frequency, dtype=float)
    if lines.shape != first.shape[2:]:
        message = f"{first.shape[2]} lines were given with {lines.size} frequencies"
        raise UpdatingError(message)
    cross = np.abs(np.sum(first.conj() * second, axis=(0, 1)))
    square_1, square_2 = (np.sum(np.abs(h) ** 2, axis=(0, 1)) for h in (first, second))
    both = (square_1 > 0.0) & (square_2 > 0.0)
    zero = np.zeros(lines.size)
    return FrfCorrelation(
        frequency=lines,
        frac=frac(first, second),
        csac=np.divide(cross**2, square_1 * square_2, out=zero.copy(), where=both),
        csf=np.divide(2.0 * cross, square_1 + square_2, out=zero.copy(), where=both),
    )


def fdac(measured: ArrayLike, model: ArrayLike) -> NDArray[np.float64]:
    """Frequency domain assurance criterion: deflection shapes of every two lines compared, with their sign.

    A ridge beside the diagonal shows by how much the model is too stiff or too soft at each frequency: the line of the
    model that looks like a measured one. The value is the real cosine of the two, so -1 means opposite phase; the
    first form of the criterion, its square, could not tell.

    Parameters
    ----------
    measured, model : (n_output, n_input, n_frequency) array_like
        Functions of the same DOFs; their lines may differ. Every 10th line is often enough.

    Returns
    -------
    (n_measured_line, n_model_line) float

    Raises
    ------
    UpdatingError
        The arrays do not have the same DOFs.
    """
    first, second = (np.asarray(h, dtype=complex) for h in (measured, model))
    if first.ndim != 3 or second.ndim != 3 or first.shape[:2] != second.shape[:2]:
        message = (
            f"FRFs to compare need the same outputs and inputs: got shapes {first.shape} and {second.shape}"
        )
        raise UpdatingError(message)
    columns = [h.reshape(-1, h.shape[2]) for h in (first, second)]
    unit = [c / np.maximum(np.linalg.norm(c, axis=0), np.finfo(float).tiny) for c in columns]
    return np.asarray((unit[0].conj().T @ unit[1]).real)


def _functions(
    measured: ArrayLike, model: ArrayLike
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    first, second = np.asarray(measured, dtype=complex), np.asarray(model, dtype=complex)
    if first.ndim != 3 or first.shape != second.shape:
        message = (
            "measured and modelled FRFs need the same shape (n_output, n_input, n_frequency): "
            f"got {first.shape} and {second.shape}"
        )
        raise UpdatingError(message)
    return first, second
