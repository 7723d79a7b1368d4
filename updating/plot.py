"""Pictures that show measurement and model together."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema.mac import real_shape
from ema.modes import ModalModel
from updating.fit import Estimate, Fit

if TYPE_CHECKING:
    import pyvista as pv
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def objective_figure(estimates: tuple[Estimate, ...]) -> Figure:
    """Draw the objective over every value tried of each parameter, the estimate marked."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * len(estimates), 3.2), layout="constrained")
    for axes, estimate in zip(np.atleast_1d(figure.subplots(1, len(estimates))), estimates, strict=True):
        _draw_objective(axes, estimate)
    return figure


def _draw_objective(axes: Axes, estimate: Estimate) -> None:
    in_percent = estimate.name == "d_f"
    factor = 100.0 if in_percent else 1.0
    order = np.argsort(estimate.history[:, 0])
    axes.plot(*(estimate.history[order] * [1.0, factor]).T, "o-", color="0.55", markersize=3, linewidth=1)
    axes.plot(estimate.value, factor * estimate.objective, "D", color="#b3341f", markersize=6)
    axes.annotate(
        f"{estimate.name} = {estimate.value:.4g} {estimate.unit}",
        (estimate.value, factor * estimate.objective),
        xytext=(0.5, 0.92), textcoords="axes fraction", ha="center", color="#b3341f",
    )  # fmt: skip
    if not in_percent:
        axes.set_xscale("log")
        axes.set_yscale("log")
    symbol = {"G_f": "$G_f$", "d_f": "$d_f$"}[estimate.name]
    axes.set_xlabel(f"{symbol} [{estimate.unit}]")
    axes.set_ylabel("$opt_d$ [% damping]" if in_percent else "$opt_G$ [Hz]")
    axes.margins(y=0.2)


def as_png(figure: Figure) -> bytes:
    """Draw a figure as PNG, fine enough to print."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=160, metadata={"Software": None})
    return buffer.getvalue()


def shape_picture(measured: ModalModel, fit: Fit, index: int) -> bytes:
    """Draw one pair of mode shapes at the measured points, measured left and modelled right, as a PNG.

    The modelled shape has the sign of the measured one. Both are scaled to the same largest displacement.

    Parameters
    ----------
    measured : ModalModel
        Identified modes with their geometry.
    fit : Fit
        The fitted model.
    index : int
        Number of the pair, counted from 0.
    """
    import pyvista as pv

    r, s = int(fit.pairing.measured[index]), int(fit.pairing.model[index])
    shape = real_shape(measured.shape[:, [r]])[:, 0]
    modelled = fit.modes.shape[:, s] * np.sign(shape @ fit.modes.shape[:, s])
    with pv.vtk_verbosity("off"):  # VTK warns when there is no display, though it then renders without one
        plotter = pv.Plotter(shape=(1, 2), off_screen=True, window_size=[1200, 420], border=False)
    for column, (title, values) in enumerate((("measured", shape), ("model", modelled))):
        plotter.subplot(0, column)
        _draw_wireframe(plotter, measured, values)
        frequency = measured.frequency[r] if column == 0 else fit.modes.frequency[s]
        plotter.add_text(f"{title}  {frequency:.1f} Hz", font_size=14, color="#1c2330")
    plotter.link_views()
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return _png(image)


def _draw_wireframe(plotter: pv.Plotter, measured: ModalModel, values: NDArray[np.float64]) -> None:
    """Draw the points and trace lines, deformed by one value per measured DOF, over their rest position in grey."""
    import pyvista as pv

    geometry = measured.geometry
    row = {int(n): i for i, n in enumerate(geometry.node)}
    displacement = np.zeros_like(geometry.coordinate)
    np.add.at(displacement, [row[int(n)] for n in measured.node], measured.direction * values[:, None])
    seen = np.isin(geometry.node, measured.node)
    size = float(np.max(np.ptp(geometry.coordinate, axis=0)))
    largest = float(np.max(np.abs(displacement)))
    lines = [(row[int(a)], row[int(b)]) for a, b in geometry.line]
    cells = np.array([(2, a, b) for a, b in lines if seen[a] and seen[b]]).ravel()
    rest = (
        pv.PolyData(geometry.coordinate, lines=cells)
        if cells.size
        else pv.PolyData(geometry.coordinate[seen])
    )
    moved = pv.PolyData(
        geometry.coordinate + 0.12 * size / largest * displacement, lines=cells if cells.size else None
    )
    moved["displacement"] = np.linalg.norm(displacement, axis=1) / largest
    style = {"cmap": "viridis", "clim": [0.0, 1.0], "show_scalar_bar": False}
    plotter.add_mesh(rest, color="#c8ccd2", line_width=1)
    plotter.add_mesh(moved, line_width=4, render_lines_as_tubes=True, **style)
    plotter.add_mesh(moved.extract_points(np.flatnonzero(seen), include_cells=False), point_size=9,
                     render_points_as_spheres=True, **style)  # fmt: skip
    plotter.camera_position = "iso"
    plotter.camera.azimuth = 25.0
    plotter.camera.zoom(1.2)


def _png(image: NDArray[np.uint8]) -> bytes:
    """Encode an image (height, width, 3) as PNG."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="png", optimize=True)
    return buffer.getvalue()
