"""Physical poles from the poles of all model orders, without any frequency guess.

A physical pole comes back at every order above some first one; a computational pole wanders. Poles of
neighbouring orders are linked one to one, so that two close modes stay two, and frequency and damping are
always compared within one pair of poles. A chain of links over enough orders is a cluster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.identification.lscf import lscf_poles
from ema.identification.part_bands import PartBand, part_bands
from ema.modal.mac import cmif
from ema.types.arrays import readonly
from ema.types.frf import FRF

DEFAULT_ORDER = 60
MAX_DAMPING = 0.3
"""Poles damped more than this are never taken for resonances."""
LINK_DISTANCE = 0.01
"""Largest distance of linked poles of neighbouring orders over the magnitude of the pole."""
MAX_GAP = 2
"""A chain survives this many orders without its pole."""
MIN_CHAIN = 6
"""Fewest poles in a cluster, or a third of the orders where they are few."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StabilizationDiagram:
    """Poles over model orders and the clusters found among them.

    Attributes
    ----------
    order : (n_pole,) int
        Model order of each pole.
    pole : (n_pole,) complex
        Stable poles (Re < 0) in the band, rad/s.
    cluster : (n_pole,) int
        Cluster that each pole belongs to, -1 where none.
    chosen : (n_cluster,) complex
        Representative pole of each cluster, rad/s, ascending in frequency.
    frequency : (n_frequency,) float
        Lines of the functions, Hz.
    indicator : (n_indicator, n_frequency) float
        Complex mode indicator function, drawn behind the poles.
    """

    order: NDArray[np.int64]
    pole: NDArray[np.complex128]
    cluster: NDArray[np.int64]
    chosen: NDArray[np.complex128]
    frequency: NDArray[np.float64]
    indicator: NDArray[np.float64]

    def __post_init__(self) -> None:
        n_pole, n_frequency = np.size(self.pole), np.size(self.frequency)
        for name, shape, dtype in (
            ("order", (n_pole,), int),
            ("pole", (n_pole,), complex),
            ("cluster", (n_pole,), int),
            ("chosen", (None,), complex),
            ("frequency", (n_frequency,), float),
            ("indicator", (None, n_frequency), float),
        ):
            checked = readonly("StabilizationDiagram", name, getattr(self, name), shape, dtype)
            object.__setattr__(self, name, checked)

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether each pole belongs to a cluster, ``(n_pole,)``."""
        return self.cluster >= 0


def highest_order(n_line: int) -> int:
    """Return the highest model order where none is asked for: 60, less in bands of few lines."""
    return max(1, min(DEFAULT_ORDER, n_line // 3))


def stabilization(frf: FRF, *, order: int | None = None) -> StabilizationDiagram:
    """Compute the poles of all orders and cluster them; a band of very many lines is taken in parts (`part_bands`).

    Parameters
    ----------
    frf : FRF
        Functions, cut to the band to identify (`FRF.band`). Where there are more inputs than outputs the
        roles are exchanged: LSCF takes the shorter side as the references.
    order : int, optional
        Highest model order; where not given that of `highest_order`.

    Raises
    ------
    IdentificationError
        Too few lines for the order, or values that are not finite.
    """
    value = frf.value if frf.value.shape[0] >= frf.value.shape[1] else frf.value.swapaxes(0, 1)
    parts = [_of_part(frf.frequency, value, part, order) for part in part_bands(value)]
    first = np.cumsum([0, *(chosen.size for *_, chosen in parts)])
    orders, poles, clusters, chosen = zip(*parts, strict=True)
    numbers = [np.where(own >= 0, own + n, own) for own, n in zip(clusters, first, strict=False)]
    return StabilizationDiagram(
        order=np.concatenate(orders),
        pole=np.concatenate(poles),
        cluster=np.concatenate(numbers),
        chosen=np.concatenate(chosen),
        frequency=frf.frequency,
        indicator=cmif(_scaled(value)),
    )


def _scaled(value: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return functions of a mean square of 1, those that are zero as they are."""
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=-1, keepdims=True))
    return np.asarray(value / np.where(rms > 0.0, rms, 1.0))


