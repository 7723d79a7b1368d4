"""What changed, and where, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from updating.results.what_changed import KindOfChange, WhatChanged

SPREAD_OUT = 0.2
"""Standard deviation of a location, over the longer side of the plan, from which it is not said to be one location."""


def sentences(found: WhatChanged) -> tuple[str, ...]:
    """Say what changed between a state and its reference, where, and how large it is, in stiffness and in damping."""
    return (*_in_stiffness(found), *_in_damping(found))


def _in_damping(found: WhatChanged) -> tuple[str, ...]:
    left = [own for own in found.damping if own.name in found.damping_left]
    if not left:
        return ()
    names = [own.label for own in left]
    text = (
        names[0] if len(left) == 1 else f"{', '.join(names[:-1])} or {names[-1]}; the data cannot tell which"
    )
    best = left[0]
    where = f", at x = {_mm(best.place[0])} ± {_mm(best.place_std[0])} mm" if best.local else ""
    return (f"Damping of {found.name}: {text}. {_capital(best.label)}: {size_text(best)}{where}.",)


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _in_stiffness(found: WhatChanged) -> tuple[str, ...]:
    head = f"{found.name}, what and where"
    if found.verdict == "unchanged":
        return (
            f"{head}: nothing to place: no local change is likelier than the scatter of assembly "
            f"({100 * found.scatter / np.sqrt(2.0):.2g} % of a frequency).",
        )
    if found.verdict == "too little to say":
        return (
            f"{head}: changed, too little to say what or where: modes moved by more than they scatter, but no one "
            "change is likelier than that scatter by enough to be named.",
        )
    if found.verdict == "unlike anything":
        return (
            f"{head}: changed, but unlike any change that is considered: the likeliest explains "
            f"{100 * found.kinds[0].explained:.0f} % of what scatter leaves. There was more than one change, "
            "or one of a kind that the list lacks.",
        )
    left = [found.kind(name) for name in found.left]
    lines = [_what(found, head, left)]
    if any(own.local for own in left):
        lines.append(_where(found))
    lines += [_size(own) for own in left]
    return tuple(lines)


def _what(found: WhatChanged, head: str, left: Sequence[KindOfChange]) -> str:
    names = [own.label for own in left]
    if len(left) == 1:
        text = f"{head}: {names[0]}; all else that is considered is less likely by a factor of 100 and more."
    else:
        text = f"{head}: {', '.join(names[:-1])} or {names[-1]}; the data cannot tell which."
    if found.verdict == "partly explained":
        text += (
            f" That explains {100 * left[0].explained:.0f} % of what scatter leaves: there was more than one change, "
            "or one of a kind that the list lacks."
        )
    return text


def _where(found: WhatChanged) -> str:
    """Say where, by all kinds that are left, each as likely as it is."""
    (x0, x1), (y0, y1) = found.box
    left = [own for own in (found.kind(name) for name in found.left) if own.local]
    share = np.array([own.probability for own in left])
    share = share / share.sum()
    mean = share @ np.array([own.place for own in left])
    square = share @ np.array([np.square(own.place_std) + np.square(own.place) for own in left])
    cell = np.array([_step(found.x), _step(found.y), 0.0]) / (
        3.0 * np.sqrt(12.0)
    )  # to which places are told apart
    spread = np.sqrt(np.maximum(square - mean**2, 0.0) + cell**2)
    if np.any(spread[:2] > SPREAD_OUT * max(x1 - x0, y1 - y0)):
        i, j = np.unravel_index(int(np.argmax(found.map)), found.map.shape)
        return (
            f"Where: not known to better than {_mm(spread[:2].max())} mm; the likeliest of all cells, at x = "
            f"{_mm(found.x[i])} mm and y = {_mm(found.y[j])} mm, has a probability of {100 * found.map[i, j]:.0f} %."
        )
    return (
        f"Where: x = {_mm(mean[0])} ± {_mm(spread[0])} mm, {_mm(mean[0] - x0)} mm from the left end, and y = "
        f"{_mm(mean[1])} ± {_mm(spread[1])} mm, {_mm(mean[1] - y0)} mm from the front (one standard deviation)."
    )


def _step(line: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    return float(line[1] - line[0]) if line.size > 1 else 0.0


def _mm(value: float) -> str:
    return f"{1e3 * value:.0f}"


def _size(own: KindOfChange) -> str:
    """Say how large a change of a kind is, and where it then sits where that is a part of the structure."""
    what = _capital(own.label)
    details = []
    if own.part:
        details.append(own.part)
    if np.isfinite(own.angle) and own.name in ("crack", "stiffener"):
        details.append(f"at {np.degrees(own.angle):.0f} degrees to the x axis")
    if own.layer:
        details.append(f"in the {own.layer}")
    detail = f" ({', '.join(details)})" if details else ""
    return f"{what}{detail}: {size_text(own)}, probability {own.probability:.2g}."


def size_text(own: KindOfChange) -> str:
    """Return the size of a change with its interval of 90 %."""
    ends = f"{_number(own.lower, own.unit)} to {_number(own.upper, own.unit)}"
    return f"{own.quantity} {_number(own.size, own.unit)} ({ends})"


def _number(value: float, unit: str) -> str:
    if unit == "1":
        return f"{100 * value:.0f} %" if value >= 0.0995 else f"{100 * value:.2g} %"
    if unit == "m":
        return f"{1e3 * value:.2g} mm" if value < 0.0995 else f"{1e3 * value:.3g} mm"
    if unit == "kg" and value < 1.0:
        return f"{1e3 * value:.2g} g" if value < 0.0995 else f"{1e3 * value:.3g} g"
    return f"{value:.3g} {unit}"
