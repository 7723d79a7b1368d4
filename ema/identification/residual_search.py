"""Peaks that the fitted modes leave unexplained: tried as modes, or listed with the reason why not.

A peak is judged in its own surroundings. What is left of the functions there is fitted once with the modes that are
near and once with one more; the likelihood of these lines alone decides, so that a misfit of a strong mode elsewhere in
the band, or noise of another size, does not hide a mode that anyone sees in the function. Peaks that are near each
other hide each other, since what one leaves counts as noise of the next: such a peak is tried beside poles for the
others, too, which are then judged in their turn.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.identification.functions import MAX_DAMPING, Functions, inside, response
from ema.identification.maximum_likelihood import Fit, linear_fit, refine
from ema.identification.significance import (
    MIN_COLLINEARITY,
    MIN_REALNESS,
    SPLIT_DISTANCE,
    inflation,
    is_confined,
    is_split,
    judge,
)
from ema.identification.unexplained import (
    LEAST_ALONE,
    LEAST_SHARE,
    Peak,
    holds_pole,
    left_of_functions,
    unexplained_peaks,
)

_LOG = logging.getLogger(__name__)
MOST_LEFT = 0.5
"""Share of what was unexplained of a peak that may be left when its mode is taken in."""
FALSE_ALARM = 1e-3
"""Chance that noise around a peak brings forth a pole in it."""
FAR_FROM_NOISE = 2.0
"""Thresholds of the likelihood within which a peak that is not taken in is noise and not listed."""
SURROUNDINGS = 8.0
"""Half bandwidths on each side of a peak on which it is judged, and at least `FEWEST_LINES` lines."""
FEWEST_LINES = 16
MANY_FUNCTIONS = 3
"""Functions from which on shapes and phases tell a mode from a second pole in the resonance of another one."""
ROUGH_FUNCTIONS, ROUGH_REALNESS, ROUGH_COLLINEARITY = 8, 0.8, 0.5
"""Functions from which on phases as rough as these are no chance where a peak is seen; random ones reach 0.5, 0.1."""
RESOLVED_LINES = 4.0
"""Lines in a half bandwidth from which on a peak that is a pole's in as many functions, to `LEAST_SHARE` of its power,
is a resonance whichever way its residues are turned: by cross-talk, filters or a force that is not where it is said."""
LISTED = 0.3
"""Share that is left of a peak with a mode, or of one that is hidden between others, from which on it is told."""
LEAKAGE = 2.5
"""Lines beside a resonance within which nothing but shapes tells a second one."""
WANDER = 0.5
"""Half bandwidths that a pole judged on the lines around it may move when all are refined together."""
_IN_PHASE = 0.8  # collinearity from which on residues are alike among points
_TRIES = 3
_LESS = "a mode there explains less than half of it"
_NONE = np.empty(0, dtype=complex)


@dataclass(frozen=True, eq=False, kw_only=True)
class Surroundings:
    """The lines around a peak, fitted with the modes that are near.

    Attributes
    ----------
    lines : slice
        Which ones.
    frequency : (n_line,) float
        Hz.
    target : (n_function, n_line) complex
        The functions less the response of the modes that are not near.
    near : (n_mode,) bool
        Which modes of the whole fit are.
    without : Fit
        The fit of `target` with these alone.
    """

    lines: slice
    frequency: NDArray[np.float64]
    target: NDArray[np.complex128]
    near: NDArray[np.bool_]
    without: Fit


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """Why a peak is not taken in as a mode.

    Attributes
    ----------
    reason : str
        In words.
    least : float
        Share of its power, left by the modes in the end, from which on it is still a peak that a user is to know of:
        infinite if it is noise.
    """

    reason: str
    least: float = LEAST_ALONE


Left = tuple[tuple[Peak, str], ...]
"""Peaks that stay unexplained, each with the reason why."""


def _reach(peak: Peak) -> int:
    """Lines on each side of a peak that are its surroundings."""
    return int(max(np.ceil(SURROUNDINGS * peak.half_width), FEWEST_LINES))


def surroundings(data: Functions, fit: Fit, peak: Peak) -> Surroundings:
    """Fit the lines around a peak with the modes that are near."""
    reach = _reach(peak)
    lines = slice(max(0, peak.line - reach), min(data.frequency.size, peak.line + reach + 1))
    frequency = data.frequency[lines]
    near = (fit.pole.imag > 2.0 * np.pi * frequency[0]) & (fit.pole.imag < 2.0 * np.pi * frequency[-1])
    around = replace(data, frequency=frequency)
    target = fit.residual[:, lines] + response(around, fit.pole[near], fit.residue[:, near])
    without = refine(frequency, target, fit.pole[near], data.quantity)
    if holds_pole(data, without, peak) and not holds_pole(
        data, fit, peak
    ):  # one that was drawn into the peak
        without = linear_fit(frequency, target, fit.pole[near], data.quantity)
    return Surroundings(lines=lines, frequency=frequency, target=target, near=near, without=without)


def _with_others(
    data: Functions, around: Surroundings, peak: Peak, beside: NDArray[np.complex128]
) -> Surroundings:
    """Fit the lines around a peak with poles of other peaks, too; one that is drawn into the peak stays in its own."""
    pole = np.append(around.without.pole, beside)
    without = refine(around.frequency, around.target, pole, data.quantity)
    if holds_pole(data, without, peak):
        without = linear_fit(around.frequency, around.target, pole, data.quantity)
    return replace(around, without=without)


def try_peak(
    data: Functions,
    fit: Fit,
    peak: Peak,
    start: NDArray[np.complex128],
    band: tuple[float, float],
    beside: NDArray[np.complex128] = _NONE,
) -> NDArray[np.complex128] | Refusal:
    """Judge a peak on the lines around it, from each of several starting poles.

    Parameters
    ----------
    data : Functions
    fit : Fit
        The modes so far.
    peak : Peak
    start : (n_start,) complex
        Poles to begin with, rad/s.
    band : (float, float)
        Where modes are wanted, Hz.
    beside : (n_beside,) complex
        Poles, rad/s, that other peaks nearby may have: fitted beside it, and neither judged nor returned.

    Returns
    -------
    (n_mode,) complex or Refusal
        Poles of the whole fit with the likeliest one of the peak last and those near it refined beside it, rad/s;
        or why it is not to be taken in.
    """
    around = surroundings(data, fit, peak)
    if beside.size:
        around = _with_others(data, around, peak, beside)
    if _share_left(data, around, around.without, peak) < LEAST_SHARE * min(peak.share, 1.0):
        # Such lines count for little beside resonances; but what anyone sees there is in no mode of the result.
        return Refusal(
            reason="the modes explain it where the lines around it are fitted alone, but not beside all others",
            least=_least(peak, LISTED),
        )
    best: tuple[float, NDArray[np.complex128]] | None = None
    refusal = Refusal(reason="no pole of the fit comes to rest there")
    for pole in start:
        extended = refine(
            around.frequency, around.target, np.append(around.without.pole, pole), data.quantity
        )
        objection = next(_objections(data, around, extended, peak, band), None)
        if objection is not None:
            refusal = objection
        elif best is None or extended.objective < best[0]:
            best = extended.objective, extended.pole
    if best is None:
        return refusal
    n_near = int(np.count_nonzero(around.near))
    return np.concatenate([fit.pole[~around.near], best[1][:n_near], best[1][-1:]])


def _objections(
    data: Functions, around: Surroundings, extended: Fit, peak: Peak, band: tuple[float, float]
) -> Iterator[Refusal]:
    """Say what speaks against the last pole of a fit of the lines around a peak, the weightiest first."""
    n_function = extended.residue.shape[0]
    new = complex(extended.pole[-1])
    spacing = 2.0 * np.pi * float(data.frequency[1] - data.frequency[0])
    apart = np.abs(extended.pole.imag - 2.0 * np.pi * peak.frequency)
    gain = 2.0 * (around.without.objective - extended.objective)
    threshold = float(scipy.special.chdtri(2 * n_function + 2, FALSE_ALARM / around.frequency.size))
    verdicts = judge(around.frequency, extended, data.quantity)
    far = gain > FAR_FROM_NOISE * threshold
    correlated = threshold * inflation(extended.whitened())
    if gain < correlated:
        reason = (
            f"the likelihood rises by {0.5 * gain:.3g} of the {0.5 * correlated:.3g} that noise may bring"
        )
        yield Refusal(reason=reason, least=LEAST_ALONE if far else np.inf)
    if verdicts.statistic[-1] < verdicts.threshold:
        # Where both the summed power and the likelihood stand out of the noise, each function need not.
        least = LEAST_ALONE if far else _least(peak, LEAST_SHARE)
        yield Refusal(reason="its residues do not stand out of the noise", least=least)
    if apart[-1] > spacing * max(2.0 * peak.half_width, 1.0):
        yield Refusal(reason="no pole of the fit comes to rest there")
    modal = verdicts.collinearity[-1] >= MIN_COLLINEARITY and verdicts.realness[-1] >= MIN_REALNESS
    rough = verdicts.collinearity[-1] >= ROUGH_COLLINEARITY and verdicts.realness[-1] >= ROUGH_REALNESS
    if -new.real > RESOLVED_LINES * spacing and _share_left(data, around, extended, peak) < LEAST_SHARE:
        rough = rough or verdicts.collinearity[-1] >= ROUGH_COLLINEARITY
    if n_function >= MANY_FUNCTIONS and not (modal or (rough and _stands_alone(extended, peak))):
        yield Refusal(reason=_of_phases(extended.residue[:, -1], new, verdicts.collinearity[-1]))
    if not inside(extended.pole, band)[-1]:
        yield Refusal(reason="its bandwidth reaches beyond the band")
    std = float(np.sqrt(extended.pole_covariance[-1, -1]))
    if -new.real > MAX_DAMPING * abs(new) or std > -new.real or -new.real < 0.02 * spacing:
        yield Refusal(reason="its damping is not determined")
    if np.any(apart[:-1] < apart[-1]):
        reason = "one resonance that is not that of a linear mode: a second pole takes its misfit"
        yield Refusal(reason=reason)
    if _is_double(extended, spacing):
        yield Refusal(reason="one resonance fitted twice: its shape is that of the mode beside it")
    if is_confined(extended, data.run)[-1]:
        yield Refusal(reason="it is seen in one run only, beside a mode that is elsewhere there")
    if _share_left(data, around, extended, peak) > max(MOST_LEFT * peak.share, LEAST_SHARE):
        yield Refusal(reason=_LESS)


def _of_phases(residue: NDArray[np.complex128], pole: complex, collinearity: float) -> str:
    """Say what is wrong with the phases of residues: against each other, or all together against the force."""
    reason = "its residues have not the phases of a mode"
    if collinearity < _IN_PHASE:
        return reason
    constant = 2j * pole.imag * residue
    angle = float(np.degrees(abs(np.angle(np.sum(constant**2)) / 2.0)))
    return f"{reason}: alike among points, but turned by {angle:.0f} degrees against the force, as by filters or delays"


def _least(peak: Peak, share: float) -> float:
    """Share from which on a peak is listed whose power must have been left by so much, when it was tried or is now."""
    if not peak.visible:
        return np.inf
    return LEAST_ALONE if peak.share > share else share


def _stands_alone(fit: Fit, peak: Peak) -> bool:
    """Whether a peak is clear enough for its residues to have rough phases: seen in many functions, beside none."""
    clear = fit.residue.shape[0] >= ROUGH_FUNCTIONS and (peak.visible or peak.share > LISTED)
    old, new = fit.pole[:-1], fit.pole[-1]
    return clear and bool(np.all(np.abs(old - new) > -SPLIT_DISTANCE * (old.real + new.real)))


def _is_double(fit: Fit, spacing: float) -> bool:
    """Whether the last pole shares the shape of one within its bandwidth; of few functions, whether it is as near.

    A resonance that is narrower than the spacing of the lines (rad/s) leaks into those beside it.
    """
    if fit.residue.shape[0] >= MANY_FUNCTIONS:
        return is_split(fit, -1)
    old, new = fit.pole[:-1], fit.pole[-1]
    reach = np.maximum(0.5 * np.maximum(-old.real, -new.real), LEAKAGE * spacing)
    return bool(np.any(np.abs(old.imag - new.imag) < reach))


def _share_left(data: Functions, around: Surroundings, local: Fit, peak: Peak) -> float:
    """Share of the power of a peak that a fit of the lines around it leaves."""
    size = np.mean(np.abs(data.value) ** 2, axis=1, keepdims=True)
    core = slice(peak.first - around.lines.start, peak.last + 1 - around.lines.start)
    left = np.sum(np.abs(local.residual[:, max(core.start, 0) : core.stop]) ** 2 / size)
    whole = np.sum(np.abs(data.value[:, around.lines][:, max(core.start, 0) : core.stop]) ** 2 / size)
    return float(left / whole)


def starting_poles(data: Functions, peak: Peak, candidates: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Poles from which a peak is tried: the stable ones near it first, then that of its half-power bandwidth."""
    spacing = 2.0 * np.pi * float(data.frequency[1] - data.frequency[0])
    half_bandwidth = spacing * peak.half_width
    place = 2.0 * np.pi * peak.frequency
    near = np.abs(candidates.imag - place) < 2.0 * half_bandwidth
    return np.append(candidates[near], complex(-half_bandwidth, place))


