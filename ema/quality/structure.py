"""Whether functions are FRFs of one structure in one state: their form, copies among them, and runs of other states.

Small shifts from run to run, as a roving sensor's mass or temperature makes them, are compared after the
identification (`ema.identification.run_poles`). Here whole runs are separated that have other resonances, such as
files of another bolt torque.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.quality.peaks import MIN_LINES, peaks
from ema.quality.verdict import Verdict
from ema.types.arrays import in_blocks
from ema.types.frf import FRF
from lamella_shared import Integers, Reals

LINES_OF_A_FUNCTION = 64
"""Fewer lines do not tell noise from a function."""
_APART = (8, 13)
"""Lines, of which noise shares nothing even where a window has smeared it over its neighbours."""


@dataclass(frozen=True, kw_only=True)
class Formless:
    """An output without the form of a function, None for all of them; whether it is noise alone, else it is flat."""

    channel: int | None
    is_noise: bool
    message: str


def formless(frf: FRF, channels: Integers, *, flat: float = 3.0, not_flat: float = 15.0) -> Iterator[Formless]:
    """Give outputs that are noise alone or flat beside others that are functions; of noise alone, all at once.

    Parameters
    ----------
    frf : FRF
    channels : (n_channel,) int
        Outputs that are looked at.
    flat, not_flat : float
        Range of levels, dB, of an output without a resonance, and of the usual one beside which it is reported.
    """
    # Noise is less steady than this over the root of the lines, even smeared by a window; and the most of that limit.
    steadiest, most = 3.5, 0.45
    # Steadiness that some output must have before another is called one of noise; of measured sets it is 0.58 or more.
    least_steady = 0.5
    if frf.frequency.size < LINES_OF_A_FUNCTION or not channels.size:
        return
    steady, levels = steadiness(frf, channels), span(frf, channels)
    noise = min(steadiest / np.sqrt(_lines(frf) - max(_APART)), most)
    if np.all(steady < noise):
        message = (
            f"no function has a phase that stays from line to line (steadiness {steady.max():.2f} at most, that of "
            f"noise is below {noise:.2f}): is the force plugged in, and does it excite this band? Else give band_Hz"
        )
        yield Formless(channel=None, is_noise=True, message=message)
        return
    if steady.max() < least_steady:
        return
    usual = float(np.median(steady[steady >= noise]))
    for channel, share, width in zip(channels, steady, levels, strict=True):
        if share < noise:
            message = (
                f"dead, its phase jumps from line to line as that of noise does (steadiness {share:.2f}, "
                f"of the others {usual:.2f} in the median): unplugged, broken, or its response is below its noise"
            )
            yield Formless(channel=int(channel), is_noise=True, message=message)
        elif width < flat and np.median(levels) > not_flat:
            message = (
                f"its level spans {width:.2g} dB where that of the others spans {np.median(levels):.2g} dB in the "
                "median: it follows the force without a resonance, as a channel does that picks up the force's signal"
            )
            yield Formless(channel=int(channel), is_noise=False, message=message)


def steadiness(frf: FRF, channels: Integers) -> Reals:
    """Return how steady the phase of each output is from line to line, in the best part of the band: (n_channel,).

    It is the length of the mean of unit vectors that point where the phase has turned between lines some apart: 1 for
    a phase that stays or turns evenly, about one over the square root of the number of lines for noise. Peaks, however
    high, count no more than the lines between them.

    Parameters
    ----------
    frf : FRF
        At least `LINES_OF_A_FUNCTION` lines.
    channels : (n_channel,) int
        Outputs.
    """
    shares = []
    for block in in_blocks(channels):
        value = frf.value[block]
        size = np.abs(value)
        unit = np.where(size > 0, value / np.where(size > 0, size, 1.0), 0.0)
        steady = [
            np.abs(np.mean(part[..., n:] * part[..., :-n].conj(), axis=2))
            for part in np.array_split(unit, frf.frequency.size // _lines(frf), axis=2)
            for n in _APART
        ]
        shares.append(np.max(steady, axis=(0, 2)))
    return np.concatenate(shares)


def _lines(frf: FRF, *, parts: int = 8) -> int:
    """Return how many lines a part of the band has.

    `parts`: parts of the band, of which one with a function in it is enough: above what a hammer excites is noise
    alone.
    """
    return max(LINES_OF_A_FUNCTION, frf.frequency.size // parts)


def span(frf: FRF, channels: Integers) -> Reals:
    """Return the range of levels over the lines of each output, of its functions the widest, dB: (n_channel,)."""
    ends = (5.0, 95.0)
    spans = []
    for block in in_blocks(channels):
        value = frf.value[block][..., frf.frequency > 0]
        level = 20 * np.log10(np.maximum(np.abs(value), np.finfo(float).tiny))
        low, high = np.percentile(level, ends, axis=2)
        spans.append((high - low).max(axis=1))
    return np.concatenate(spans)


def content_digests(frf: FRF) -> tuple[str, ...]:
    """Return a digest of the values of each output's functions: files of other names and headers have the same."""
    return tuple(hashlib.sha256(value.tobytes()).hexdigest() for value in frf.value)


def repeated(frf: FRF, channels: Integers) -> Iterator[Verdict]:
    """Find outputs of one configuration that hold the same functions.

    Parameters
    ----------
    frf : FRF
        All functions.
    channels : (n,) int
        Positions of sound outputs.
    """
    digest, first = content_digests(frf), dict[str, int]()
    for channel in channels:
        before = first.setdefault(digest[channel], int(channel))
        if before != channel:
            both = f"{channel_label(frf, before)} and {channel_label(frf, int(channel))}"
            message = f"{both} hold the same values to the last digit: one is a copy of the other's file or column"
            yield Verdict(check="copied", level="warn", channel=(before, int(channel)), band=None, message=message)


