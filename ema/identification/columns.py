"""What a stabilisation chart shows: how far each pole is stable from order to order, and why a column is no mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ema.identification.functions import Functions
from ema.identification.lsfd import mode_basis, residual_basis, split_coefficients, stack_functions
from ema.identification.significance import MIN_COLLINEARITY, MIN_REALNESS, is_split, judge
from ema.identification.stabilization import StabilizationDiagram
from ema.types.arrays import readonly
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel, frequency_text

STABLE_FREQUENCY, STABLE_DAMPING, STABLE_MAC = 0.01, 0.05, 0.98
"""Largest relative changes from one order to the next, and the least MAC, of what is called stable (the usual ones:
Heylen, Lammens and Sas, Modal Analysis Theory and Testing, part A)."""
_LINES = 800  # that shapes of all orders are fitted over; more would not move their MAC
_NEAR = 3.0  # half bandwidths of a mode within which a column is its own


@dataclass(frozen=True, eq=False, kw_only=True)
class Stability:
    """What of each pole of a stabilisation chart its neighbour of the order below shares.

    Attributes
    ----------
    frequency, damping, shape : (n_pole,) bool
        Whether the natural frequency is stable, the damping ratio with it, and the shape with both.
    """

    frequency: NDArray[np.bool_]
    damping: NDArray[np.bool_]
    shape: NDArray[np.bool_]

    def __post_init__(self) -> None:
        for name in ("frequency", "damping", "shape"):
            checked = readonly("Stability", name, getattr(self, name), (None,), bool)
            object.__setattr__(self, name, checked)


@dataclass(frozen=True, kw_only=True)
class DroppedColumn:
    """A column of a stabilisation chart that is no mode.

    Attributes
    ----------
    frequency : float
        Its place, Hz.
    reason : str
        Why it was not taken.
    """

    frequency: float
    reason: str


def stability(diagram: StabilizationDiagram, frf: FRF) -> Stability:
    """Compare every pole with the nearest one of the order below.

    Parameters
    ----------
    diagram : StabilizationDiagram
        The chart.
    frf : FRF
        The functions that it was made from; the first input gives the shapes.
    """
    step = max(1, frf.frequency.size // _LINES)
    lines, value = frf.frequency[::step], frf.value[:, 0, ::step]
    found = np.zeros((3, diagram.pole.size), dtype=bool)
    below: tuple[NDArray[np.complex128], NDArray[np.complex128]] | None = None
    for order in np.unique(diagram.order):
        own = np.flatnonzero(diagram.order == order)
        pole = diagram.pole[own]
        shape = _shapes(lines, value, pole, frf)
        if below is not None and below[0].size:
            found[:, own] = _shared(pole, shape, *below)
        below = pole, shape
    return Stability(frequency=found[0], damping=found[1], shape=found[2])


def dropped_columns(
    diagram: StabilizationDiagram, frf: FRF, modal_model: ModalModel
) -> tuple[DroppedColumn, ...]:
    """Say of each column of a chart that is no identified mode why it is none, ascending in frequency.

    Parameters
    ----------
    diagram : StabilizationDiagram
        The chart.
    frf : FRF
        The functions that it was made from.
    modal_model : ModalModel
        What was identified from them.
    """
    poles = np.concatenate([modal_model.pole, modal_model.outside_pole])
    data = Functions(
        frequency=frf.frequency,
        value=frf.value.reshape(-1, frf.frequency.size),
        run=np.repeat(frf.run, frf.input.node.size),
        quantity=frf.quantity,
        weight=np.ones((frf.value.shape[0] * frf.value.shape[1], frf.frequency.size)),
    )
    dropped = []
    for pole in diagram.chosen:
        distance = np.abs(poles - pole)
        near = int(np.argmin(distance))
        rival = diagram.chosen[np.argmin(np.abs(diagram.chosen - poles[near]))]
        if distance[near] >= _NEAR * -poles[near].real:
            reason = _reason(data, poles, pole)
        elif rival != pole:
            reason = (
                f"the mode of the column at {frequency_text(np.abs(rival) / (2.0 * np.pi), 1)} Hz once more"
            )
        elif near >= modal_model.pole.size:
            reason = "it lies at the end of the band; its flank was taken into account"
        else:
            continue
        dropped.append(DroppedColumn(frequency=float(np.abs(pole)) / (2.0 * np.pi), reason=reason))
    return tuple(dropped)


def _shapes(
    frequency: NDArray[np.float64],
    value: NDArray[np.complex128],
    pole: NDArray[np.complex128],
    frf: FRF,
) -> NDArray[np.complex128]:
    """Return residues (n_output, n_pole) of functions (n_output, n_frequency) at given poles."""
    basis = np.concatenate(
        [mode_basis(frequency, pole, frf.quantity), residual_basis(frequency, frf.quantity)], axis=1
    )
    basis /= (scale := np.linalg.norm(basis, axis=0))
    solution = scipy.linalg.lstsq(basis, stack_functions(value), lapack_driver="gelsy", check_finite=False)[0]
    return split_coefficients(solution / scale[:, None])[0]


def _shared(
    pole: NDArray[np.complex128],
    shape: NDArray[np.complex128],
    other: NDArray[np.complex128],
    other_shape: NDArray[np.complex128],
) -> NDArray[np.bool_]:
    """Tell what each pole shares with the nearest other one: frequency, damping too, shape too, (3, n_pole)."""
    nearest = np.argmin(np.abs(pole[:, None] - other), axis=1)
    near, near_shape = other[nearest], other_shape[:, nearest]
    damping, near_damping = (-p.real / np.abs(p) for p in (pole, near))
    frequency = np.abs(np.abs(pole) - np.abs(near)) < STABLE_FREQUENCY * np.abs(pole)
    damped = frequency & (np.abs(damping - near_damping) < STABLE_DAMPING * damping)
    product = np.abs(np.sum(shape.conj() * near_shape, axis=0)) ** 2
    size = np.sum(np.abs(shape) ** 2, axis=0) * np.sum(np.abs(near_shape) ** 2, axis=0)
    return np.stack([frequency, damped, damped & (product >= STABLE_MAC * size)])


def _reason(data: Functions, poles: NDArray[np.complex128], candidate: complex) -> str:
    """Say what speaks against a pole beside those that were taken."""
    fit = data.linear_fit(np.append(poles, candidate))
    verdicts = judge(data.frequency, fit, data.quantity)
    if is_split(fit, -1):
        return "the shape of the mode beside it: one resonance taken for two"
    if verdicts.statistic[-1] <= verdicts.threshold:
        return "beside the modes that were taken it does not stand out of the noise"
    if verdicts.collinearity[-1] < MIN_COLLINEARITY:
        return (
            f"its points do not move in phase (collinearity {verdicts.collinearity[-1]:.2f}, "
            f"{MIN_COLLINEARITY:g} at least)"
        )
    if verdicts.realness[-1] < MIN_REALNESS:
        return "its phase is not that of a resonance"
    return "refined together with the others it moves away, or explains nothing that they do not"
