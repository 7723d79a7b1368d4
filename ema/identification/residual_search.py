"""Peaks that the measured functions show and the fitted modes leave unexplained: tried as modes, or listed.

A peak is judged in its own surroundings. What is left of the functions there is fitted once with the modes that are
near and once with one more; the likelihood of these lines alone decides, so that a misfit of a strong mode elsewhere in
the band, or noise of another size, does not hide a mode that anyone sees in the function.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.special as special
from numpy.typing import NDArray

from ema.identification.functions import Functions, inside
from ema.identification.lsfd import mode_basis
from ema.identification.maximum_likelihood import Fit, refine
from ema.identification.significance import MIN_COLLINEARITY, MIN_REALNESS, inflation, is_split, judge
from ema.identification.stabilization import MAX_DAMPING

PROMINENCE = 3.0
"""Least height of a peak of the summed power over the valleys beside it, dB."""
LEAST_SHARE = 0.1
"""Share of a peak's power from which on it counts as unexplained."""
MOST_LEFT = 0.5
"""Share of what was unexplained of a peak that may be left when its mode is taken in."""
FALSE_ALARM = 1e-3
"""Chance that noise around a peak brings forth a pole in it."""
SURROUNDINGS = 8.0
"""Half bandwidths on each side of a peak on which it is judged, and at least `FEWEST_LINES` lines."""
FEWEST_LINES = 16
MANY_FUNCTIONS = 3
"""Functions from which on shapes and phases tell a mode from a second pole in the resonance of another one."""
WANDER = 0.5
"""Half bandwidths that a pole judged on the lines around it may move when all are refined together."""
_NOISE_LINES = 50
_TRIES = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Peak:
    """A peak of the summed power that the modes leave unexplained.

    Attributes
    ----------
    line : int
        Line of its largest value.
    frequency : float
        Its place, Hz.
    half_width : float
        Half of its half-power bandwidth, lines.
    share : float
        Share of its power within the half-power bandwidth that is left.
    left : (n_function,) float
        The same for each function.
    """

    line: int
    frequency: float
    half_width: float
    share: float
    left: NDArray[np.float64]


Left = tuple[tuple[Peak, str], ...]
"""Peaks that stay unexplained, each with the reason why."""


def unexplained_peaks(data: Functions, fit: Fit) -> list[Peak]:
    """Find peaks of the measured functions that stand out of the noise of what a fit leaves, the largest first."""
    from scipy.signal import find_peaks  # here: it takes long to import, and other commands do not need it

    size = np.mean(np.abs(data.value) ** 2, axis=1, keepdims=True)
    each, rest = np.abs(data.value) ** 2 / size, np.abs(fit.residual) ** 2 / size
    power, left = each.sum(axis=0), rest.sum(axis=0)
    found = []
    lines, _ = find_peaks(10.0 * np.log10(np.maximum(power, 1e-12 * power.max())), prominence=PROMINENCE)
    for line in lines:
        first, last = _half_power(power, int(line))
        window = slice(first, last + 1)
        share = float(left[window].sum() / power[window].sum())
        if share > LEAST_SHARE and _stands_out(fit.residual, window):
            shares = rest[:, window].sum(axis=1) / each[:, window].sum(axis=1)
            half_width = max(0.5 * (last - first), 0.5)
            place = float(data.frequency[line])
            found.append(
                Peak(line=int(line), frequency=place, half_width=half_width, share=share, left=shares)
            )
    return sorted(found, key=lambda peak: -left[peak.line])


def _half_power(power: NDArray[np.float64], line: int) -> tuple[int, int]:
    """First and last line around a peak that hold more than half of its power."""
    below = np.flatnonzero(power < 0.5 * power[line])
    before, after = below[below < line], below[below > line]
    first = int(before[-1]) + 1 if before.size else 0
    last = int(after[0]) - 1 if after.size else power.size - 1
    return first, last


