"""What each effect would do to the modes beside what the base model lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ema.plot import palette

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLES = (
    (palette.SERIES[0], "o", "-", 11),
    (palette.SERIES[1], "s", "--", 6.5),
    (palette.SERIES[2], "^", "-.", 5),
    (palette.INK, "D", ":", 3.5),
)
"""Colour, marker, line and marker size: smaller ones later, so that effects that do the same are all seen."""
MOST = len(_STYLES)
"""Effects that one figure can show and still be read."""


def signature_pattern_figure(
    group: Sequence[str],
    label: Sequence[str],
    lacking: ArrayLike,
    std: ArrayLike,
    signature: Mapping[str, Sequence[float]],
) -> Figure:
    """Draw the frequency changes that the base model lacks as bars, and those that effects bring as marked lines.

    Parameters
    ----------
    group, label : sequence of str
        Configuration of each mode, and its frequency in Hz as text; modes of one configuration stand together.
    lacking, std : (n_mode,) array_like
        Measured less modelled frequency over the measured one, as a ratio, and its standard deviation.
    signature : mapping of str to sequence of float
        For each effect the relative frequency change of each mode. The first four are drawn.
    """
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(group))
    size = [sum(g == name for g in group) for name in names]
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    panels = figure.subplots(1, len(names), sharey=True, squeeze=False, width_ratios=size)[0]
    value, error = 100.0 * np.asarray(lacking, float), 100.0 * 1.96 * np.asarray(std, float)
    for axes, name in zip(panels, names, strict=True):
        inside = [k for k, g in enumerate(group) if g == name]
        at = np.arange(len(inside))
        axes.bar(
            at, value[inside], 0.7, color=palette.PALE, edgecolor=palette.LEFT, linewidth=0.6, label="lacking"
        )
        axes.errorbar(
            at, value[inside], error[inside], fmt="none", ecolor=palette.LEFT, capsize=3, linewidth=1.0
        )
        for (effect, change), (color, marker, line, size_of_marker) in zip(
            signature.items(), _STYLES, strict=False
        ):
            moved = 100.0 * np.asarray(change, float)[inside]
            axes.plot(
                at,
                moved,
                color=color,
                marker=marker,
                linestyle=line,
                linewidth=1.0,
                markersize=size_of_marker,
                label=effect,
            )
        axes.axhline(0.0, color=palette.INK, linewidth=0.8)
        axes.set_xticks(at, [label[k] for k in inside], rotation=60, fontsize=8)
        axes.set_xlabel(f"mode of {name} [Hz]")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("change of frequency [%]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize=9)
    return figure
