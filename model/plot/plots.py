"""Pictures of a stack, of the pressure in it, and of its mode shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lamella_shared import Reals, figure_of, html_of, html_table
from model.contact.pressing import PressureField
from model.modes.modes import Modes, Surface, mode_surface
from model.reduction.reduction import ReducedSystem
from model.stack.outline import Triangulation
from model.stack.parts import PatchSupport
from model.stack.stack import Stack

if TYPE_CHECKING:
    import pyvista
    from matplotlib.axes import Axes
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


def mode_plotter(
    system: ReducedSystem, modes: Modes, mode: int, *, size: tuple[int, int] = (900, 600)
) -> pyvista.Plotter:
    """Draw a deformed stack, coloured by displacement, with lamina edges, the outline at rest and the clamps.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    modes : Modes
        Modes of that system.
    mode : int
        Column of `modes.shape`, from 0.
    size : (int, int)
        Width and height of the picture in pixels.

    Returns
    -------
    pyvista.Plotter
        Off-screen and not yet rendered; the caller closes it.

    Raises
    ------
    SolveError
        There is no such mode.
    """
    import pyvista as pv

    sheets = 9  # laminas whose edges are drawn
    swell = 0.08  # largest drawn displacement, as a share of the stack's length

    stack = system.stack
    lamina = np.unique(np.linspace(0, stack.n_lamina - 1, sheets).round().astype(int))
    surface = mode_surface(system, modes, mode, lamina=lamina.tolist())
    length = np.linalg.norm(surface.displacement, axis=-1)
    scale = swell * stack.length / length.max()
    moved = surface.location + scale * surface.displacement

    with pv.vtk_verbosity("off"):  # VTK warns when there is no display, though it then renders without one
        plotter: Any = pv.Plotter(off_screen=True, window_size=list(size))
    plotter.set_background("white")
    _add_surface(plotter, surface, moved, length)
    half = np.array([stack.length, stack.width, stack.height]) / 2.0
    box = pv.Box(bounds=np.column_stack([-half, half]).ravel())
    plotter.add_mesh(box, style="wireframe", color="grey", line_width=1)
    for clamp in stack.clamps:
        ends = np.array([[clamp.x, clamp.y, -1.3 * half[2]], [clamp.x, clamp.y, 1.3 * half[2]]])
        plotter.add_mesh(pv.lines_from_points(ends), color="firebrick", line_width=4)
    plotter.add_text(f"{modes.frequency[mode]:.1f} Hz", font_size=12, color="black")
    plotter.view_vector((-0.55, -1.0, 0.6), viewup=(0.0, 0.0, 1.0))
    plotter.camera.zoom(1.4)
    return plotter


def _add_surface(plotter: Any, surface: Surface, moved: Reals, length: Reals) -> None:
    """Add the surface with its points moved, coloured by how far, and the edges of its laminas."""
    import pyvista as pv

    n_sheet, n_point = length.shape
    low, high = surface.edge.T
    below = n_point * np.arange(n_sheet - 1)[:, None]
    walls = np.stack([below + low, below + high, below + n_point + high, below + n_point + low], axis=-1)
    points = moved.reshape(-1, 3)
    for faces in (surface.element, (n_sheet - 1) * n_point + surface.element, walls.reshape(-1, 4)):
        side = pv.PolyData.from_regular_faces(points, faces)
        side["displacement"] = length.ravel()
        plotter.add_mesh(
            side, scalars="displacement", clim=(0.0, float(length.max())), cmap="viridis", show_scalar_bar=False
        )
    sheets = n_point * np.arange(n_sheet)[:, None, None]
    lines = np.concatenate([np.full((n_sheet, len(low), 1), 2), sheets + surface.edge], axis=-1)
    plotter.add_mesh(pv.PolyData(points, lines=lines.ravel()), color="black", line_width=1)


def mode_png(system: ReducedSystem, modes: Modes, mode: int, *, size: tuple[int, int] = (900, 600)) -> bytes:
    """Return the picture of `mode_plotter` as a PNG file's bytes."""
    from io import BytesIO

    from PIL import Image

    plotter = mode_plotter(system, modes, mode, size=size)
    try:
        image = plotter.screenshot(return_img=True)
    finally:
        plotter.close()
    buffer = BytesIO()
    Image.fromarray(image).save(buffer, format="PNG")
    return buffer.getvalue()


_SHEET, _EDGE, _CLAMP, _SUPPORT = "#dfe5ec", "0.35", "#b3341f", "#1f5f8b"


