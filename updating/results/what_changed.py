"""What changed between a state and its reference, and where: a result as it is written, and read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly

Verdict = Literal[
    "unchanged", "too little to say", "identified", "one of", "partly explained", "unlike anything"
]


@dataclass(frozen=True, kw_only=True)
class KindOfChange:
    """One kind of change, as likely as the data make it, where and how large it then is.

    Attributes
    ----------
    name, label : str
        Its key, and what it is called.
    log_odds : float
        Logarithm of the posterior odds against no change beyond the scatter.
    probability : float
        Among all kinds and none.
    local : bool
        Whether it sits at one location.
    place, place_std : (float, float, float)
        Mean and standard deviation of its location, m; NaN where it is not local.
    best : (float, float, float)
        Its likeliest location, m.
    quantity, unit : str
        What its size is.
    size, lower, upper : float
        Its median and the ends of its interval of 90 %.
    extent : float
        Mean radius or length of what was tried, m; NaN where a kind has none.
    angle : float
        Direction, rad against the x axis; NaN where a kind has none, or no direction is much likelier than others.
    layer : str
        Part of the height of the likeliest; empty where it is all of it.
    part : str
        The clamp or edge that the likeliest is at, such as "clamp 2"; empty where it is none.
    explained : float
        Share of the misfit without a change, beyond what scatter leaves, that the likeliest takes away.
    """

    name: str
    label: str
    log_odds: float
    probability: float
    local: bool
    place: tuple[float, float, float]
    place_std: tuple[float, float, float]
    best: tuple[float, float, float]
    quantity: str
    unit: str
    size: float
    lower: float
    upper: float
    extent: float
    angle: float
    layer: str
    part: str
    explained: float


@dataclass(frozen=True, eq=False, kw_only=True)
class WhatChanged:
    """What changed between a state and its reference, and where.

    Attributes
    ----------
    name : str
        The state; `repeats` and `reference` name the configurations of both.
    verdict : str
        "unchanged", "too little to say", "identified", "one of", "partly explained" or "unlike anything".
    left : tuple of str
        Keys of the kinds that the data cannot tell apart, the most probable first; none where nothing is named.
    kinds : tuple of KindOfChange
        All kinds, the most probable first.
    damping : tuple of KindOfChange
        Kinds of change of damping, the most probable first, and `damping_left`, keys of those that are not told apart.
    impossible : mapping of str to str
        Why others cannot be.
    log_odds : float
        Logarithm of the posterior odds of any of these changes against none.
    scatter : float
        Relative scatter of stiffness between two assemblies that goes with the answer, and `stated` what was supposed.
    frequency, shift, explained_shift : (n_mode,) float
        Measured natural frequencies of the state, Hz; their logarithms less the reference's, NaN where that has no such
        mode; and what the likeliest change makes of that.
    x, y : (n,) and (k,) float
        Middles of the cells of the map, m.
    map : (n, k) float
        Probability of each cell, given that one of the kinds that are left, or of all local ones, is right.
    box : (2, 2) float
        Lowest and highest x, lowest and highest y of the plan, m.
    sentences : tuple of str
        The answer in words.
    """

    name: str
    repeats: tuple[str, ...]
    reference: tuple[str, ...]
    verdict: Verdict
    left: tuple[str, ...]
    kinds: tuple[KindOfChange, ...]
    damping: tuple[KindOfChange, ...]
    damping_left: tuple[str, ...]
    impossible: Mapping[str, str]
    log_odds: float
    scatter: float
    stated: float
    frequency: NDArray[np.float64]
    shift: NDArray[np.float64]
    explained_shift: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    map: NDArray[np.float64]
    box: NDArray[np.float64]
    sentences: tuple[str, ...]

    def __post_init__(self) -> None:
        n = np.size(self.frequency)
        shapes: dict[str, tuple[int | None, ...]] = {
            "frequency": (n,), "shift": (n,), "explained_shift": (n,), "x": (None,), "y": (None,),
            "map": (np.size(self.x), np.size(self.y)), "box": (2, 2),
        }  # fmt: skip
        for name, shape in shapes.items():
            object.__setattr__(self, name, readonly("WhatChanged", name, getattr(self, name), shape))

    def kind(self, name: str) -> KindOfChange:
        """Return a kind by its key."""
        return next(own for own in self.kinds if own.name == name)
