"""What changed in a structure, and where: the answer as it is stored, and in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lamella_shared import Reals, arrays

Verdict = Literal["unchanged", "too little to say", "identified", "one of", "partly explained", "unlike anything"]


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
        The clamp, edge, node or term that the likeliest is at, such as "clamp 2"; empty where it is none.
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
@arrays({"n": "frequency shift explained_shift", "any": "x y", "x y": "map", "2 2": "box"})
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
        Kinds of change of damping, the most probable first, and `damping_left`, keys of those that are not separated.
    impossible : mapping of str to str
        Why others cannot be.
    log_odds : float
        Logarithm of the posterior odds of any of these changes against none.
    scatter : float
        Relative scatter of stiffness between two assemblies that goes with the answer, and `stated` what was supposed.
    frequency, shift, explained_shift : (n_mode,) float
        Measured natural frequencies of the state, Hz; their logarithms less the reference's, NaN where that has no such
        mode; and what the likeliest change makes of that.
    axes : tuple of str
        Axes along which a location is said, the first two being those of the map; none where nodes have no locations.
    ends : tuple of str
        What the lower ends along these are called; none of a structure of matrices.
    x, y : (n,) and (k,) float
        Middles of the cells of the map along its axes, m.
    map : (n, k) float
        Probability of each cell, given that one of the kinds that are left, or of all local ones, is right.
    box : (2, 2) float
        Lowest and highest coordinates along the axes of the map, m.
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
    frequency: Reals
    shift: Reals
    explained_shift: Reals
    axes: tuple[str, ...]
    ends: tuple[str, ...]
    x: Reals
    y: Reals
    map: Reals
    box: Reals
    sentences: tuple[str, ...]

    def kind(self, name: str) -> KindOfChange:
        """Return a kind by its key."""
        return next(kind for kind in self.kinds if kind.name == name)


AXES = ("x", "y", "z")


def sentences(what_changed: WhatChanged) -> tuple[str, ...]:
    """Say what changed between a state and its reference, where, and how large it is, in stiffness and in damping."""
    return (*_in_stiffness(what_changed), *_in_damping(what_changed))


def _in_damping(what_changed: WhatChanged) -> tuple[str, ...]:
    left = [kind for kind in what_changed.damping if kind.name in what_changed.damping_left]
    if not left:
        return ()
    names = [kind.label for kind in left]
    text = names[0] if len(left) == 1 else f"{', '.join(names[:-1])} or {names[-1]}; the data cannot tell which"
    best = left[0]
    where = f", at x = {_mm(best.place[0])} ± {_mm(best.place_std[0])} mm" if best.local else ""
    return (f"Damping of {what_changed.name}: {text}. {_capital(best.label)}: {size_text(best)}{where}.",)


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _in_stiffness(what_changed: WhatChanged) -> tuple[str, ...]:
    head = f"{what_changed.name}, what and where"
    if what_changed.verdict == "unchanged":
        return (
            f"{head}: nothing to place: no local change is likelier than the scatter of assembly "
            f"({100 * what_changed.scatter / np.sqrt(2.0):.2g} % of a frequency).",
        )
    if what_changed.verdict == "too little to say":
        return (
            f"{head}: changed, too little to say what or where: modes moved by more than they scatter, but no one "
            "change is likelier than that scatter by enough to be named.",
        )
    if what_changed.verdict == "unlike anything":
        return (
            f"{head}: changed, but unlike any change that is considered: the likeliest explains "
            f"{100 * what_changed.kinds[0].explained:.0f} % of what scatter leaves. There was more than one change, "
            "or one of a kind that the list lacks.",
        )
    left = [what_changed.kind(name) for name in what_changed.left]
    lines = [_what(what_changed, head, left)]
    if any(kind.local for kind in left):
        lines.append(_where(what_changed))
    lines += [_size(kind) for kind in left]
    return tuple(lines)


def _what(what_changed: WhatChanged, head: str, left: Sequence[KindOfChange]) -> str:
    names = [kind.label for kind in left]
    if len(left) == 1:
        text = f"{head}: {names[0]}; all else that is considered is less likely by a factor of 100 and more."
    else:
        text = f"{head}: {', '.join(names[:-1])} or {names[-1]}; the data cannot tell which."
    if what_changed.verdict == "partly explained":
        text += (
            f" That explains {100 * left[0].explained:.0f} % of what scatter leaves: there was more than one change, "
            "or one of a kind that the list lacks."
        )
    return text


def _where(what_changed: WhatChanged) -> str:
    """Say where the change is, by all kinds that remain, each weighted by its probability."""
    # Standard deviation of a location, over the longer side of the plan, from which it is not said to be one
    # location.
    spread_out = 0.2
    at = [AXES.index(name) for name in what_changed.axes]
    left = [kind for kind in (what_changed.kind(name) for name in what_changed.left) if kind.local]
    share = np.array([kind.probability for kind in left])
    share = share / share.sum()
    mean = share @ np.array([kind.place for kind in left])
    square = share @ np.array([np.square(kind.place_std) + np.square(kind.place) for kind in left])
    spread = np.sqrt(np.maximum(square - mean**2, 0.0) + separation(what_changed) ** 2)
    if np.any(spread[at] > spread_out * np.ptp(what_changed.box, axis=1).max()):
        i, j = np.unravel_index(int(np.argmax(what_changed.map)), what_changed.map.shape)
        return (
            f"Where: not known to better than {_mm(spread[at].max())} mm; the likeliest of all cells, at "
            f"{what_changed.axes[0]} = {_mm(what_changed.x[i])} mm and {what_changed.axes[1]} = "
            f"{_mm(what_changed.y[j])} mm, has a probability of {100 * what_changed.map[i, j]:.0f} %."
        )
    parts = [f"{name} = {_mm(mean[i])} ± {_mm(spread[i])} mm" for name, i in zip(what_changed.axes, at, strict=True)]
    for k, end in enumerate(what_changed.ends):
        parts[k] += f", {_mm(mean[at[k]] - what_changed.box[k, 0])} mm from the {end}"
    last = ", and " if what_changed.ends else " and "
    return f"Where: {', '.join(parts[:-1])}{last}{parts[-1]} (one standard deviation)."


def separation(what_changed: WhatChanged) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the standard deviation of a location by what separates those that were tried, (3,) m.

    It is that of a uniform density over a third of a cell of the map, to which the likeliest cells are divided.
    """
    at, cell = [AXES.index(name) for name in what_changed.axes[:2]], np.zeros(3)
    steps = [line[1] - line[0] if line.size > 1 else 0.0 for line in (what_changed.x, what_changed.y)]
    cell[at] = steps[: len(at)]
    return cell / (3.0 * np.sqrt(12.0))