def _stands_out(rest: NDArray[np.complex128], window: slice) -> bool:
    """Whether what is left in a window is more than the noise around it, of each function its own, brings.

    The noise is that of the second differences from line to line, which no smooth misfit enlarges.
    """
    near = rest[:, max(0, window.start - _NOISE_LINES) : window.stop + _NOISE_LINES]
    difference = np.abs(np.diff(near, 2, axis=1)) ** 2 / 6.0
    noise = np.median(difference, axis=1, keepdims=True) / np.log(2.0)
    left = np.abs(rest[:, window]) ** 2
    statistic = 2.0 * np.sum(left / np.maximum(noise, np.finfo(float).tiny))
    return bool(statistic > special.chdtri(2 * left.size, 1e-4 / rest.shape[1]))


def try_peak(
    data: Functions,
    fit: Fit,
    peak: Peak,
    start: NDArray[np.complex128],
    band: tuple[float, float],
) -> tuple[NDArray[np.complex128] | None, str]:
    """Judge a peak on the lines around it, from each of several starting poles.

    Returns
    -------
    pole : (n_mode,) complex or None
        Poles of the whole fit with the likeliest one of the peak last and those near it refined beside it, rad/s;
        None if it is not to be taken in.
    reason : str
        Why not.
    """
    window = _surroundings(data.frequency.size, peak)
    frequency = data.frequency[window]
    spacing = 2.0 * np.pi * float(data.frequency[1] - data.frequency[0])
    place = 2.0 * np.pi * peak.frequency
    near = (fit.pole.imag > 2.0 * np.pi * frequency[0]) & (fit.pole.imag < 2.0 * np.pi * frequency[-1])
    old = fit.pole[near]
    target = fit.residual[:, window] + _response(data, fit, near, window)
    n = target.shape[0]
    many = n >= MANY_FUNCTIONS
    threshold = float(special.chdtri(2 * n + 2, FALSE_ALARM / frequency.size))
    without = refine(frequency, target, old, data.quantity)
    best: tuple[float, NDArray[np.complex128]] | None = None
    reason = "no pole of the fit comes to rest there"
    for pole in start:
        extended = refine(frequency, target, np.append(old, pole), data.quantity)
        new = complex(extended.pole[-1])
        gain = 2.0 * (without.objective - extended.objective) / inflation(extended.whitened)
        verdicts = judge(frequency, extended, data.quantity)
        modal = verdicts.collinearity[-1] >= MIN_COLLINEARITY and verdicts.realness[-1] >= MIN_REALNESS
        std = float(np.sqrt(extended.pole_covariance[-1, -1]))
        if gain < threshold:
            reason = (
                f"the likelihood rises by {0.5 * gain:.3g} of the {0.5 * threshold:.3g} that noise may bring"
            )
        elif verdicts.statistic[-1] < (verdicts.threshold if many else special.chdtri(2 * n, FALSE_ALARM)):
            reason = "its residues do not stand out of the noise"
        elif many and not modal:
            reason = "its residues have not the phases of a mode"
        elif not inside(extended.pole, band)[-1]:
            reason = "its bandwidth reaches beyond the band"
        elif -new.real > MAX_DAMPING * abs(new) or std > -new.real or -new.real < 0.02 * spacing:
            reason = "its damping is not determined"
        elif np.any(np.abs(extended.pole[:-1].imag - place) < abs(new.imag - place)):
            reason = "one resonance that is not that of a linear mode: a second pole takes its misfit"
        elif _is_double(extended):
            reason = "one resonance fitted twice: its shape is that of the mode beside it"
        elif not _explains(data, extended, peak, window):
            reason = "a mode there explains less than half of it"
        elif best is None or gain > best[0]:
            best = gain, extended.pole
    return (None, reason) if best is None else (np.concatenate([fit.pole[~near], best[1]]), "")


def _surroundings(n_line: int, peak: Peak) -> slice:
    reach = int(max(np.ceil(SURROUNDINGS * peak.half_width), FEWEST_LINES))
    return slice(max(0, peak.line - reach), min(n_line, peak.line + reach + 1))


def _response(data: Functions, fit: Fit, mode: NDArray[np.bool_], window: slice) -> NDArray[np.complex128]:
    """Response ``(n_function, n_line)`` of some modes of a fit on some lines."""
    frequency = data.frequency[window]
    basis = mode_basis(frequency, fit.pole[mode], data.quantity)
    parts = np.stack([fit.residue[:, mode].real.T, fit.residue[:, mode].imag.T], axis=1)
    stacked = basis @ parts.reshape(-1, fit.residue.shape[0])
    return (stacked[: frequency.size] + 1j * stacked[frequency.size :]).T


