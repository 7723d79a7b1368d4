"""Records of unequal lengths, cut to a common one so that the functions of all runs have the same lines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ema.io.measured_function import MeasuredFunction

Run = list[tuple[Path, tuple[MeasuredFunction, ...]]]
SHORTEST = 0.8
"""Share of the longest record that the shortest one has at least: a shorter one would cost the others their lines."""


def of_common_length(groups: list[list[Run]], notes: list[str]) -> list[list[Run]]:
    """Return the records of all runs with as many samples as the shortest has, and note it.

    Parameters
    ----------
    groups : list of list of run
        For each group of files its runs, for each run its records, for each record its file and its channels.
    notes : list of str
        The common length is added to it.

    Returns
    -------
    groups
        As they are where all have the same length, or the shortest has less than `SHORTEST` of the longest.
    """
    sizes = [f.abscissa.size for runs in groups for run in runs for _, channels in run for f in channels]
    shortest, longest = min(sizes, default=0), max(sizes, default=0)
    if shortest == longest or shortest < SHORTEST * longest:
        return groups
    notes.append(
        f"the records hold {shortest} to {longest} samples; all are cut to {shortest}, so that their functions have "
        "the same lines; state block_s under [measurement.time] for another length"
    )
    return [
        [[(file, tuple(_cut(f, shortest) for f in channels)) for file, channels in run] for run in runs]
        for runs in groups
    ]


def _cut(function: MeasuredFunction, n_sample: int) -> MeasuredFunction:
    return replace(function, abscissa=function.abscissa[:n_sample], value=function.value[:n_sample])
