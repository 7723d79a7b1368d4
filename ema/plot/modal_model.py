"""A modal model as it shows itself: the table of its modes, all its shapes, and one shape to turn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ema.plot import palette
from ema.plot.figures import draw_shape, shape_displacement, trace_rows
from ema.types.errors import IdentificationError
from ema.types.modal_model import ModalModel, frequency_text
from lamella_shared import figure_of, html_of, html_table

if TYPE_CHECKING:
    import pyvista
    from matplotlib.figure import Figure


@html_of.register(ModalModel)
def modal_model_html(model: ModalModel) -> str:
    """List the modes with frequency and damping ratio, each with its standard deviation."""
    rows = [
        (str(r), frequency_text(f, 2), f"{fs:.2g}", f"{100 * x:.3g}", f"{100 * xs:.2g}", "yes" if scaled else "no")
        for r, (f, fs, x, xs, scaled) in enumerate(
            zip(model.frequency, model.frequency_std, model.damping, model.damping_std, model.scaled, strict=True), 1
        )
    ]
    return html_table(
        f"{model.name}: {len(rows)} modes from {model.band[0]:g} to {model.band[1]:g} Hz at {model.node.size} DOFs",
        ("mode", "frequency [Hz]", "std [Hz]", "damping [%]", "std [%]", "mass-normalised"),
        rows,
    )


@figure_of.register(ModalModel)
def modal_model_figure(model: ModalModel) -> Figure:
    """Draw all mode shapes as wireframes of the measured points over their places at rest."""
    columns = 3
    from matplotlib.figure import Figure

    zoom = 1.7  # axes leave much room about a body that is longer than high

    n = model.frequency.size
    n_row = max(1, -(-n // columns))
    figure = Figure(figsize=(3.2 * min(max(n, 1), columns), 2.5 * n_row), layout="constrained")
    for mode in range(n):
        axes = figure.add_subplot(n_row, min(n, columns), mode + 1, projection="3d")
        draw_shape(axes, model, mode)
        axes.set_axis_off()
        axes.set_box_aspect((4.0, 4.0, 3.0), zoom=zoom)
    return figure


def turnable(modal_model: ModalModel, mode: int, *, off_screen: bool | None = None) -> pyvista.Plotter:
    """Put a mode shape, coloured by how far it moves, over its points at rest, to be turned.

    Parameters
    ----------
    modal_model : ModalModel
        The modes.
    mode : int
        Position of the mode in the model, from 0.
    off_screen : bool, optional
        Whether no window is shown; by default what PyVista is set to.

    Returns
    -------
    pyvista.Plotter
        Not yet shown. Its `show()` opens a window, or in Jupyter a view that turns (`pip install "lamella[notebook]"`).

    Raises
    ------
    IdentificationError
        There is no such mode.
    """
    import pyvista as pv

    n = modal_model.frequency.size
    if not 0 <= mode < n:
        raise IdentificationError(f"mode = {mode}: the modes of {modal_model.name} are numbered from 0 to {n - 1}")
    moved = shape_displacement(modal_model, mode)
    rest, line = modal_model.geometry.coordinate, trace_rows(modal_model.geometry)
    cells = np.column_stack([np.full(len(line), 2), line]).ravel()
    with pv.vtk_verbosity("off"):  # VTK warns when there is no display, though it then renders without one
        plotter: Any = pv.Plotter(off_screen=off_screen)
    plotter.set_background("white")
    for points, style in (
        (rest, {"color": palette.PALE, "line_width": 1}),
        (rest + moved, {"scalars": np.linalg.norm(moved, axis=1), "cmap": palette.MOTION, "line_width": 4}),
    ):
        mesh = pv.PolyData(points, lines=cells) if cells.size else pv.PolyData(points)
        plotter.add_mesh(mesh, show_scalar_bar=False, point_size=8, render_points_as_spheres=True, **style)
    plotter.add_text(
        f"{modal_model.frequency[mode]:.1f} Hz, {100.0 * modal_model.damping[mode]:.2f} %",
        font_size=12,
        color=palette.INK,
    )
    return plotter