def _beside(
    data: Functions, fit: Fit, peak: Peak, candidates: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Poles for the other peaks without one that anyone sees around a peak, each its likeliest starting pole."""
    reach = _reach(peak)
    others = [
        starting_poles(data, other, candidates)[0]
        for other in unexplained_peaks(data, fit)
        if other.visible
        and 0 < abs(other.line - peak.line) <= reach
        and not peak.first <= other.line <= peak.last
        and not holds_pole(data, fit, other)
    ]
    return np.array(others, dtype=complex)


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
    refused: dict[int, Refusal] = {}
    tries: dict[int, int] = {}
    while True:
        taken: list[Peak] = []
        for peak in _told(data, fit):
            # A peak brings one mode, and again only if that was lost: what another would take of it is misfit.
            if peak.line in refused or tries.get(peak.line, 0) >= _TRIES or holds_pole(data, fit, peak):
                continue
            tries[peak.line] = tries.get(peak.line, 0) + 1
            _LOG.debug("try the peak at %.5g Hz", peak.frequency)
            start = starting_poles(data, peak, candidates)
            found = try_peak(data, fit, peak, start, band)
            if isinstance(found, Refusal):
                others = _beside(data, fit, peak, candidates)
                again = try_peak(data, fit, peak, start, band, others) if others.size else found
                found = found if isinstance(again, Refusal) else again
            if isinstance(found, Refusal):
                refused[peak.line] = found
            else:
                fit = data.linear_fit(found, fit.weight)
                taken.append(peak)
        if not taken:
            return fit, _listed(data, fit, refused)
        # What hid a peak may be among what is taken in beside it.
        refused = {
            line: refusal
            for line, refusal in refused.items()
            if not any(abs(line - peak.line) <= _reach(peak) for peak in taken)
        }
        fit, useless = _without_useless(data, settled(data, fit), taken)
        refused |= dict.fromkeys(useless, Refusal(reason=_LESS))


def settled(data: Functions, fit: Fit) -> Fit:
    """Refine all modes together, but hold those that would wander to the misfit of stronger ones."""
    refined = refine(data.frequency, data.value, fit.pole, data.quantity, fit.weight)
    wanders = np.abs(refined.pole - fit.pole) > -WANDER * fit.pole.real
    if not wanders.any():
        return refined
    held = fit.pole[wanders]
    return refine(data.frequency, data.value, fit.pole[~wanders], data.quantity, fit.weight, held=held)


def _without_useless(data: Functions, fit: Fit, taken: list[Peak]) -> tuple[Fit, list[int]]:
    """Give up modes that explained their peaks on the lines around them, but do not beside all others.

    The misfit of much stronger modes may be as large as such a peak, and its residue goes there. So it is first tried
    whether lines that weigh by that misfit leave it its own.
    """
    useless = _useless(data, fit, taken)
    if useless:
        weighted = settled(data, data.weigh_by_misfit(fit))
        still = _useless(data, weighted, taken)
        if len(still) < len(useless) and weighted.objective < fit.objective:
            fit, useless = weighted, still
    if not useless:
        return fit, []
    place = 2.0 * np.pi * np.array([peak.frequency for peak in useless])
    lost = np.unique(np.abs(fit.pole.imag[:, None] - place).argmin(axis=0))
    without = data.linear_fit(np.delete(fit.pole, lost), fit.weight)
    return settled(data, without), [peak.line for peak in useless]


def _useless(data: Functions, fit: Fit, taken: list[Peak]) -> list[Peak]:
    """Peaks of which a fit leaves the most."""
    shares = [left_of_functions(data, fit, peak.window) for peak in taken]
    # Some functions may show nothing but noise there.
    return [peak for peak, share in zip(taken, shares, strict=True) if np.median(share) > MOST_LEFT]


def _told(data: Functions, fit: Fit) -> list[Peak]:
    """Unexplained peaks that may be modes: of few functions nothing but what is seen tells one from a misfit."""
    many = data.value.shape[0] >= MANY_FUNCTIONS
    return [peak for peak in unexplained_peaks(data, fit) if peak.visible or many]


def _listed(data: Functions, fit: Fit, refused: dict[int, Refusal]) -> Left:
    """Peaks that a user is to know of, with the reasons."""
    left: list[tuple[Peak, str]] = []
    for peak in _told(data, fit):
        refusal = refused.get(peak.line)
        if holds_pole(data, fit, peak):
            if peak.visible and peak.share > LISTED:
                left.append((peak, "a mode is there, but the resonance is not that of a linear mode"))
        elif peak.share > max(
            LEAST_ALONE if peak.visible else LISTED, LEAST_ALONE if refusal is None else refusal.least
        ):
            left.append((peak, _LESS if refusal is None else refusal.reason))
    return tuple(left)