def shared_functions(digests: Mapping[str, tuple[str, ...]], *, most: int = 3) -> tuple[str, ...]:
    """Say which configurations hold functions of another one.

    Parameters
    ----------
    digests : mapping of str to tuple of str
        Of each configuration the digests of its functions, see `content_digests`.
    most : int
        Configurations that are listed one by one.
    """
    names, sentences = list(digests), []
    for i, name in enumerate(names):
        for other in names[:i]:
            common = set(digests[name]) & set(digests[other])
            if common:
                sentences.append(
                    f"{other} and {name} share {len(common)} of {len(digests[name])} functions to the last digit: "
                    "files of one stand in the other, too, which is no second measurement"
                )
    more = [f"{len(sentences) - most} more pairs of configurations share functions"] if len(sentences) > most else []
    return (*sentences[:most], *more)


def channel_label(frf: FRF, channel: int) -> str:
    """Return the DOF of a channel with its run and file."""
    return f"{frf.output.name(channel)} (run {frf.run[channel] + 1}, {frf.source[channel]})"


def run_states(frf: FRF, channels: Integers, *, fewest_runs: int = 4, most_of: float = 0.5) -> Iterator[Verdict]:
    """Find runs of two states among channels of one direction.

    Each run's resonances are the peaks of its summed power, and two runs are as alike as the share of peaks that they
    have in common. Runs are divided about the two that are least alike; they are of two states where both parts agree
    within, but not with each other.

    Parameters
    ----------
    frf : FRF
        Finite functions.
    channels : (n,) int
        Positions of sound outputs of one direction: another direction has other resonances.
    fewest_runs : int
        Fewest runs of which some are said to differ.
    most_of : float
        Share of the runs that must show as many: where bandwidths overlap, a few runs show the peaks that their
        sensors' places let stand out, and others show others.
    """
    # Share of peaks that runs of one state have in common at least, and runs of two states at most, in the mean.
    # Runs miss a peak where all their sensors are at a node; runs of other states meet a few by chance.
    least_within, most_between = 0.6, 0.35
    number, resonances = _resonances(frf, channels)
    if number.size < max(fewest_runs, most_of * np.unique(frf.run[channels]).size):
        return
    step = float(np.median(np.diff(frf.frequency)))
    alike = np.array([[_alike(a, b, MIN_LINES * step) for b in resonances] for a in resonances])
    first, second = np.unravel_index(int(np.argmin(alike)), alike.shape)
    of_second = alike[:, second] > alike[:, first]
    parts = (np.flatnonzero(~of_second), np.flatnonzero(of_second))
    if min(part.size for part in parts) < 2:
        return  # one odd run shares nothing with the others, which `unshared` says of its channels
    others = ~np.eye(len(alike), dtype=bool)
    within = min(float(alike[np.outer(part, part) & others].mean()) for part in (~of_second, of_second))
    between = float(alike[np.ix_(*parts)].mean())
    if within < least_within or between > most_between:
        return
    large, small = sorted(parts, key=lambda part: (-part.size, part[0]))
    states = " and ".join(
        f"runs {_listed(number[part])} (from {frf.source[int(np.argmax(frf.run == number[part[0]]))]}) with peaks "
        f"at {_peaks(resonances, part)}"
        for part in (large, small)
    )
    message = (
        f"runs of two states of the structure: {states}. They share {100 * between:.0f} % of their peaks, among "
        "themselves runs share "
        f"{100 * within:.0f} % or more. Put each state into a configuration of its own, or take the files "
        "that belong here"
    )
    yield Verdict(check="states", level="fail", message=message)


def _resonances(frf: FRF, channels: Integers, *, fewest_peaks: int = 3) -> tuple[Integers, list[Reals]]:
    """Return the runs that show enough peaks, and of each their frequencies, Hz.

    `fewest_peaks`: peaks that a run must show to be compared; fewer coincide by chance.
    """
    numbers, resonances = [], []
    for run in np.unique(frf.run[channels]):
        of_run = np.array([p.frequency for p in peaks(frf, channels[frf.run[channels] == run])])
        if of_run.size >= fewest_peaks:
            numbers.append(int(run))
            resonances.append(of_run)
    return np.array(numbers, dtype=np.int64), resonances


def _alike(one: Reals, other: Reals, near: float, *, same: float = 0.008) -> float:
    """Return the share of peaks that two runs have in common.

    `same`: relative distance of two peaks up to which they may be one resonance: sensors and temperature shift by
    less.
    """
    apart = np.abs(one[:, None] - other)
    close = apart <= np.maximum(near, same * one[:, None])
    return float(close.any(axis=1).sum() + close.any(axis=0).sum()) / (one.size + other.size)


def _listed(runs: Integers) -> str:
    """Return numbers of runs, from 1, those in a row as a range."""
    rows = np.split(runs, np.flatnonzero(np.diff(runs) > 1) + 1)
    return ", ".join(f"{r[0] + 1}" if r.size == 1 else f"{r[0] + 1} to {r[-1] + 1}" for r in rows)


def _peaks(resonances: list[Reals], part: NDArray[np.intp]) -> str:
    """Return the peaks of the run of a part that shows most."""
    most = max((resonances[i] for i in part), key=len)
    return ", ".join(f"{f:.5g}" for f in most[:4]) + (", ... Hz" if most.size > 4 else " Hz")
