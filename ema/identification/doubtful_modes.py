"""What is doubtful about a result, and what its stabilisation chart shows.

Modes whose damping, phases or frequencies are doubtful are reported, and stay; so are forces that find different
frequencies. Of the chart: how far each pole is stable from order to order, and why a column is no mode.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ema.identification.evidence import MIN_COLLINEARITY, MIN_REALNESS, is_split, judge
from ema.identification.functions import MAX_DAMPING, Functions, resonant
from ema.identification.maximum_likelihood import linear_fit
from ema.identification.mode_columns import mode_basis, residual_basis, split_coefficients, stack_functions
from ema.identification.run_poles import RUNS_DIFFER, run_poles
from ema.identification.stabilization import StabilizationDiagram
from ema.quality.peaks import peaks
from ema.quality.verdict import Verdict, listing
from ema.types.arrays import single_threaded
from ema.types.frf import DERIVATIVE, FRF
from ema.types.modal_model import ModalModel, frequency_text
from lamella_shared import Booleans, Complexes, Reals, arrays

BROAD = 5.0
"""Times the median of the other damping ratios from which on a mode that shows no peak may be no mode."""
FEWEST_FUNCTIONS, FEWEST_MODES = 3, 3
"""Functions that tell phases from chance, and modes that tell what damping is usual."""
NOISE = 0.1
"""Share of the squared residues of a mode that may be noise where something is said of their phases."""


def check_modes(frf: FRF, modal_model: ModalModel) -> tuple[Verdict, ...]:
    """Say of which modes the damping or the phases are doubtful, or whether they are modes.

    Parameters
    ----------
    frf : FRF
        Functions at the outputs and inputs of the model.
    modal_model : ModalModel

    Returns
    -------
    tuple of Verdict
        Warnings about the set; none where nothing is doubtful.
    """
    checks = (_background, _overlap, _damping)
    findings = (*(say(modal_model) for say in checks), _broad(frf, modal_model), *_phases(modal_model))
    return tuple(Verdict(check=check, level="warn", message=text) for check, text in findings if text)


def _background(modal_model: ModalModel) -> tuple[str, str]:
    pole, (lower, upper) = modal_model.outside_pole, modal_model.band
    hertz, damping = np.abs(pole) / (2.0 * np.pi), -pole.real / np.abs(pole)
    kept = (hertz > lower) & (hertz < upper) & (damping > MAX_DAMPING)
    listed = [f"{f:.4g} Hz ({100 * x:.0f} %)" for f, x in zip(hertz[kept], damping[kept], strict=True)]
    text = f"damped too much for a resonance is what was fitted at {listing(listed)}: it stands for the background"
    return "background", text if listed else ""


def _overlap(modal_model: ModalModel) -> tuple[str, str]:
    """Say where poles were fitted that are no modes, for each stands for several (`ema.identification.band_fit`)."""
    poles = modal_model.outside_pole[resonant(modal_model.outside_pole, modal_model.band)]
    listed = [f"{f:.4g} Hz" for f in np.sort(np.abs(poles)) / (2.0 * np.pi)]
    text = (
        f"modes overlap so much that not all are told apart: what was fitted at {listing(listed)} has not the phases "
        "of a mode and is no result; forces at more points tell more"
    )
    return "overlap", text if listed else ""


def _damping(modal_model: ModalModel) -> tuple[str, str]:
    columns = modal_model.frequency, modal_model.damping, modal_model.damping_std
    listed = [f"{f:.5g} Hz ({100 * x:.2g} ± {100 * s:.2g} %)" for f, x, s in zip(*columns, strict=True) if s >= x]
    text = f"the data do not determine the damping at {listing(listed)}: where no peak is seen, this is no mode"
    return "damping", text if listed else ""


def _broad(frf: FRF, modal_model: ModalModel, *, hump: float = 1.0, share: float = 0.25) -> tuple[str, str]:
    """Name modes that are far wider than the others and show no peak of their own.

    `hump`, `share`: height of the peak of a broad mode, dB, and its width as a share of the mode's: narrower ones are
    noise on it.
    """
    damping = modal_model.damping
    if damping.size < FEWEST_MODES:
        return "broad", ""
    usual = np.array([np.median(np.delete(damping, r)) for r in range(damping.size)])
    suspects = np.flatnonzero(damping > BROAD * usual)
    lines = frf.band(max(modal_model.band[0], np.finfo(float).tiny), modal_model.band[1])
    seen = peaks(lines, np.arange(lines.output.node.size), hump) if suspects.size else []
    listed = []
    for r in suspects:
        place, half = modal_model.frequency[r], damping[r] * modal_model.frequency[r]
        if not any(abs(p.frequency - place) < half and p.bandwidth > share * 2.0 * half for p in seen):
            listed.append(f"{place:.5g} Hz ({100 * damping[r]:.0f} %, others {100 * usual[r]:.2g} %)")
    text = f"no peak is seen at {listing(listed)}: so broad, it may stand for the background and be no mode"
    return "broad", text if listed else ""


def _phases(modal_model: ModalModel) -> Iterator[tuple[str, str]]:
    """Name modes whose residues have not the phases of a real mode: turned as one, or each otherwise."""
    turned, apart = [], []
    if modal_model.residue[..., 0].size >= FEWEST_FUNCTIONS:
        for r, place in enumerate(modal_model.frequency):
            constant = (2j * modal_model.pole[r].imag * modal_model.residue[..., r]).ravel()
            spread = 2.0 * np.abs(modal_model.pole[r].imag) * modal_model.residue_std[..., r].ravel()
            collinearity, realness, angle = _of_constants(constant, spread)
            if collinearity < MIN_COLLINEARITY:
                apart.append(f"{place:.5g} Hz ({collinearity:.2f})")
            elif realness < MIN_REALNESS:
                turned.append(f"{place:.5g} Hz (by {angle:.0f} degrees)")
    if turned:
        yield (
            "phases",
            f"the residues at {listing(turned)} are alike among points, but turned against the force, as by "
            "cross-talk, filters, or a force that is not where it is stated",
        )
    if apart:
        yield (
            "phases",
            f"the residues at {listing(apart)} have no phase in common (collinearity in brackets): these shapes are "
            "complex, as of two close modes in one",
        )


def _of_constants(constant: Complexes, spread: Reals) -> tuple[float, float, float]:
    """Return collinearity and realness, 1 where noise may bring what is lacking, and the angle to the real axis."""
    power, noise = float(np.sum(np.abs(constant) ** 2)), 2.0 * float(np.sum(spread**2))
    if noise > NOISE * power:
        return 1.0, 1.0, 0.0
    square = complex(np.sum(constant**2))
    angle = float(np.degrees(abs(np.angle(square)) / 2.0))
    realness = (np.sum(constant.real**2) - 0.5 * noise) / (power - noise)
    return min(1.0, (abs(square) / (power - noise)) ** 2), float(realness), angle


@single_threaded
def check_references(
    frf: FRF, modal_model: ModalModel, *, least_shift: float = 0.1, wanders: float = 4.0
) -> tuple[Verdict, ...]:
    """Compare the frequencies that the functions of each force alone give.

    Tests with a force at one point after the other last long: temperature and supports change. One pole for all forces
    is then wrong for each.

    Parameters
    ----------
    frf : FRF
        Functions at the outputs and inputs of the model.
    modal_model : ModalModel
        What was identified. Modes of nearly one pole are not compared.
    least_shift : float
        Half bandwidths by which a frequency differs from force to force for it to be reported: shapes are then off by 1
        %.
    wanders : float
        Half bandwidths by which a frequency may differ for one mode alone to tell that the structure changed: beyond,
        one pole for all forces would not have been found.

    Returns
    -------
    tuple of Verdict
        One for the set; none where there is one force.
    """
    n_input = modal_model.input.node.size
    if n_input == 1:
        return ()
    lines = frf.band(max(modal_model.band[0], np.finfo(float).tiny), modal_model.band[1])
    pole = modal_model.pole
    gap = np.abs(pole[:, None] - pole) + np.diag(np.full(pole.size, np.inf))
    alone = gap.min(axis=1) > -2.0 * pole.real
    s = 2j * np.pi * lines.frequency
    near, residue = pole[~alone, None], modal_model.residue[..., ~alone]
    together = residue @ (1.0 / (s - near)) + residue.conj() @ (1.0 / (s - near.conj()))
    value = (lines.value - s ** DERIVATIVE[lines.quantity] * together).reshape(-1, s.size)
    data = Functions(
        frequency=lines.frequency,
        value=value,
        run=np.tile(np.arange(n_input), lines.output.node.size),
        quantity=lines.quantity,
        weight=np.ones(value.shape),
    )
    kept = np.concatenate([pole[alone], modal_model.outside_pole])
    runs = run_poles(data, linear_fit(data.frequency, data.value, kept, data.quantity))
    differing, sure = [], False
    number = np.flatnonzero(alone)
    for r in range(number.size):
        hertz = np.abs(runs.pole[:, r]) / (2.0 * np.pi)
        seen = np.flatnonzero(np.isfinite(runs.frequency_std[:, r]))
        off = 2.0 * np.pi * np.ptp(hertz[seen]) / -kept[r].real if seen.size else 0.0
        if off > least_shift and runs.probability[:, r].min() < RUNS_DIFFER:
            each = (f"{hertz[i]:.6g} Hz with the force at {modal_model.input.name(int(i))}" for i in seen)
            differing.append(f"mode {number[r] + 1}: {' and '.join(each)}")
            sure = sure or off < wanders
    return (_verdict(differing, sure or len(differing) > 1),)


def _verdict(differing: list[str], changed: bool) -> Verdict:
    """Say in which modes forces differ, and whether the structure changed or a mode is doubtful."""
    if not differing:
        text = "forces at all points find the same frequencies"
        return Verdict(check="references", level="pass", message=text)
    listed = listing(differing, separator="; ")
    text = f"frequencies differ from force to force: {listed}: "
    if changed:
        text += "the structure changed between these tests; identify each in a configuration of its own"
    else:
        text += (
            "by several bandwidths, and in no other mode, this is no change of the structure between these tests: the "
            "mode is doubtful, or one beside it is missing"
        )
    return Verdict(check="references", level="warn", message=text)


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "frequency damping shape"})
class Stability:
    """What of each pole of a stabilisation chart its neighbour of the order below shares.

    Attributes
    ----------
    frequency, damping, shape : (n_pole,) bool
        Whether the natural frequency is stable, the damping ratio with it, and the shape with both.
    """

    frequency: Booleans
    damping: Booleans
    shape: Booleans


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
    most_lines = 800  # that shapes of all orders are fitted over; more would not move their MAC
    step = max(1, frf.frequency.size // most_lines)
    lines, value = frf.frequency[::step], frf.value[:, 0, ::step]
    stable = np.zeros((3, diagram.pole.size), dtype=bool)
    below: tuple[Complexes, Complexes] | None = None
    for order in np.unique(diagram.order):
        members = np.flatnonzero(diagram.order == order)
        pole = diagram.pole[members]
        shape = _shapes(lines, value, pole, frf)
        if below is not None and below[0].size:
            stable[:, members] = _shared(pole, shape, *below)
        below = pole, shape
    return Stability(frequency=stable[0], damping=stable[1], shape=stable[2])


def dropped_columns(diagram: StabilizationDiagram, frf: FRF, modal_model: ModalModel) -> tuple[DroppedColumn, ...]:
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
    near_enough = 3.0  # half bandwidths of a mode within which a column is its own
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
        if distance[near] >= near_enough * -poles[near].real:
            reason = _reason(data, poles, pole)
        elif rival != pole:
            reason = f"the mode of the column at {frequency_text(np.abs(rival) / (2.0 * np.pi), 1)} Hz once more"
        elif near >= modal_model.pole.size:
            reason = "it lies at the end of the band; its flank was taken into account"
        else:
            continue
        dropped.append(DroppedColumn(frequency=float(np.abs(pole)) / (2.0 * np.pi), reason=reason))
    return tuple(dropped)


def _shapes(frequency: Reals, value: Complexes, pole: Complexes, frf: FRF) -> Complexes:
    """Return residues (n_output, n_pole) of functions (n_output, n_frequency) at given poles."""
    basis = np.concatenate([mode_basis(frequency, pole, frf.quantity), residual_basis(frequency, frf.quantity)], axis=1)
    basis /= (scale := np.linalg.norm(basis, axis=0))
    solution = scipy.linalg.lstsq(basis, stack_functions(value), lapack_driver="gelsy", check_finite=False)[0]
    return split_coefficients(solution / scale[:, None])[0]


def _shared(
    pole: Complexes,
    shape: Complexes,
    other: Complexes,
    other_shape: Complexes,
    *,
    stable_frequency: float = 0.01,
    stable_damping: float = 0.05,
    stable_mac: float = 0.98,
) -> Booleans:
    """Tell what each pole shares with the nearest other one: frequency, damping too, shape too, (3, n_pole).

    `stable_frequency`, `stable_damping`, `stable_mac`: largest relative changes from one order to the next, and the
    least MAC, of what is called stable (the usual ones: Heylen, Lammens and Sas, Modal Analysis Theory and Testing,
    part A).
    """
    nearest = np.argmin(np.abs(pole[:, None] - other), axis=1)
    near, near_shape = other[nearest], other_shape[:, nearest]
    damping, near_damping = (-p.real / np.abs(p) for p in (pole, near))
    frequency = np.abs(np.abs(pole) - np.abs(near)) < stable_frequency * np.abs(pole)
    damped = frequency & (np.abs(damping - near_damping) < stable_damping * damping)
    product = np.abs(np.sum(shape.conj() * near_shape, axis=0)) ** 2
    size = np.sum(np.abs(shape) ** 2, axis=0) * np.sum(np.abs(near_shape) ** 2, axis=0)
    return np.stack([frequency, damped, damped & (product >= stable_mac * size)])


def _reason(data: Functions, poles: Complexes, candidate: complex) -> str:
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
