"""Repeats of one state of the structure: what their scatter says of the intervals of each.

An interval of a single run is what the noise of that run leaves open. What changes between runs, as temperature,
settling, support and sensors taken off and put back, is not in it, and is seen only when a state is measured again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.campaign.campaign import Configuration
from ema.modal.comparison import Comparison
from ema.types.arrays import readonly


@dataclass(frozen=True, eq=False, kw_only=True)
class Repeats:
    """Configurations that state one and the same condition of the structure.

    Attributes
    ----------
    name : tuple of str
        The configurations, in the order of the campaign.
    frequency : (n_mode,) float
        Mean natural frequency of each mode that at least two of them have, Hz.
    scatter : (n_mode,) float
        Standard deviation of it from repeat to repeat, Hz.
    stated : (n_mode,) float
        Root mean square of the standard deviations that the repeats state each, Hz.
    damping_scatter, damping_stated : (n_mode,) float
        The same of the damping ratio.
    """

    name: tuple[str, ...]
    frequency: NDArray[np.float64]
    scatter: NDArray[np.float64]
    stated: NDArray[np.float64]
    damping_scatter: NDArray[np.float64]
    damping_stated: NDArray[np.float64]

    def __post_init__(self) -> None:
        shape = (np.size(self.frequency),)
        for name in ("frequency", "scatter", "stated", "damping_scatter", "damping_stated"):
            object.__setattr__(self, name, readonly("Repeats", name, getattr(self, name), shape))

    @property
    def finding(self) -> str:
        """What a user should read."""
        names = ", ".join(self.name)
        if not self.frequency.size:
            return f"{names} state the same condition, but share no mode"
        relative = self.scatter / self.frequency
        k = int(np.argmax(relative))
        return (
            f"{names} state the same condition: frequencies scatter by {100 * np.median(relative):.2g} % in the "
            f"median and {100 * relative[k]:.2g} % at {self.frequency[k]:.5g} Hz, which is "
            f"{np.median(self.scatter / self.stated):.2g} times what the noise of each run leaves open; "
            "a frequency of this campaign is known no better than that"
        )


def repeats(configurations: Sequence[Configuration], comparison: Comparison) -> tuple[Repeats, ...]:
    """Compare the configurations that repeat one another, or state the same stack, torque, pressure and height.

    A state that has a reference is no repeat of it, whatever both state of torque and pressure.

    Parameters
    ----------
    configurations : sequence of Configuration
        Those of the comparison, in its order. One that states neither torque nor pressure is no repeat, unless it
        says what it repeats.
    comparison : Comparison

    Returns
    -------
    tuple of Repeats
        One for each condition that more than one of them states.
    """
    groups: dict[tuple[object, ...], list[int]] = {}
    repeated = {own.repeat_of for own in configurations} - {None}
    for k, own in enumerate(configurations):
        if own.repeat_of is not None or own.name in repeated:
            groups.setdefault((own.repeat_of or own.name,), []).append(k)
        elif own.compare_to:
            continue
        elif own.torque is not None or own.pressure is not None:
            groups.setdefault((own.stack, own.torque, own.pressure, own.height), []).append(k)
    return tuple(_compared(comparison, np.array(group)) for group in groups.values() if len(group) > 1)


def _compared(comparison: Comparison, group: NDArray[np.int64]) -> Repeats:
    shared = np.count_nonzero(np.isfinite(comparison.frequency[group]), axis=0) > 1
    own = np.ix_(group, shared)
    return Repeats(
        name=tuple(comparison.name[k] for k in group),
        frequency=np.nanmean(comparison.frequency[own], axis=0),
        scatter=np.nanstd(comparison.frequency[own], axis=0, ddof=1),
        stated=np.sqrt(np.nanmean(comparison.frequency_std[own] ** 2, axis=0)),
        damping_scatter=np.nanstd(comparison.damping[own], axis=0, ddof=1),
        damping_stated=np.sqrt(np.nanmean(comparison.damping_std[own] ** 2, axis=0)),
    )
