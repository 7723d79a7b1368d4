"""Poles of single roving runs, so that a shift from run to run is seen.

A sensor that roves takes its mass along, and a structure may change between runs. Either moves the poles of a
run against those of the others. The poles of each run are refined on that run's functions alone, and every
frequency is compared with the mean of the other runs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.identification.functions import Functions, response
from ema.identification.maximum_likelihood import Fit, linear_fit, refine
from ema.identification.significance import variance_inflation
from ema.identification.uncertainty import enlargement, run_noise
from ema.modal.runs import run_scatter, std_with_scatter
from ema.types.modal_model import RESOLVED

VISIBLE = 1e-6
"""Chance that noise alone makes a mode visible in a run."""
FALSE_ALARM = 0.05
"""Chance that runs of one and the same structure are said to differ."""
BESIDE = 2.0
"""Sums of half bandwidths within which a mode overlaps another one."""


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
    variance : (n_function, n_mode) float
        Variance of each of them along its own phase, noise common to a run included.
    frequency_std, damping_std : (n_run, n_mode) float
        Standard deviations, noise common to a run included, infinite where a run does not determine a mode.
    enlargement : (n_mode,) float
        Factor by which noise that is not independent enlarges the variances of the poles of all runs together.
    probability : (n_run, n_mode) float
        Probability that noise alone would make any run's frequency of any mode differ this much from those of
        the other runs (Bonferroni's bound); 1 where there is nothing to compare.
    followed : bool
        Whether the residues of the fit are those of runs at their own poles (`ema.identification.run_tracking`).
    """

    run: NDArray[np.int64]
    pole: NDArray[np.complex128]
    residue: NDArray[np.complex128]
    variance: NDArray[np.float64]
    frequency_std: NDArray[np.float64]
    damping_std: NDArray[np.float64]
    enlargement: NDArray[np.float64]
    probability: NDArray[np.float64]
    followed: bool = False

    def disagree(self) -> bool:
        """Whether any run differs significantly from the others."""
        return bool(np.any(self.probability < FALSE_ALARM))

    def beside(self, fit: Fit, n: int) -> RunPoles:
        """Return the same beside further poles, the last `n` of a fit, which no run is asked about.

        Nor are runs compared in modes that overlap others: the few functions of one run tell them from misfit no more.
        """
        runs, ones = self.run.size, np.ones(n)
        further = fit.pole[-n:]
        near = np.abs(fit.pole[:, None] - fit.pole) < -BESIDE * (fit.pole.real[:, None] + fit.pole.real)
        alone = near.sum(axis=1)[:-n] == 1
        return replace(
            self,
            pole=np.hstack([self.pole, np.tile(further, (runs, 1))]),
            residue=np.hstack([self.residue, fit.residue[:, -n:]]),
            variance=np.hstack([self.variance, _variance(fit, np.ones(fit.pole.size))[:, -n:]]),
            frequency_std=np.hstack([self.frequency_std, np.full((runs, n), np.inf)]),
            damping_std=np.hstack([self.damping_std, np.full((runs, n), np.inf)]),
            enlargement=np.append(self.enlargement, ones),
            probability=np.hstack([np.where(alone, self.probability, 1.0), np.tile(ones, (runs, 1))]),
        )

    def growth(
        self, frequency_std: NDArray[np.float64], damping_std: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Factor by which the scatter between runs enlarges Re and Im of the poles of all runs together.

        Returned in turn for each mode, ``(2 n_mode,)``.

        Parameters
        ----------
        frequency_std, damping_std : (n_mode,) float
            Standard deviations from noise.
        """
        frequency, damping = np.abs(self.pole) / (2.0 * np.pi), -self.pole.real / np.abs(self.pole)
        with_scatter = [
            std_with_scatter(std, run_std, run_scatter(value, run_std)) / std
            for std, run_std, value in (
                (frequency_std, self.frequency_std, frequency),
                (damping_std, self.damping_std, damping),
            )
        ]
        return np.stack(with_scatter[::-1], axis=1).reshape(-1)  # damping is in Re, frequency in Im


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


def variance_along(residue: NDArray[np.complex128], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance ``(n_function, n_mode)`` of each residue along its own phase."""
    direction = np.exp(1j * np.angle(residue))
    index = 2 * np.arange(residue.shape[1])
    return (
        direction.real**2 * covariance[:, index, index]
        + 2.0 * direction.real * direction.imag * covariance[:, index, index + 1]
        + direction.imag**2 * covariance[:, index + 1, index + 1]
    )


def run_poles(data: Functions, fit: Fit, start: NDArray[np.complex128] | None = None) -> RunPoles:
    """Refine the poles of a fit run by run and compare the runs.

    Parameters
    ----------
    data : Functions
        What was fitted.
    fit : Fit
        Fit of all functions together; its weights hold for the runs too.
    start : (n_run, n_mode) complex, optional
        Where each run's poles are sought, rad/s; at those of the fit where not given.
    """
    numbers, n_mode = np.unique(data.run), fit.pole.size
    if numbers.size == 1:
        enlarged = enlargement((run_noise(data, fit),))
        stds = np.sqrt(enlarged.together) * enlarged.student * _stds(fit)
        return RunPoles(
            run=numbers,
            pole=fit.pole[None],
            residue=fit.residue,
            variance=_variance(fit, enlarged.together * enlarged.student**2),
            frequency_std=stds[:1],
            damping_std=stds[1:],
            enlargement=enlarged.together * enlarged.student**2,
            probability=np.ones((1, n_mode)),
        )
    weighted = replace(data, weight=fit.weight)
    pole = np.empty((numbers.size, n_mode), dtype=complex)
    std = np.empty((2, numbers.size, n_mode))
    residue, alone = np.empty(fit.residue.shape, dtype=complex), []
    for k, number in enumerate(numbers):
        own = weighted.of_run(number)
        pole[k], std[0, k], std[1, k] = _refined_alone(own, fit.pole if start is None else start[k])
        alone.append(_linear_fit(own, pole[k]))
        residue[data.run == number] = alone[k].residue
    enlarged = enlargement(
        tuple(run_noise(data.of_run(n), own) for n, own in zip(numbers, alone, strict=True))
    )
    std *= np.sqrt(enlarged.each)
    variance = np.empty(residue.shape)
    for number, its, factor in zip(numbers, alone, enlarged.each * enlarged.student**2, strict=True):
        variance[data.run == number] = _variance(its, factor)
    return RunPoles(
        run=numbers,
        pole=pole,
        residue=residue,
        variance=variance,
        frequency_std=std[0] * enlarged.student,
        damping_std=std[1] * enlarged.student,
        enlargement=enlarged.together * enlarged.student**2,
        probability=_disagreement(
            np.abs(pole) / (2.0 * np.pi), _resolved(std[0], fit.pole), enlarged.freedom
        ),
    )


def _variance(fit: Fit, factor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance of residues along their own phase, each mode's larger by a factor ``(n_mode,)``."""
    return variance_along(fit.residue, fit.residue_covariance()) * factor


def _refined_alone(
    run: Functions, pole: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
    """Refine on the functions of one run the poles that it determines; standard deviations of the others are infinite.

    Returned are the poles and the standard deviations of frequencies, Hz, and damping ratios in independent noise.
    """
    at_all = _linear_fit(run, pole)
    visible = _visible(at_all)
    while True:
        # What a run hardly shows would wander through its noise; it is taken out as the pole of all runs gives it.
        rest = run.value - response(run, pole[~visible], at_all.residue[:, ~visible])
        own = refine(run.frequency, rest, pole[visible], run.quantity, run.weight)
        stds, inflation = _stds(own), variance_inflation(run.frequency, own)
        determined = _determined(own.pole, pole[visible], np.sqrt(inflation) * stds[0])
        if determined.all():
            break
        # A pole that did wander leaves the others to rounding: again without it.
        visible[np.flatnonzero(visible)[~determined]] = False
    refined = pole.copy()
    frequency_std, damping_std = np.full((2, pole.size), np.inf)
    refined[visible], frequency_std[visible], damping_std[visible] = own.pole, *stds
    return refined, frequency_std, damping_std


def _linear_fit(run: Functions, pole: NDArray[np.complex128]) -> Fit:
    """Fit residues and residual terms at fixed poles with the weights of a run."""
    return linear_fit(run.frequency, run.value, pole, run.quantity, run.weight)


def _stds(fit: Fit) -> NDArray[np.float64]:
    """Return standard deviations of frequencies, Hz, and damping ratios, ``(2, n_mode)``, in independent noise."""
    return np.stack(frequency_damping_std(fit.pole, fit.pole_covariance))


def _determined(
    pole: NDArray[np.complex128], start: NDArray[np.complex128], frequency_std: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether each refined pole is certain within its half bandwidth and stayed near where it started."""
    half_bandwidth = np.maximum(-pole.real, -start.real)
    certain = 2.0 * np.pi * frequency_std < 0.5 * half_bandwidth
    return certain & (np.abs(pole - start) < 0.05 * np.abs(pole))


def _visible(fit: Fit) -> NDArray[np.bool_]:
    """Whether the residues of each mode at its fixed pole stand out of the noise of a few functions."""
    index = 2 * np.arange(fit.pole.size)
    # Per unit noise the two parts of a residue have nearly equal variance and no correlation.
    diagonal = np.diagonal(fit.linear_covariance, axis1=1, axis2=2)
    variance = 0.5 * (diagonal[:, index] + diagonal[:, index + 1]) * fit.noise[:, None] ** 2
    return np.sum(np.abs(fit.residue) ** 2 / variance, axis=0) > scipy.special.chdtri(
        2 * fit.residue.shape[0], VISIBLE
    )


def _resolved(std: NDArray[np.float64], pole: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the standard deviations with which frequencies of runs are compared, Hz."""
    return np.hypot(std, RESOLVED * -pole.real / (2.0 * np.pi))


def _disagreement(
    value: NDArray[np.float64], std: NDArray[np.float64], freedom: NDArray[np.float64]
) -> NDArray[np.float64]:
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
            probability[k, r] = 2.0 * scipy.special.stdtr(
                freedom[r], -abs(value[k, r] - centre) / np.sqrt(spread)
            )
    return np.minimum(1.0, probability * probability.size)
