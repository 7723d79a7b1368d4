"""Picture of the pressure between the laminas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from model.contact.pressure import PressureField

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def pressure_figure(field: PressureField) -> Figure:
    """Draw the pressure over the plan at the bottom, middle and top interface, and its spread over the height.

    Parameters
    ----------
    field : PressureField
        Result of the static stage.

    Returns
    -------
    matplotlib.figure.Figure
        Not tied to any window; save it with `savefig`.
    """
    from matplotlib.figure import Figure
    from matplotlib.tri import Triangulation

    n = field.pressure.shape[0]
    kilo = field.pressure.reshape(n, -1) / 1e3
    x, y = field.plan.quadrature_points.reshape(2, -1) * 1e3
    grid = Triangulation(x, y)
    centre = np.column_stack([x[grid.triangles].mean(axis=1), y[grid.triangles].mean(axis=1)]) * 1e-3
    moved = np.linalg.norm(field.plan.nearest(centre) - centre, axis=1)
    grid.set_mask(moved > 1e-9)  # over holes and notches
    plans = [f"plan {i}" for i in range(3)]
    length, width = np.ptp(field.plan.bounds, axis=1)
    if length > 2.0 * width:
        figure = Figure(figsize=(11.0, 6.0), layout="constrained")
        places = figure.subplot_mosaic([[name, "height"] for name in plans], width_ratios=[3, 1])
    else:
        figure = Figure(figsize=(14.0, 4.5), layout="constrained")
        places = figure.subplot_mosaic([[*plans, "height"]], width_ratios=[1, 1, 1, 0.8])
    shown = {"bottom": 0, "middle": n // 2, "top": n - 1}
    top = float(kilo.max())
    for i, (name, k) in enumerate(shown.items()):
        axes = places[f"plan {i}"]
        drawn = axes.tripcolor(grid, kilo[k], shading="gouraud", vmin=0.0, vmax=top, cmap="viridis")
        axes.set_aspect("equal")
        axes.set_title(
            f"{name} interface: {kilo[k].min():.3g} to {kilo[k].max():.3g} kPa", loc="left", fontsize="medium"
        )
        axes.set_ylabel("y in mm")
        axes.set_xlabel("x in mm")
    figure.colorbar(drawn, ax=[places[name] for name in plans], label="pressure in kPa")
    height = places["height"]
    interface = np.arange(1, n + 1)
    height.fill_betweenx(interface, kilo.min(axis=1), kilo.max(axis=1), alpha=0.3, label="lowest to highest")
    height.axvline(field.mean / 1e3, color="black", label="mean: clamps' force over area")
    height.set_xlabel("pressure in kPa")
    height.set_ylabel("interface, from the bottom")
    height.set_xlim(left=0.0)
    figure.legend(*height.get_legend_handles_labels(), loc="outside lower right", ncols=2, fontsize="small")
    return figure
