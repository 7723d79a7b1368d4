"""Whether a function has the form of a frequency-response function at all, judged by itself and without coherence."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.blocks import in_blocks
from ema.types.frf import FRF

MIN_LINES = 64
"""Fewer lines do not tell noise from a function."""
_PARTS = 8
"""Parts of the band, of which one with a function in it is enough: above what a hammer excites is noise alone."""
_APART = (8, 13)
"""Lines, of which noise shares nothing even where a window has smeared it over its neighbours."""
_NOISE, _MOST = 3.5, 0.45
"""Steadiness over one over the square root of the lines that noise stays below, even smeared by a window; the most."""
_STEADY = 0.5
"""Steadiness that some output must have before another is called one of noise; of measured sets it is 0.58 or more."""
_ENDS = (5.0, 95.0)
_FLAT, _NOT_FLAT = 3.0, 15.0
"""Range of levels, dB, of an output without a resonance, and of the usual one beside which it is told."""


@dataclass(frozen=True, kw_only=True)
class Formless:
    """An output without the form of a function, None for all of them; whether it is noise alone, else it is flat."""

    channel: int | None
    is_noise: bool
    message: str


def formless(frf: FRF, channels: NDArray[np.int64]) -> Iterator[Formless]:
    """Give outputs that are noise alone or flat beside others that are functions; of noise alone, all at once.

    Parameters
    ----------
    frf : FRF
    channels : (n_channel,) int
        Outputs that are looked at.
    """
    if frf.frequency.size < MIN_LINES or not channels.size:
        return
    steady, levels = steadiness(frf, channels), span(frf, channels)
    noise = min(_NOISE / np.sqrt(_lines(frf) - max(_APART)), _MOST)
    if np.all(steady < noise):
        message = (
            f"no function has a phase that stays from line to line (steadiness {steady.max():.2f} at most, that of "
            f"noise is below {noise:.2f}): is the force plugged in, and does it excite this band? Else give band_Hz"
        )
        yield Formless(channel=None, is_noise=True, message=message)
        return
    if steady.max() < _STEADY:
        return
    usual = float(np.median(steady[steady >= noise]))
    for channel, own, width in zip(channels, steady, levels, strict=True):
        if own < noise:
            message = (
                f"dead, its phase jumps from line to line as that of noise does (steadiness {own:.2f}, of the others "
                f"{usual:.2f} in the median): unplugged, broken, or its response is below its noise"
            )
            yield Formless(channel=int(channel), is_noise=True, message=message)
        elif width < _FLAT and np.median(levels) > _NOT_FLAT:
            message = (
                f"its level spans {width:.2g} dB where that of the others spans {np.median(levels):.2g} dB in the "
                "median: it follows the force without a resonance, as a channel does that picks up the force's signal"
            )
            yield Formless(channel=int(channel), is_noise=False, message=message)


def steadiness(frf: FRF, channels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return how steady the phase of each output is from line to line, in the best part of the band: (n_channel,).

    It is the length of the mean of unit vectors that point where the phase has turned between lines some apart: 1 for
    a phase that stays or turns evenly, about one over the square root of the number of lines for noise. Peaks, however
    high, count no more than the lines between them.

    Parameters
    ----------
    frf : FRF
        At least `MIN_LINES` lines.
    channels : (n_channel,) int
        Outputs.
    """
    found = []
    for block in in_blocks(channels):
        value = frf.value[block]
        size = np.abs(value)
        unit = np.where(size > 0, value / np.where(size > 0, size, 1.0), 0.0)
        steady = [
            np.abs(np.mean(part[..., n:] * part[..., :-n].conj(), axis=2))
            for part in np.array_split(unit, frf.frequency.size // _lines(frf), axis=2)
            for n in _APART
        ]
        found.append(np.max(steady, axis=(0, 2)))
    return np.concatenate(found)


def _lines(frf: FRF) -> int:
    """Return how many lines a part of the band has."""
    return max(MIN_LINES, frf.frequency.size // _PARTS)


def span(frf: FRF, channels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the range of levels over the lines of each output, of its functions the widest, dB: (n_channel,)."""
    found = []
    for block in in_blocks(channels):
        value = frf.value[block][..., frf.frequency > 0]
        level = 20 * np.log10(np.maximum(np.abs(value), np.finfo(float).tiny))
        low, high = np.percentile(level, _ENDS, axis=2)
        found.append((high - low).max(axis=1))
    return np.concatenate(found)
