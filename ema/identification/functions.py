"""The functions of a configuration as rows, the weights of their lines, and the parts of a band.

The cost of a fit of all modes together grows with the lines and with the square of the modes, and a model order that
is enough for a few modes is not for those of a whole record. An engineer would take such a record band by band, with
the ends where little happens; so does `part_bands`.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.identification.maximum_likelihood import Fit, linear_fit
from ema.identification.mode_columns import mode_basis
from ema.types.frf import Quantity
from lamella_shared import Booleans, Complexes, Integers, Reals

MOST_LINES = 20_000
"""Lines up to which a band is taken at once."""
OVERLAP = 1024
"""Lines beyond each end of a part that it is fitted on: for a mode near its end, and the flank of one beyond it."""


@dataclass(frozen=True, kw_only=True)
class PartBand:
    """One part of a band.

    Attributes
    ----------
    core : slice
        The lines that are its own; those of all parts are all lines of the band, once.
    lines : slice
        The lines that it is fitted on: with the overlap.
    """

    core: slice
    lines: slice

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return what values on the lines that it is fitted on, (..., n_line), are on its own ones."""
        return values[..., self.core.start - self.lines.start : self.core.stop - self.lines.start]


def part_bands(value: Complexes, *, part_lines: int = 8192, smooth: int = 9) -> tuple[PartBand, ...]:
    """Cut a band where its functions are quiet; one that has few lines stays whole.

    Parameters
    ----------
    value : (..., n_frequency) complex
        The functions.
    part_lines : int
        Lines of a part, about.
    smooth : int
        Lines over which the power is smoothed: no valley is one quiet line of noise.
    """
    either_side = 0.25  # of a part, to either side of where it would end, for the end to be moved to a valley
    n_line = value.shape[-1]
    if n_line <= MOST_LINES:
        return (PartBand(core=slice(0, n_line), lines=slice(0, n_line)),)
    power = np.zeros(n_line)
    for one in value.reshape(-1, n_line):  # all squares at once would take half of the memory of the functions
        square = np.abs(one) ** 2
        power += square / (square.mean() or 1.0)
    power = scipy.ndimage.uniform_filter1d(power, smooth)
    even = np.linspace(0, n_line, round(n_line / part_lines) + 1)
    room = int(either_side * (even[1] - even[0]))
    cuts = [int(at) - room + int(np.argmin(power[int(at) - room : int(at) + room])) for at in even[1:-1]]
    ends = [0, *cuts, n_line]
    return tuple(
        PartBand(core=slice(a, b), lines=slice(max(0, a - OVERLAP), min(n_line, b + OVERLAP)))
        for a, b in itertools.pairwise(ends)
    )


def coherence_weight(value: Complexes, coherence: Reals, *, smoothing: int = 5, largest_ratio: float = 1e4) -> Reals:
    """Return inverse variances of functions, line by line, relative to one another.

    The variance of the magnitude of a function that is estimated from ``n`` averages is
    ``abs(H)**2 (1 - coherence) / (2 n coherence)`` (Bendat and Piersol, Random Data, 4th ed., table 9.6). Only
    its dependence on frequency is used; the number of averages, which files do not state, drops out.

    Parameters
    ----------
    value : (n_function, n_frequency) complex
        Measured functions.
    coherence : (n_function, n_frequency) float
        Their ordinary coherences, 0 to 1; functions with values outside, or not finite, weigh all lines alike.
    smoothing : int
        Lines over which the variance is averaged: an estimate from few averages scatters much itself.
    largest_ratio : float
        Limit on variances over their median: coherences are stored with few digits.

    Returns
    -------
    (n_function, n_frequency) float
        Of geometric mean 1 in every function.
    """
    usable = np.all(np.isfinite(coherence) & (coherence >= 0.0) & (coherence <= 1.0 + 1e-6), axis=1)
    held = np.clip(np.where(usable[:, None], coherence, 0.5), 1e-6, 1.0)
    variance = scipy.ndimage.uniform_filter1d(
        np.abs(value) ** 2 * (1.0 - held) / held, smoothing, axis=1, mode="nearest"
    )
    middle = np.median(variance, axis=1, keepdims=True)
    usable &= middle[:, 0] > 0.0
    middle = np.where(usable[:, None], middle, 1.0)
    weight = 1.0 / np.clip(variance / middle, 1.0 / largest_ratio, largest_ratio)
    weight = weight / np.exp(np.mean(np.log(weight), axis=1, keepdims=True))
    return np.where(usable[:, None], weight, 1.0)


