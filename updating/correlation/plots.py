"""Figures of correlation: MAC, points, functions, and measured FRFs beside computed ones."""

from __future__ import annotations

from contextlib import closing
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.modal.mac import frac
from ema.plot import palette
from ema.plot.figures import UNIT
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel, synthesize_runs
from lamella_shared import Complexes, Reals
from model import Stack
from updating.correlation.localization import ErrorMap, stiffness_index

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


def error_map_picture(error_map: ErrorMap, stack: Stack, kind: str, *, size: tuple[int, int] = (1200, 460)) -> bytes:
    """Draw the error of one kind of stiffness on the stack, `ErrorMap.relative`, as a PNG.

    The stack is seen from two opposite corners, its clamps as rods.

    Parameters
    ----------
    error_map : ErrorMap
        Of the stack.
    stack : Stack
        The stack.
    kind : str
        One of `ENERGY_KINDS` but the mass.
    size : tuple of int
        Width and height of the picture, px.
    """
    views = {"front, from above": (-0.5, -1.0, 0.6), "back, from below": (0.5, 1.0, -0.6)}
    label, where = "error over its mean", error_map.regions
    value = error_map.relative[stiffness_index(kind)]
    import pyvista as pv
    from PIL import Image

    grid: Any = pv.RectilinearGrid(where.x, where.y, where.z)
    grid.cell_data[label] = value.ravel(order="F")
    with pv.vtk_verbosity("off"):  # VTK warns when there is no display, though it then renders without one
        plotter: Any = pv.Plotter(shape=(1, 2), off_screen=True, window_size=list(size), border=False)
    plotter.set_background("white")
    for column, (view, direction) in enumerate(views.items()):
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
        heading = f"{kind}: {view}" if column == 0 else view
        plotter.add_text(heading, position=(8.0, size[1] - 30.0), font_size=10, color=palette.INK)
        plotter.add_axes(color=palette.INK, viewport=(0.8, 0.0, 1.0, 0.3))
        plotter.view_vector(direction, viewup=(0.0, 0.0, 1.0))
        plotter.camera.zoom(1.3)
    with closing(plotter):
        image = plotter.screenshot(return_img=True)
    buffer = BytesIO()
    Image.fromarray(image).save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def chosen_functions(measured: ModalModel) -> tuple[int, ...]:
    """Return the outputs whose first function is matched worst, in the middle, and best, by FRAC."""
    order = np.argsort(measured.correlation[:, 0], kind="stable")
    picked = (order[0], order[order.size // 2], order[-1])
    return tuple(int(k) for k in dict.fromkeys(picked))


def overlay_figure(
    frf: FRF, measured: ModalModel, model: Complexes | None = None, *, found: bool = False, beside: bool = False
) -> Figure:
    """Draw functions with the synthesised ones over them, their difference, their phase and their coherence.

    Shown are the worst, the middle and the best of all by FRAC (`chosen_functions`), over the band that was
    identified. Dashed lines mark the identified natural frequencies.

    Parameters
    ----------
    frf : FRF
        Measured functions.
    measured : ModalModel
        Modes identified from them.
    model : (n_chosen, n_frequency) complex, optional
        What a fitted model gives for the chosen functions at the lines of the band.
    found : bool
        Whether that is the model with what was identified, not the base model.
    beside : bool
        Whether functions stand beside each other, as on a slide, or under each other.
    """
    from matplotlib.figure import Figure

    slide = (12.3, 5.9)  # in, that a slide has below its title

    lines, fitted = synthesized(frf, measured)
    chosen = chosen_functions(measured)
    n = 2 if lines.coherence is None else 3
    width, height = slide if beside else (7.5, 0.95 + (2.3 if n == 2 else 2.8) * len(chosen))
    figure = Figure(figsize=(width, height))
    outer = figure.add_gridspec(
        *((1, len(chosen)) if beside else (len(chosen), 1)), hspace=0.17, wspace=0.25, left=0.75 / width,
        right=1.0 - 0.2 / width, top=1.0 - (0.8 if beside else 0.5) / height, bottom=0.45 / height,
    )  # fmt: skip
    panels: list[Axes] = []
    for k in range(len(chosen)):
        inner = outer[k].subgridspec(n, 1, height_ratios=[3, 1.2, 0.9][:n], hspace=0.14)
        panels += [figure.add_subplot(inner[i]) for i in range(n)]
    for k, o in enumerate(chosen):
        magnitude, phase = panels[n * k], panels[n * k + 1]
        _draw_magnitude(magnitude, lines, fitted, o)
        for value, color, size in ((lines.value[o, 0], palette.MEASURED, 1.8), (fitted[o, 0], palette.MODES, 0.8)):
            phase.plot(lines.frequency, _degrees(value), ".", color=color, markersize=size)
        title = f"{lines.output.name(o)} over {lines.input.name(0)}, FRAC {measured.correlation[o, 0]:.4f}"
        if model is not None:
            _draw_model(magnitude, phase, lines.frequency, model[k], found=found)
            name = "model with what was identified" if found else "fitted model"
            title += ",\n" if beside else ", "
            title += f"of the {name} {float(frac(lines.value[o, 0], model[k])):.4f}"
        phase.set(ylabel="phase [°]", ylim=(-200, 200), yticks=[-180, 0, 180])
        if lines.coherence is not None:
            panels[n * k + 2].plot(lines.frequency, lines.coherence[o, 0], color=palette.MEASURED, linewidth=0.8)
            panels[n * k + 2].set(ylabel="coh. [1]", ylim=(0.0, 1.1), yticks=[0, 1])
        magnitude.set_title(title, fontsize="small", loc="left")
    lowest = panels[n - 1 :: n] if beside else panels[-1:]
    for axes in panels:
        axes.set_xlim(lines.frequency[0], lines.frequency[-1])
        axes.tick_params(labelsize=8, labelbottom=axes in lowest)
        axes.yaxis.label.set_fontsize(8)
        for f in measured.frequency:
            axes.axvline(f, color=palette.ACCENT, linewidth=0.7, linestyle="--")
    for axes in panels[n:] if beside else ():
        axes.set_ylabel("")  # as in the first column
    figure.align_ylabels()
    for axes in lowest:
        axes.set_xlabel("frequency [Hz]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="upper right", ncols=4, frameon=False, fontsize="small")
    return figure


def synthesized(frf: FRF, measured: ModalModel) -> tuple[FRF, Complexes]:
    """Return the functions within the identified band and those that the modes stand for there."""
    lines = within_band(frf, measured)
    return lines, synthesize_runs(measured, lines.frequency, lines.quantity, lines.run)


def within_band(frf: FRF, measured: ModalModel) -> FRF:
    """Return the functions at the lines of the band that was identified, less that at 0 Hz."""
    return frf.band(max(measured.band[0], np.finfo(float).tiny), measured.band[1])


def _draw_magnitude(axes: Axes, lines: FRF, fitted: Complexes, output: int) -> None:
    value, model = lines.value[output, 0], fitted[output, 0]
    axes.semilogy(
        lines.frequency, np.abs(value - model), color=palette.LEFT, linewidth=0.5, alpha=0.6, label="difference"
    )
    axes.semilogy(lines.frequency, np.abs(value), color=palette.MEASURED, linewidth=1.8, label="measured")
    axes.semilogy(lines.frequency, np.abs(model), color=palette.MODES, linewidth=1.0, label="from the modes")
    axes.set_ylabel(UNIT[lines.quantity])


def _draw_model(magnitude: Axes, phase: Axes, frequency: Reals, model: Complexes, *, found: bool) -> None:
    sparse = 16
    gaps = (0, (1.5, 3.5))  # through which the other curves are seen
    color, name = (palette.FOUND, "with what was identified") if found else (palette.BASE, "fitted model")
    magnitude.semilogy(frequency, np.abs(model), color=color, linewidth=1.4, linestyle=gaps, label=name)
    phase.plot(frequency[::sparse], _degrees(model[::sparse]), ".", color=color, markersize=1.5)


def _degrees(value: Complexes) -> Reals:
    return np.asarray(np.degrees(np.angle(value)))
