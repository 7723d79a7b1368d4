"""Hits of a hammer in time histories: where they are, which are double, and the blocks that they are cut into."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.campaign.estimate import double_hit
from ema.types.errors import MeasurementError

LEAST_HIT = 0.1
"""Force of a hit over that of the strongest one in the record."""
AT_REST = 0.05
"""Median over largest force up to which a record is one of a hammer."""
ABOVE_NOISE = 20.0
"""Least force of a hit over the median force of the record, which a hammer at rest has."""

FEWEST_SAMPLES = 4
"""Fewer samples of a pulse tell neither its size nor its time: half a sample is 70 degrees at a usual last line."""


def find_hits(force: NDArray[np.float64], n_block: int) -> NDArray[np.int64]:
    """Return the first sample of each hit in a record; pulses within `n_block` samples of a hit belong to it.

    Parameters
    ----------
    force : (n_sample,) float
    n_block : int
        Samples that a hit and its response take.
    """
    size = np.abs(np.asarray(force, float) - np.median(force))
    least = max(LEAST_HIT * size.max(), ABOVE_NOISE * float(np.median(size)))
    found: list[int] = []
    for sample in np.flatnonzero(size > least):
        if not found or sample >= found[-1] + n_block:
            found.append(int(sample))
    return np.array(found, dtype=np.int64)


def cut_at_hits(value: NDArray[np.float64], n_block: int, n_before: int) -> tuple[NDArray[np.float64], int]:
    """Cut records at their hits.

    Parameters
    ----------
    value : (n_record, n_channel, n_sample) float
        Time histories, the force first.
    n_block : int
        Samples of a block.
    n_before : int
        Samples of it before the hit.

    Returns
    -------
    blocks : (n_hit, n_channel, n_block) float
    n_left_out : int
        Hits whose block begins before the record or reaches beyond it.

    Raises
    ------
    MeasurementError
        There is no whole hit.
    """
    blocks, left_out = [], 0
    for record in value:
        for hit in find_hits(record[0], n_block - n_before) - n_before:
            if hit < 0 or hit + n_block > record.shape[1]:
                left_out += 1
            else:
                blocks.append(record[:, hit : hit + n_block])
    if not blocks:
        message = (
            f"no hit with a whole block of {n_block} samples, {n_before} of them before it, is in the records; "
            "shorten 'block_s' or 'before_hit_s', and check which channel is the force"
        )
        raise MeasurementError(message)
    return np.array(blocks), left_out


def second_pulse(force: NDArray[np.float64]) -> float:
    """Return the largest other pulse of a hit over its main one, before or after it; 0 where there is none.

    A force that does not rest most of the time is no hit, but periodic excitation: 0.
    """
    size = np.abs(force - np.median(force))
    if np.median(size) > AT_REST * size.max():
        return 0.0
    return max(double_hit(force), double_hit(force[::-1]))


def pulse_samples(force: NDArray[np.float64]) -> int:
    """Return the samples of a hit above a tenth of its peak; 0 where the force does not rest most of the time."""
    size = np.abs(force - np.median(force))
    if np.median(size) > AT_REST * size.max() or size.max() == 0.0:
        return 0
    peak = int(np.argmax(size))
    low = np.flatnonzero(size < LEAST_HIT * size[peak])
    before, after = low[low < peak], low[low > peak]
    return int((after[0] if after.size else size.size) - (before[-1] if before.size else -1) - 1)