def misfit_weight(fitted: Complexes, residual: Complexes) -> Reals:
    """Return inverse variances of functions of which a fit leaves much where it is large, as in `coherence_weight`.

    What is left of a line is taken for complex normal of variance ``noise**2 + error**2 abs(H)**2``, with H as it was
    fitted: besides noise, a resonance that is not quite that of a linear mode leaves a part of itself. Both are those
    of the largest likelihood in each function, by Fisher scoring.

    Parameters
    ----------
    fitted, residual : (n_function, n_frequency) complex
        A fit of functions, and what it leaves of them; neither is all zero in any of them.

    Returns
    -------
    (n_function, n_frequency) float
        Of geometric mean 1 in every function.
    """
    weight = _inverse_variance(np.abs(fitted) ** 2, np.abs(residual) ** 2)
    return weight / np.exp(np.mean(np.log(weight), axis=1, keepdims=True))


def _inverse_variance(
    power: Reals, left: Reals, *, settled: float = 1e-9, factor: float = 5.0, rounds: int = 50
) -> Reals:
    """Return inverse variances of all functions, two unknowns each, (n_function, n_frequency).

    `settled`: relative change of both parts at which steps end.
    `factor`: by which a part of the variance may fall in a step; `rounds`: most steps.
    """
    power, left = (part_power / np.mean(part_power, axis=1, keepdims=True) for part_power in (power, left))
    part = np.stack([np.median(left, axis=1), np.full(len(left), 1e-4)], axis=1)
    moving = np.arange(len(part))
    for _ in range(rounds):
        part_power, constant, growing = power[moving], part[moving, :1], part[moving, 1:]
        first = 1.0 / (constant + growing * part_power)
        second, target = part_power * first, left[moving] * first - 1.0
        rows = np.stack([first, second], axis=1)
        size = np.linalg.norm(rows, axis=2, keepdims=True)
        rows /= size
        normal = np.linalg.pinv(rows @ rows.swapaxes(1, 2), rcond=1e-12, hermitian=True)
        step = (normal @ (rows @ target[..., None]) / size)[..., 0]
        changed = np.maximum(part[moving] + step, part[moving] / factor)
        still = np.any(np.abs(changed - part[moving]) > settled * part[moving], axis=1)
        part[moving] = changed
        moving = moving[still]
        if not moving.size:
            break
    return np.asarray(1.0 / (part[:, :1] + part[:, 1:] * power))


MAX_DAMPING = 0.3
"""Poles damped more than this are never taken for resonances."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Functions:
    """Functions to fit as rows.

    Attributes
    ----------
    frequency : (n_frequency,) float
        Lines of the band above 0 Hz.
    value : (n_function, n_frequency) complex
    run : (n_function,) int
        Roving run of each function.
    quantity : {"receptance", "mobility", "accelerance"}
    weight : (n_function, n_frequency) float
        Inverse variances that the coherences lead to (`coherence_weight`); ones where there are none.
    """

    frequency: Reals
    value: Complexes
    run: Integers
    quantity: Quantity
    weight: Reals

    def linear_fit(self, pole: Complexes, weight: Reals | None = None) -> Fit:
        """Fit residues and residual terms at fixed poles; all lines weigh the same where no weights are given."""
        return linear_fit(self.frequency, self.value, pole, self.quantity, weight)

    def weigh_by_misfit(self, fit: Fit) -> Fit:
        """Fit residues at the poles of a fit with lines that weigh by the misfit, which they change in turn."""
        weighings = 3
        for _ in range(weighings):
            fit = self.linear_fit(fit.pole, misfit_weight(self.value - fit.residual, fit.residual))
        return fit

    def of_run(self, number: int) -> Functions:
        """Return the functions of one run."""
        members = self.run == number
        if members.all():
            return self
        return replace(self, value=self.value[members], run=self.run[members], weight=self.weight[members])


def inside(pole: Complexes, band: tuple[float, float]) -> Booleans:
    """Tell which poles the band (Hz) holds with at least one half bandwidth on each side."""
    hertz, half_bandwidth = np.abs(pole) / (2.0 * np.pi), -pole.real / (2.0 * np.pi)
    return (hertz - half_bandwidth >= band[0]) & (hertz + half_bandwidth <= band[1])


def resonant(pole: Complexes, band: tuple[float, float]) -> Booleans:
    """Tell which poles are results: inside the band (Hz), and damped no more than a resonance can be.

    A pole that refinement damps further stands for the background of the modes, as those beyond the band do.
    """
    return inside(pole, band) & (-pole.real <= MAX_DAMPING * np.abs(pole))


def response(data: Functions, pole: Complexes, residue: Complexes) -> Complexes:
    """Return what modes, (n_mode,) poles and (n_function, n_mode) residues, add to functions over their lines."""
    coefficient = np.stack([residue.real.T, residue.imag.T], axis=1).reshape(-1, residue.shape[0])
    parts = mode_basis(data.frequency, pole, data.quantity) @ coefficient
    answer = np.empty((parts.shape[1], data.frequency.size), complex)  # filled by halves, for it may be large
    answer.real, answer.imag = parts[: data.frequency.size].T, parts[data.frequency.size :].T
    return answer
