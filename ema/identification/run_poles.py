"""Poles of single roving runs, so that a shift from run to run is seen.

A sensor that roves takes its mass along, and a structure may change between runs. Either moves the poles of a
run against those of the others. The poles of each run are refined on that run's functions alone, and every
frequency is compared with the mean of the other runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.special as special
from numpy.typing import NDArray

from ema.identification.lsfd import mode_basis
from ema.identification.maximum_likelihood import Fit, linear_fit, refine
from ema.identification.significance import variance_inflation
from ema.types.frf import Quantity

VISIBLE = 1e-6
"""Chance that noise alone makes a mode visible in a run."""
FALSE_ALARM = 0.05
"""Chance that runs of one and the same structure are said to differ."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunPoles:
    """What each roving run alone says of the poles.

    Attributes
    ----------
    run : (n_run,) int
        Numbers of the runs.
    pole : (n_run, n_mode) complex
        Poles, rad/s; those of all runs together where a run does not determine a mode.
    residue : (n_function, n_mode) complex
        Residues of the receptance at the poles of each function's own run, m/(N s).
    frequency_std, damping_std : (n_run, n_mode) float
        Standard deviations, infinite where a run does not determine a mode.
    probability : (n_run, n_mode) float
        Probability that noise alone would make any run's frequency of any mode differ this much from those of
        the other runs (Bonferroni's bound); 1 where there is nothing to compare.
    """

    run: NDArray[np.int64]
    pole: NDArray[np.complex128]
    residue: NDArray[np.complex128]
    frequency_std: NDArray[np.float64]
    damping_std: NDArray[np.float64]
    probability: NDArray[np.float64]

    def disagree(self) -> bool:
        """Whether any run differs significantly from the others."""
        return bool(np.any(self.probability < FALSE_ALARM))


