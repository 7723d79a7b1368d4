"""A stack as it shows itself: its numbers as a table, and its plan and side with clamps and supports."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from model.stack.outline import Triangulation
from model.stack.parts import PatchSupport
from model.stack.shown import figure_of, html_of, html_table
from model.stack.stack import Stack

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHEET, _EDGE, _CLAMP, _SUPPORT = "#dfe5ec", "0.35", "#b3341f", "#1f5f8b"
_LINES = 12  # of laminas that the side shows at most
_LEAST_CLAMP = 0.02  # drawn width of a clamp over a line or point, as a share of the length


@html_of.register(Stack)
def stack_html(own: Stack) -> str:
    """List size, sheets, contact, clamps and effects."""
    rows = [
        ("size", f"{1e3 * own.length:g} x {1e3 * own.width:g} x {1e3 * own.height:g} mm"),
        ("sheets", f"{own.n_lamina} of {1e3 * own.pitch:.3g} mm, E = {own.material.young / 1e9:.4g} GPa"),
        ("mass", f"{own.mass:.4g} kg, of which clamps {sum(clamp.mass for clamp in own.clamps):.3g} kg"),
    ]
    if own.n_lamina > 1:
        c = own.contact
        rows.append(("contact", f"G_f = {c.G_f:.4g}, d_f = {c.d_f:.3g} s/Pa at {c.pressure / 1e3:.4g} kPa"))
    rows += [("soft layer", f"{1e3 * own_layer.thickness:g} mm") for own_layer in own.interlayers]
    rows += [("support", type(support).__name__) for support in own.supports]
    rows += [("effect", effect.label) for effect in own.effects]
    return html_table(own.name, (), rows)


@figure_of.register(Stack)
def stack_figure(own: Stack) -> Figure:
    """Draw the plan seen from above, over the side with every few laminas; clamps are red, supports blue."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 1.6 + 7.0 * (own.width + own.height) / own.length), layout="constrained")
    plan, side = figure.subplots(2, 1, sharex=True, height_ratios=[own.width, own.height])
    _draw_plan(plan, own)
    _draw_side(side, own)
    for axes, upright in ((plan, "y"), (side, "z")):
        axes.set_aspect("equal")
        axes.set_ylabel(f"{upright} [mm]")
        axes.spines[["top", "right"]].set_visible(False)
    side.set_xlabel("x [mm]")
    return figure


def _draw_plan(axes: Axes, own: Stack) -> None:
    from matplotlib.patches import Polygon, Rectangle

    if isinstance(own.outline, Triangulation):
        axes.triplot(*(1e3 * own.outline.point).T, own.outline.triangle, color=_EDGE, linewidth=0.5)
    else:
        half = np.array([own.length, own.width]) / 2.0
        corners = half * [[-1, -1], [1, -1], [1, 1], [-1, 1]]
        boundary, holes = (corners, ()) if own.outline is None else (own.outline.boundary, own.outline.holes)
        axes.add_patch(Polygon(1e3 * boundary, facecolor=_SHEET, edgecolor=_EDGE))
        for hole in holes:
            axes.add_patch(Polygon(1e3 * hole, facecolor="white", edgecolor=_EDGE))
    for clamp in own.clamps:
        x, y = (max(size, _LEAST_CLAMP * own.length) for size in clamp.footprint)
        corner = 1e3 * (clamp.x - x / 2.0), 1e3 * (clamp.y - y / 2.0)
        axes.add_patch(Rectangle(corner, 1e3 * x, 1e3 * y, color=_CLAMP, alpha=0.6))
    for support in own.supports:
        if isinstance(support, PatchSupport):
            x, y = support.size
            corner = 1e3 * (support.x - x / 2.0), 1e3 * (support.y - y / 2.0)
            axes.add_patch(Rectangle(corner, 1e3 * x, 1e3 * y, fill=False, edgecolor=_SUPPORT, hatch="//"))
    axes.autoscale_view()


def _draw_side(axes: Axes, own: Stack) -> None:
    from matplotlib.patches import Rectangle

    half = 500.0 * np.array([own.length, own.height])
    axes.add_patch(
        Rectangle((-half[0], -half[1]), 2.0 * half[0], 2.0 * half[1], facecolor=_SHEET, edgecolor=_EDGE)
    )
    shown = np.unique(np.linspace(0, own.n_lamina - 1, _LINES).round().astype(int))
    axes.hlines(1e3 * own.lamina_z[shown], -half[0], half[0], color=_EDGE, linewidth=0.4)
    for clamp in own.clamps:
        axes.plot(
            [1e3 * clamp.x] * 2, [-1.15 * half[1], 1.15 * half[1]], color=_CLAMP, linewidth=3.0, alpha=0.6
        )
    for layer in own.interlayers:
        z = own.lamina_z[layer.below - 1 : layer.below + 1].mean()
        axes.axhline(1e3 * z, color=_SUPPORT, linewidth=2.0)
    axes.autoscale_view()
