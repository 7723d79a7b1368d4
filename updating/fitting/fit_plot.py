"""The objectives of a fit as a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ema.plot import palette
from updating.fitting.fit import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def objective_figure(estimates: tuple[Estimate, ...]) -> Figure:
    """Draw the objective over every value tried of each parameter, the estimate marked."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * len(estimates), 3.2), layout="constrained")
    for axes, estimate in zip(np.atleast_1d(figure.subplots(1, len(estimates))), estimates, strict=True):
        draw_objective(axes, estimate)
    return figure


def draw_objective(axes: Axes, estimate: Estimate) -> None:
    """Draw one parameter of `objective_figure` into axes."""
    in_percent = estimate.name == "d_f"
    factor = 100.0 if in_percent else 1.0
    order = np.argsort(estimate.history[:, 0])
    axes.plot(
        *(estimate.history[order] * [1.0, factor]).T, "o-", color=palette.QUIET, markersize=3, linewidth=1
    )
    axes.plot(estimate.value, factor * estimate.objective, "D", color=palette.ACCENT, markersize=6)
    axes.annotate(
        f"{estimate.name} = {estimate.value:.4g} {estimate.unit}",
        (estimate.value, factor * estimate.objective),
        xytext=(0.5, 0.92), textcoords="axes fraction", ha="center", color=palette.ACCENT,
    )  # fmt: skip
    if not in_percent:
        axes.set_xscale("log")
        axes.set_yscale("log")
    symbol = {"G_f": "$G_f$", "d_f": "$d_f$"}[estimate.name]
    axes.set_xlabel(f"{symbol} [{estimate.unit}]")
    axes.set_ylabel("$opt_d$ [% damping]" if in_percent else "$opt_G$ [Hz]")
    axes.margins(y=0.2)
    if in_percent:
        axes.set_ylim(bottom=0.0)
