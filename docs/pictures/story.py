"""Draw the picture of the README from results: python docs/pictures/story.py RESULTS_FOLDER PICTURE.

The folder holds a campaign that was fitted and diagnosed; `make picture` makes both.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from ema.plot import palette
from updating.diagnosis.answer import Diagnosis
from updating.fitting.plots import SWELL, ShapePair, shape_pairs
from updating.report.results import read_results, with_models
from updating.results.text import percent, together

CONFIGURATION, MODE = 0, 2  # the shape that is shown, both from 0


def draw_shape(axes: Axes3D, pair: ShapePair, moved: np.ndarray, color: str) -> None:
    """Draw the points of a stack where a mode moves them, over the points at rest."""
    size = 1.2 * SWELL * float(np.ptp(pair.coordinate, axis=0).max())
    for points, shade, width in ((pair.coordinate, palette.PALE, 1.0), (pair.coordinate + size * moved, color, 1.6)):
        ends = np.insert(points[pair.line], 2, np.nan, axis=1).reshape(-1, 3)  # one path with gaps
        axes.plot(*(1e3 * ends.T), color=shade, linewidth=width)
        axes.plot(*(1e3 * points.T), ".", color=shade, markersize=4.0 * width)
    axes.set_aspect("equal")
    axes.set_proj_type("ortho")
    axes.view_init(elev=24.0, azim=-62.0)
    axes.set_axis_off()


def draw_errors(axes: Axes, found: Diagnosis) -> None:
    """Draw the frequency error of each mode without effects and with those of the first explanation."""
    at = np.arange(len(found.errors), dtype=float)
    names = list(dict.fromkeys(one.configuration for one in found.errors))
    at += [names.index(one.configuration) for one in found.errors]
    before, after = ([100.0 * abs(getattr(one, name)) for one in found.errors] for name in ("base", "explained"))
    bars = axes.bar(at, before, 0.62, color=palette.BASE)
    (dots,) = axes.plot(at, after, "o", color=palette.FOUND, markersize=8, clip_on=False, zorder=3)
    base, one = found.ranked(()), found.ranked(found.set[0])
    text = (
        f"base model: {percent(base.frequency_error)} in the mean, {percent(base.left_out_error)} of modes left out",
        f"with what was identified: {percent(one.frequency_error)}, {percent(one.left_out_error)} of modes left out",
    )
    axes.set_ylim(0.0, 1.45 * max(before))
    ticks = [f"{one.frequency:.0f}" for one in found.errors]
    axes.set_xticks(at, ticks, fontsize=8)
    axes.tick_params(axis="y", labelsize=10)
    for name in names:
        middle = np.mean([x for x, one in zip(at, found.errors, strict=True) if one.configuration == name])
        what = f"modes at torque {name} [Hz]"
        axes.text(middle, -0.17, what, transform=axes.get_xaxis_transform(), ha="center", fontsize=11)
    axes.set_ylabel("frequency error of the model [%]", fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend((bars, dots), text, loc="upper left", frameon=False, fontsize=10)


def story(folder: Path) -> Figure:
    """Return the picture: a shape measured, modelled before and after, what was missing, and the error that falls."""
    results = with_models(read_results(folder))
    tested, found = results.tested[CONFIGURATION], results.diagnosis
    if found is None or not found.set or tested.identified is None:
        message = f"{folder}: the picture needs a campaign that was fitted and a diagnosis that names an effect"
        raise SystemExit(message)
    before, after = (shape_pairs(tested.measured, fit)[MODE] for fit in (tested.fit, tested.identified.fit))
    figure = Figure(figsize=(10.5, 4.8))
    figure.text(
        0.5, 0.945, f"What the model lacks: {together([found.labels[e] for e in found.set[0]])}", fontsize=14,
        ha="center", weight="bold",
    )  # fmt: skip
    for top, title, moved, color in (
        (0.63, f"measured, {before.measured_frequency:.1f} Hz", before.measured.real, palette.MEASURED),
        (0.34, f"base model, {before.model_frequency:.1f} Hz", before.model, palette.BASE),
        (0.05, f"with it, {after.model_frequency:.1f} Hz", after.model, palette.FOUND),
    ):
        figure.text(0.395, top + 0.255, title, fontsize=11, ha="right", va="top", color=palette.INK)
        axes = figure.add_axes((0.0, top - 0.24, 0.40, 0.72), projection="3d")  # drawn in its middle only
        axes.patch.set_visible(False)
        draw_shape(axes, before, moved, color)
    draw_errors(figure.add_axes((0.49, 0.17, 0.50, 0.73)), found)
    return figure


if __name__ == "__main__":
    story(Path(sys.argv[1])).savefig(sys.argv[2], dpi=160)