def _of_part(
    frequency: NDArray[np.float64], value: NDArray[np.complex128], part: PartBand, order: int | None
) -> tuple[NDArray[np.int64], NDArray[np.complex128], NDArray[np.int64], NDArray[np.complex128]]:
    """Return order, pole and cluster of the poles of one part of the band, and the representatives of the clusters."""
    lines = frequency[part.lines]
    order = highest_order(lines.size) if order is None else order
    lower, upper = frequency[part.core.start], frequency[min(part.core.stop, frequency.size - 1)]
    orders: list[NDArray[np.int64]] = []
    poles: list[NDArray[np.complex128]] = []
    for k, found in enumerate(lscf_poles(lines, _scaled(value[..., part.lines]), order), start=1):
        hertz = np.abs(found) / (2.0 * np.pi)
        inside = (hertz >= lower) & (hertz <= upper)
        damped = (found.real < 0.0) & (-found.real <= MAX_DAMPING * np.abs(found))
        kept = np.sort_complex(1j * found[inside & damped]) / 1j
        poles.append(kept)
        orders.append(np.full(kept.size, k))
    chain = _chain(poles)
    all_orders, all_poles = np.concatenate(orders), np.concatenate(poles)
    return all_orders, all_poles, *_clusters(all_orders, all_poles, chain, order)


def _chain(poles: list[NDArray[np.complex128]]) -> NDArray[np.int64]:
    """Give each pole the number of its chain, in the order of the concatenated poles."""
    numbers: list[NDArray[np.int64]] = []
    n_chain = 0
    end_pole = np.empty(0, dtype=complex)  # last pole, its order and number of every chain still alive
    end_order = np.empty(0, dtype=int)
    end_number = np.empty(0, dtype=int)
    for k, current in enumerate(poles):
        alive = k - end_order <= MAX_GAP + 1
        end_pole, end_order, end_number = end_pole[alive], end_order[alive], end_number[alive]
        number = np.full(current.size, -1)
        if current.size and end_pole.size:
            distance = np.abs(current[:, None] - end_pole) / np.abs(current)[:, None]
            nearest_end, nearest_pole = distance.argmin(axis=1), distance.argmin(axis=0)
            mutual = nearest_pole[nearest_end] == np.arange(current.size)
            linked = mutual & (distance[np.arange(current.size), nearest_end] <= LINK_DISTANCE)
            number[linked] = end_number[nearest_end[linked]]
        new = number < 0
        number[new] = n_chain + np.arange(np.count_nonzero(new))
        n_chain += int(np.count_nonzero(new))
        kept = ~np.isin(end_number, number)
        end_pole = np.concatenate([end_pole[kept], current])
        end_order = np.concatenate([end_order[kept], np.full(current.size, k)])
        end_number = np.concatenate([end_number[kept], number])
        numbers.append(number)
    return np.concatenate(numbers)


def _clusters(
    order: NDArray[np.int64], pole: NDArray[np.complex128], chain: NDArray[np.int64], highest: int
) -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
    """Clusters are the long chains; one pole stands for each, the median over its upper half of orders."""
    cluster = np.full(pole.size, -1)
    members: list[NDArray[np.int64]] = []
    chosen: list[complex] = []
    fewest = min(MIN_CHAIN, -(-highest // 3))
    for number, count in enumerate(np.bincount(chain)):
        if count >= fewest:
            member = np.flatnonzero(chain == number)
            upper = pole[member[order[member] >= np.median(order[member])]]
            members.append(member)
            chosen.append(complex(np.median(upper.real), np.median(upper.imag)))
    rank = np.argsort(np.abs(np.array(chosen, dtype=complex)))
    for position, original in enumerate(rank):
        cluster[members[original]] = position
    return cluster, np.array(chosen, dtype=complex)[rank]