@html_of.register(Stack)
def stack_html(stack: Stack) -> str:
    """List size, sheets, contact, clamps and effects."""
    rows = [
        ("size", f"{1e3 * stack.length:g} x {1e3 * stack.width:g} x {1e3 * stack.height:g} mm"),
        ("sheets", f"{stack.n_lamina} of {1e3 * stack.pitch:.3g} mm, E = {stack.material.young / 1e9:.4g} GPa"),
        ("mass", f"{stack.mass:.4g} kg, of which clamps {sum(clamp.mass for clamp in stack.clamps):.3g} kg"),
    ]
    if stack.n_lamina > 1:
        c = stack.contact
        rows.append(("contact", f"G_f = {c.G_f:.4g}, d_f = {c.d_f:.3g} s/Pa at {c.pressure / 1e3:.4g} kPa"))
    rows += [("soft layer", f"{1e3 * layer.thickness:g} mm") for layer in stack.interlayers]
    rows += [("support", type(support).__name__) for support in stack.supports]
    rows += [("effect", effect.label) for effect in stack.effects]
    return html_table(stack.name, (), rows)


@figure_of.register(Stack)
def stack_figure(stack: Stack) -> Figure:
    """Draw the plan seen from above, over the side with every few laminas; clamps are red, supports blue."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 1.6 + 7.0 * (stack.width + stack.height) / stack.length), layout="constrained")
    plan, side = figure.subplots(2, 1, sharex=True, height_ratios=[stack.width, stack.height])
    _draw_plan(plan, stack)
    _draw_side(side, stack)
    for axes, upright in ((plan, "y"), (side, "z")):
        axes.set_aspect("equal")
        axes.set_ylabel(f"{upright} [mm]")
        axes.spines[["top", "right"]].set_visible(False)
    side.set_xlabel("x [mm]")
    return figure


def _draw_plan(axes: Axes, stack: Stack) -> None:
    from matplotlib.patches import Polygon, Rectangle

    least_clamp = 0.02  # drawn width of a clamp over a line or point, as a share of the length

    if isinstance(stack.outline, Triangulation):
        axes.triplot(*(1e3 * stack.outline.point).T, stack.outline.triangle, color=_EDGE, linewidth=0.5)
    else:
        half = np.array([stack.length, stack.width]) / 2.0
        corners = half * [[-1, -1], [1, -1], [1, 1], [-1, 1]]
        boundary, holes = (corners, ()) if stack.outline is None else (stack.outline.boundary, stack.outline.holes)
        axes.add_patch(Polygon(1e3 * boundary, facecolor=_SHEET, edgecolor=_EDGE))
        for hole in holes:
            axes.add_patch(Polygon(1e3 * hole, facecolor="white", edgecolor=_EDGE))
    for clamp in stack.clamps:
        x, y = (max(size, least_clamp * stack.length) for size in clamp.footprint)
        corner = 1e3 * (clamp.x - x / 2.0), 1e3 * (clamp.y - y / 2.0)
        axes.add_patch(Rectangle(corner, 1e3 * x, 1e3 * y, color=_CLAMP, alpha=0.6))
    for support in stack.supports:
        if isinstance(support, PatchSupport):
            x, y = support.size
            corner = 1e3 * (support.x - x / 2.0), 1e3 * (support.y - y / 2.0)
            axes.add_patch(Rectangle(corner, 1e3 * x, 1e3 * y, fill=False, edgecolor=_SUPPORT, hatch="//"))
    axes.autoscale_view()


def _draw_side(axes: Axes, stack: Stack) -> None:
    lines = 12  # of laminas that the side shows at most
    from matplotlib.patches import Rectangle

    half = 500.0 * np.array([stack.length, stack.height])
    axes.add_patch(Rectangle((-half[0], -half[1]), 2.0 * half[0], 2.0 * half[1], facecolor=_SHEET, edgecolor=_EDGE))
    shown = np.unique(np.linspace(0, stack.n_lamina - 1, lines).round().astype(int))
    axes.hlines(1e3 * stack.lamina_z[shown], -half[0], half[0], color=_EDGE, linewidth=0.4)
    for clamp in stack.clamps:
        axes.plot([1e3 * clamp.x] * 2, [-1.15 * half[1], 1.15 * half[1]], color=_CLAMP, linewidth=3.0, alpha=0.6)
    for layer in stack.interlayers:
        z = stack.lamina_z[layer.below - 1 : layer.below + 1].mean()
        axes.axhline(1e3 * z, color=_SUPPORT, linewidth=2.0)
    axes.autoscale_view()