def _mm(value: float) -> str:
    return f"{1e3 * value:.0f}"


def _size(kind: KindOfChange) -> str:
    """Say how large a change of a kind is, and in which part, direction or layer it is."""
    what = _capital(kind.label)
    details = []
    if kind.part:
        details.append(kind.part)
    if np.isfinite(kind.angle) and kind.name in ("crack", "stiffener"):
        details.append(f"at {np.degrees(kind.angle):.0f} degrees to the x axis")
    if kind.layer:
        details.append(f"in the {kind.layer}")
    detail = f" ({', '.join(details)})" if details else ""
    return f"{what}{detail}: {size_text(kind)}, probability {kind.probability:.2g}."


def size_text(kind: KindOfChange) -> str:
    """Return the size of a change with its interval of 90 %."""
    ends = f"{_number(kind.lower, kind.unit)} to {_number(kind.upper, kind.unit)}"
    return f"{kind.quantity} {_number(kind.size, kind.unit)} ({ends})"


def _number(value: float, unit: str) -> str:
    if unit == "1":
        return f"{100 * value:.0f} %" if value >= 0.0995 else f"{100 * value:.2g} %"
    if unit == "m":
        return f"{1e3 * value:.2g} mm" if value < 0.0995 else f"{1e3 * value:.3g} mm"
    if unit == "kg" and value < 1.0:
        return f"{1e3 * value:.2g} g" if value < 0.0995 else f"{1e3 * value:.3g} g"
    return f"{value:.3g} {unit}"
