"""A joint fit in pictures: how parameters are correlated, and how the fit went."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from ema.plot import palette
from updating.diagnosis.joint_answer import JointFit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def correlation_figure(fit: JointFit) -> Figure:
    """Draw the correlation of the estimates; near -1 or 1 the data determine a combination of two, neither alone."""
    from matplotlib.figure import Figure

    written = 12  # parameters up to which every value is written

    names = [f"{p.name} {p.group}".strip() for p in fit.parameter]
    n = len(names)
    figure = Figure(figsize=(4.4 + 0.36 * n, 1.6 + 0.36 * n), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(fit.correlation, cmap=palette.SIGNED, vmin=-1.0, vmax=1.0)
    if n <= written:
        for i, j in np.ndindex(n, n):
            value = round(float(fit.correlation[i, j]), 2) + 0.0  # no -0.00
            axes.text(
                j, i, f"{value:.2f}", ha="center", va="center", fontsize=7,
                color="white" if abs(value) > 0.6 else "black",
            )  # fmt: skip
    axes.set_title("correlation of the estimates", fontsize=10)
    axes.set_xticks(range(n), [str(i + 1) for i in range(n)], fontsize=8)
    labels = [textwrap.shorten(name, 40, placeholder="…") for name in names]
    axes.set_yticks(range(n), [f"{label}  {i + 1}" for i, label in enumerate(labels)], fontsize=8)
    figure.colorbar(image, ax=axes, shrink=0.8)
    return figure


def convergence_figure(fit: JointFit) -> Figure:
    """Draw what the fit minimises after each step, less its least; it jumps where the model is linearised again."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(np.arange(fit.course.size), fit.course - fit.course.min(initial=np.inf), "o-", markersize=3)
    axes.set_yscale("symlog", linthresh=0.1)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("step")
    axes.set_ylabel("minus log posterior density, less its least")
    return figure