def _is_double(fit: Fit) -> bool:
    """Whether the last pole shares the shape of one within its bandwidth; of few functions, whether it is as near."""
    if fit.residue.shape[0] >= MANY_FUNCTIONS:
        return is_split(fit, -1)
    old, new = fit.pole[:-1], fit.pole[-1]
    return bool(np.any(np.abs(old.imag - new.imag) < 0.5 * np.maximum(-old.real, -new.real)))


def _explains(data: Functions, fit: Fit, peak: Peak, window: slice) -> bool:
    """Whether a local fit leaves little of what was unexplained of a peak."""
    first = round(peak.line - peak.half_width) - window.start
    core = slice(max(0, first), round(peak.line + peak.half_width) - window.start + 1)
    size = np.mean(np.abs(data.value) ** 2, axis=1, keepdims=True)
    left = np.sum(np.abs(fit.residual[:, core]) ** 2 / size)
    whole = np.sum(np.abs(data.value[:, window][:, core]) ** 2 / size)
    return bool(left < max(MOST_LEFT * peak.share, LEAST_SHARE) * whole)


def starting_poles(data: Functions, peak: Peak, candidates: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Poles from which a peak is tried: the stable ones near it first, then that of its half-power bandwidth."""
    spacing = 2.0 * np.pi * float(data.frequency[1] - data.frequency[0])
    half_bandwidth = spacing * peak.half_width
    place = 2.0 * np.pi * peak.frequency
    near = np.abs(candidates.imag - place) < 2.0 * half_bandwidth
    return np.append(candidates[near], complex(-half_bandwidth, place))


def take_in_peaks(
    data: Functions, fit: Fit, candidates: NDArray[np.complex128], band: tuple[float, float]
) -> tuple[Fit, Left]:
    """Try what the functions show as a peak and the modes do not explain, until all of it is tried.

    Parameters
    ----------
    data : Functions
    fit : Fit
        The modes so far.
    candidates : (n_candidate,) complex
        Stable poles, rad/s, that may have been dropped.
    band : (float, float)
        Where modes are wanted, Hz.

    Returns
    -------
    fit : Fit
        All modes together.
    left : tuple of (Peak, str)
        Peaks that stay unexplained, each with the reason why it was not taken in.
    """
    reasons: dict[int, str] = {}
    tries: dict[int, int] = {}
    searching = True
    while searching:
        searching = False
        for peak in unexplained_peaks(data, fit):
            # A peak brings one mode, and again only if that was lost: what another would take of it is misfit.
            if peak.line in reasons or tries.get(peak.line, 0) >= _TRIES or _has_pole(data, fit, peak):
                continue
            tries[peak.line] = tries.get(peak.line, 0) + 1
            pole, reason = try_peak(data, fit, peak, starting_poles(data, peak, candidates), band)
            if pole is None:
                reasons[peak.line] = reason
            else:
                fit = data.linear_fit(pole)
                searching = True
        if searching:
            fit = _settled(data, fit)
    misfit = "a mode is there, but the resonance is not that of a linear mode"
    return fit, tuple((peak, reasons.get(peak.line, misfit)) for peak in unexplained_peaks(data, fit))


def _has_pole(data: Functions, fit: Fit, peak: Peak) -> bool:
    spacing = float(data.frequency[1] - data.frequency[0])
    distance = np.abs(fit.pole.imag / (2.0 * np.pi) - peak.frequency)
    return bool(np.any(distance <= spacing * max(peak.half_width, 1.0)))


def _settled(data: Functions, fit: Fit) -> Fit:
    """Refine all modes together, but hold those that would wander to the misfit of stronger ones."""
    refined = refine(data.frequency, data.value, fit.pole, data.quantity)
    wanders = np.abs(refined.pole - fit.pole) > -WANDER * fit.pole.real
    if not wanders.any():
        return refined
    return refine(data.frequency, data.value, fit.pole[~wanders], data.quantity, held=fit.pole[wanders])