def frequency_damping_std(
    pole: NDArray[np.complex128], covariance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Carry the covariance of Re and Im of poles to ``abs(s) / 2 pi`` and ``-Re(s) / abs(s)``.

    Returns the standard deviations ``(n_mode,)`` of frequency (Hz) and damping ratio, by linearisation.
    """
    size = np.abs(pole)
    index = 2 * np.arange(pole.size)
    real, imaginary = covariance[index, index], covariance[index + 1, index + 1]
    cross = covariance[index, index + 1]

    def deviation(by_real: NDArray[np.float64], by_imaginary: NDArray[np.float64]) -> NDArray[np.float64]:
        variance = by_real**2 * real + 2.0 * by_real * by_imaginary * cross + by_imaginary**2 * imaginary
        return np.sqrt(np.maximum(variance, 0.0))

    return (
        deviation(pole.real / (2.0 * np.pi * size), pole.imag / (2.0 * np.pi * size)),
        deviation(-(pole.imag**2) / size**3, pole.real * pole.imag / size**3),
    )


def run_poles(
    frequency: NDArray[np.float64],
    value: NDArray[np.complex128],
    run: NDArray[np.int64],
    fit: Fit,
    quantity: Quantity,
) -> RunPoles:
    """Refine the poles of a fit run by run and compare the runs.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines that were fitted, Hz.
    value : (n_function, n_frequency) complex
        Functions of `quantity`.
    run : (n_function,) int
        Run that each function was measured in.
    fit : Fit
        Fit of all functions together; its weights hold for the runs too.
    quantity : {"receptance", "mobility", "accelerance"}
        What the functions are.
    """
    numbers = np.unique(run)
    n_run, n_mode = numbers.size, fit.pole.size
    pole = np.tile(fit.pole, (n_run, 1))
    frequency_std, damping_std = np.full((2, n_run, n_mode), np.inf)
    if n_run == 1:
        inflation = np.repeat(np.sqrt(variance_inflation(frequency, fit)), 2)
        covariance = fit.pole_covariance * np.outer(inflation, inflation)
        stds = frequency_damping_std(fit.pole, covariance)
        return RunPoles(
            run=numbers,
            pole=pole,
            residue=fit.residue,
            frequency_std=stds[0][None],
            damping_std=stds[1][None],
            probability=np.ones((1, n_mode)),
        )
    residue = fit.residue.copy()
    for k, number in enumerate(numbers):
        part = value[run == number]
        weight = fit.weight[run == number]
        at_all = linear_fit(frequency, part, fit.pole, quantity, weight)
        visible = _visible(at_all)
        while True:
            # What a run hardly shows would wander through its noise; it is taken out as the pole of all runs gives it.
            hidden = mode_basis(frequency, fit.pole[~visible], quantity) @ _stacked(
                at_all.residue[:, ~visible]
            )
            rest = part - (hidden[: frequency.size] + 1j * hidden[frequency.size :]).T
            own = refine(frequency, rest, fit.pole[visible], quantity, weight)
            inflation = np.repeat(np.sqrt(variance_inflation(frequency, own)), 2)
            stds = frequency_damping_std(own.pole, own.pole_covariance * np.outer(inflation, inflation))
            half_bandwidth = np.maximum(-own.pole.real, -fit.pole[visible].real)
            determined = 2.0 * np.pi * stds[0] < 0.5 * half_bandwidth
            determined &= np.abs(own.pole - fit.pole[visible]) < 0.05 * np.abs(own.pole)
            if determined.all():
                break
            # A pole that did wander leaves the others to rounding: again without it.
            visible[np.flatnonzero(visible)[~determined]] = False
        pole[k, visible] = own.pole
        frequency_std[k, visible] = stds[0]
        damping_std[k, visible] = stds[1]
        residue[run == number] = linear_fit(
            frequency, value[run == number], pole[k], quantity, weight
        ).residue
    return RunPoles(
        run=numbers,
        pole=pole,
        residue=residue,
        frequency_std=frequency_std,
        damping_std=damping_std,
        probability=_disagreement(np.abs(pole) / (2.0 * np.pi), frequency_std),
    )


def _visible(fit: Fit) -> NDArray[np.bool_]:
    """Whether the residues of each mode at its fixed pole stand out of the noise of a few functions."""
    index = 2 * np.arange(fit.pole.size)
    # Per unit noise the two parts of a residue have nearly equal variance and no correlation.
    diagonal = np.diagonal(fit.linear_covariance, axis1=1, axis2=2)
    variance = 0.5 * (diagonal[:, index] + diagonal[:, index + 1]) * fit.noise[:, None] ** 2
    return np.sum(np.abs(fit.residue) ** 2 / variance, axis=0) > special.chdtri(
        2 * fit.residue.shape[0], VISIBLE
    )


def _stacked(residue: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Residues ``(n_function, n_mode)`` as coefficients of `mode_basis`, ``(2 n_mode, n_function)``."""
    return np.stack([residue.real.T, residue.imag.T], axis=1).reshape(-1, residue.shape[0])


def _disagreement(value: NDArray[np.float64], std: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability of each run's distance ``(n_run, n_mode)`` from the others, which may scatter among themselves.

    The others' centre is their weighted median, so that a second odd run does not hide the first.
    """
    n_run, n_mode = value.shape
    probability = np.ones((n_run, n_mode))
    for r in range(n_mode):
        for k in np.flatnonzero(np.isfinite(std[:, r])):
            others = np.flatnonzero(np.isfinite(std[:, r]) & (np.arange(n_run) != k))
            if others.size == 0:
                continue
            rank = others[np.argsort(value[others, r])]
            weight = np.cumsum(std[rank, r] ** -2.0)
            centre = value[rank[np.searchsorted(weight, 0.5 * weight[-1])], r]
            # A median is pi / 2 times as uncertain, in variance, as the mean of normal numbers.
            spread = std[k, r] ** 2 + (0.5 * np.pi if others.size > 2 else 1.0) / weight[-1]
            probability[k, r] = 2.0 * special.ndtr(-abs(value[k, r] - centre) / np.sqrt(spread))
    return np.minimum(1.0, probability * probability.size)
