"""Pictures of where measurement and model disagree: over the stack, and over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.plot import palette
from model import Stack
from updating.correlation.energy import Regions
from updating.correlation.frf_correlation import FrfCorrelation
from updating.correlation.localization import ErrorMap, stiffness_index
from updating.correlation.point_correlation import PointCorrelation

if TYPE_CHECKING:
    import pyvista
    from matplotlib.figure import Figure

_VIEWS = {"front, from above": (-0.5, -1.0, 0.6), "back, from below": (0.5, 1.0, -0.6)}
_SCALAR_BAR = {
    "color": "black",
    "n_labels": 3,
    "fmt": "%.2g",
    "height": 0.13,
    "width": 0.5,
    "position_x": 0.25,
    "position_y": 0.03,
    "title_font_size": 15,
    "label_font_size": 13,
}
LEAST_SCALE = 2.0
"""End of a flat map's colour scale over its mean, so that it looks flat."""


def error_map_picture(
    error_map: ErrorMap, stack: Stack, kind: str, *, size: tuple[int, int] = (1200, 460)
) -> bytes:
    """Draw the error of one kind of stiffness on the stack, `ErrorMap.relative`, as a PNG.

    1 is the kind's mean over the stack, so a stack that is wrong everywhere alike is of one colour.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    stack : Stack
        The stack that it belongs to.
    kind : str
        Kind of stiffness, one of `energy.KINDS` without the mass.
    size : (int, int)
        Width and height in pixels.

    Raises
    ------
    UpdatingError
        There is no such kind of stiffness.
    """
    value = error_map.relative[stiffness_index(kind)]
    return region_picture(value, error_map.regions, stack, title=kind, label="error over its mean", size=size)


def region_picture(
    value: NDArray[np.float64],
    where: Regions,
    stack: Stack,
    *,
    title: str,
    label: str,
    size: tuple[int, int] = (1200, 460),
) -> bytes:
    """Return the picture of `region_plotter` as a PNG file's bytes."""
    from io import BytesIO

    from PIL import Image

    plotter: Any = region_plotter(value, where, stack, title=title, label=label, size=size)
    try:
        image = plotter.screenshot(return_img=True)
    finally:
        plotter.close()
    buffer = BytesIO()
    Image.fromarray(image).save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def region_plotter(
    value: NDArray[np.float64],
    where: Regions,
    stack: Stack,
    *,
    title: str,
    label: str,
    size: tuple[int, int] = (1200, 460),
) -> pyvista.Plotter:
    """Draw a quantity of every region on the stack, seen from two opposite corners, clamps as rods.

    Parameters
    ----------
    value : (n_x, n_y, n_z) float
        What to draw, not negative: an error, or the share of a mode's energy from `energy.modal_energy`.
    where : Regions
        The regions.
    stack : Stack
        The stack.
    title, label : str
        Heading, and name of the quantity.
    size : (int, int)
        Width and height in pixels.

    Returns
    -------
    pyvista.Plotter
        Off-screen and not yet rendered; the caller closes it.
    """
    import pyvista as pv

    grid: Any = pv.RectilinearGrid(where.x, where.y, where.z)
    grid.cell_data[label] = value.ravel(order="F")
    with pv.vtk_verbosity("off"):  # VTK warns when there is no display, though it then renders without one
        plotter: Any = pv.Plotter(shape=(1, 2), off_screen=True, window_size=list(size), border=False)
    plotter.set_background("white")
    for column, (view, direction) in enumerate(_VIEWS.items()):
        plotter.subplot(0, column)
        plotter.add_mesh(
            grid,
            scalars=label,
            clim=(0.0, max(float(value.max()), LEAST_SCALE * float(value.mean()))),
            cmap=palette.PLACE,
            lighting=False,  # shadows would read as large values
            show_edges=True,
            edge_color=palette.QUIET,
            show_scalar_bar=column == 0,
            scalar_bar_args={"title": f"{label}\n", **_SCALAR_BAR},  # the empty line keeps it off the numbers
        )
        for clamp in stack.clamps:
            ends = np.array([[clamp.x, clamp.y, sign * 0.8 * stack.height] for sign in (-1.0, 1.0)])
            plotter.add_mesh(pv.lines_from_points(ends), color=palette.MODES, line_width=4)
        # one line, for VTK's touch each other, and at a place, for in a corner long text is smaller than short
        heading = f"{title}: {view}" if column == 0 else view
        plotter.add_text(heading, position=(8.0, size[1] - 30.0), font_size=10, color=palette.INK)
        plotter.add_axes(color=palette.INK, viewport=(0.8, 0.0, 1.0, 0.3))
        plotter.view_vector(direction, viewup=(0.0, 0.0, 1.0))
        plotter.camera.zoom(1.3)
    return plotter


def frf_correlation_figure(correlation: FrfCorrelation) -> Figure:
    """Draw CSAC and CSF over frequency above the FRAC of each function."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    over_frequency, by_function = figure.subplots(2, 1)
    curves = {"CSAC": correlation.csac, "CSF": correlation.csf}
    for (name, values), color in zip(curves.items(), palette.SERIES, strict=False):
        over_frequency.plot(correlation.frequency, values, color=color, linewidth=1, label=name)
    over_frequency.set(xlabel="frequency [Hz]", ylabel="agreement", ylim=(0.0, 1.05))
    over_frequency.legend(frameon=False, ncols=2)
    frac = correlation.frac.ravel(order="F")
    by_function.bar(np.arange(1, frac.size + 1), frac, color=palette.SERIES[0])
    by_function.set(xlabel="function (outputs of each input in turn)", ylabel="FRAC", ylim=(0.0, 1.05))
    return figure


def comac_figure(points: PointCorrelation) -> Figure:
    """Draw 1 - CoMAC of every point above the difference of shapes and what noise makes of it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    at = np.arange(points.node.size)
    above.bar(at, 1.0 - points.comac, color=palette.LEFT)
    above.set_ylabel("1 - CoMAC [1]")
    below.bar(at, points.error, color=palette.LEFT, label="measured - model")
    below.plot(at, points.error_std, ".", color=palette.QUIET, markersize=4, label="from noise alone")
    below.set_ylabel("difference / rms [1]")
    step = max(1, -(-at.size // 12))
    below.set_xticks(at[::step], [str(n) for n in points.node[::step]])
    below.set_xlabel("point")
    below.margins(x=0.01, y=0.35)
    below.legend(loc="upper right", ncols=2, frameon=False, fontsize="small")
    figure.align_ylabels()
    return figure
