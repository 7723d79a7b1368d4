"""What a comparison of two states says, in sentences and as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ema.modal.change import KINDS, Change
from lamella_arrays import Integers, Reals
from lamella_shared import csv_text

_COLUMNS = (
    "mode", "reference_mode", "frequency_Hz", "reference_frequency_Hz", "frequency_shift", "frequency_scatter",
    "frequency_probability", "damping", "reference_damping", "damping_shift", "damping_scatter", "damping_probability",
    "mac", "angle_deg", "angle_scatter_deg", "shape_probability", "changed",
)  # fmt: skip


def change_sentence(change: Change) -> str:
    """Say in one sentence whether a state changed against its reference, which modes did, and by how much."""
    head = f"{change.name} against {_list(change.reference)}"
    if not change.mode.size:
        return f"{head}: they share no mode, so nothing can be said of a change{_one_sided(change)}"
    if not change.changed:
        return f"{head}: {_unchanged(change)}{_one_sided(change)}"
    parts = [*_moved(change), *_damped(change), *_turned(change)]
    same = np.flatnonzero(~change.which.any(axis=1))
    text = "; ".join(parts)
    if same.size:
        text += f"; {_modes(change, same)} did not by more than would be seen ({_seen(change, same)})"
    return f"{head}: changed: {text}{_one_sided(change)}"


def change_csv(change: Change) -> str:
    """Return a comparison as CSV, one row for each mode that both have; modes are numbered from 1.

    Shifts are differences of logarithms, state less reference, scatters their standard deviations without a change.
    """
    rows = (
        (
            change.mode[r] + 1, change.reference_mode[r] + 1, change.frequency[r], change.reference_frequency[r],
            change.frequency_shift[r], change.frequency_scatter[r], f, change.damping[r], change.reference_damping[r],
            change.damping_shift[r], change.damping_scatter[r], d, change.mac[r], np.rad2deg(change.angle[r]),
            np.rad2deg(np.arcsin(np.minimum(change.angle_scatter[r], 1.0))), s,
            " ".join(what for what, is_other in zip(KINDS, change.which[r], strict=True) if is_other),
        )
        for r, (f, d, s) in enumerate(change.probability)
    )  # fmt: skip
    return csv_text(_COLUMNS, rows)


def _unchanged(change: Change) -> str:
    size = float(np.abs(np.expm1(change.frequency_shift)).max())
    r = int(np.argmax(np.abs(change.frequency_shift) / change.frequency_scatter))
    times = abs(change.frequency_shift[r]) / change.frequency_scatter[r]
    return (
        f"no change is seen: frequencies moved by at most {_percent(size)}, "
        f"{f'{times:.1f}' if times >= 0.1 else 'less than 0.1'} times {_scatter(change)}; "
        f"one that moved by less than {_seen(change, np.arange(change.mode.size))} would not be seen"
    )


def _seen(change: Change, which: Integers) -> str:
    """Write the shift of a frequency that would be called a change, in the median of some modes."""
    return _percent(float(np.expm1(np.median(change.critical_shift[which]))))


def _moved(change: Change) -> Iterator[str]:
    """Say which frequencies fell and which rose."""
    times = np.abs(change.frequency_shift) / change.frequency_scatter
    first = True
    for sign, word in ((-1.0, "fell"), (1.0, "rose")):
        moved = np.flatnonzero(change.which[:, 0] & (np.sign(change.frequency_shift) == sign))
        if moved.size:
            size = np.abs(np.expm1(change.frequency_shift[moved]))
            scatter = _scatter(change) if first else "that scatter"
            yield (f"{_modes(change, moved)} {word} by {_range(size)}, {_between(times[moved])} times {scatter}")
            first = False


def _damped(change: Change) -> Iterator[str]:
    for sign, word in ((1.0, "more"), (-1.0, "less")):
        moved = np.flatnonzero(change.which[:, 1] & (np.sign(change.damping_shift) == sign))
        if moved.size:
            yield (
                f"the damping of {_modes(change, moved)} is {word} by "
                f"{_range(np.abs(np.expm1(change.damping_shift[moved])))}"
            )


def _turned(change: Change) -> Iterator[str]:
    turned = np.flatnonzero(change.which[:, 2])
    if turned.size:
        yield f"the shape of {_modes(change, turned)} is another one (MAC down to {change.mac[turned].min():.2f})"


def _one_sided(change: Change) -> str:
    """Say which modes only one of the two has; the level does not count them, for an identification may miss one."""
    text = ""
    for frequency, like, where in (
        (change.new_frequency, change.new_like, change.name),
        (change.gone_frequency, change.gone_like, "the reference"),
    ):
        if frequency.size:
            one = frequency.size == 1
            each = [
                f"{f:.5g} Hz" + (f" (with the shape of mode {r + 1})" if r >= 0 else "")
                for f, r in zip(frequency, like, strict=True)
            ]
            head, verb = ("a mode", "was") if one else ("modes", "were")
            text += f"; {head} at {_list(each)} {verb} found in {where} only"
    return text


def _scatter(change: Change) -> str:
    if change.freedom.max(initial=0.0) > 0:
        return "the scatter of repeats and reassembly"
    return "the scatter that reassembly and noise bring"


def _modes(change: Change, which: Integers) -> str:
    numbers = [str(r + 1) for r in change.reference_mode[which]]
    return f"{'mode' if which.size == 1 else 'modes'} {_list(numbers)}"


def _list(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _range(size: Reals) -> str:
    lower, upper = (_two(100.0 * s) for s in (size.min(), size.max()))
    return f"{upper} %" if lower == upper else f"{lower} to {upper} %"


def _between(times: Reals) -> str:
    lower, upper = (_two(t) for t in (times.min(), times.max()))
    return upper if lower == upper else f"{lower} to {upper}"


def _percent(share: float) -> str:
    return f"{_two(100.0 * share)} %"


def _two(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
