"""Figures of a modal identification and of a modal model, drawn with matplotlib, and poles chosen by clicks in one."""

from __future__ import annotations

import io
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.identification.amplitude import AmplitudeDependence
from ema.identification.doubtful_modes import Stability
from ema.identification.stabilization import StabilizationDiagram
from ema.modal.configurations import Comparison
from ema.modal.mac import frac, real_shape
from ema.plot import palette
from ema.types.errors import IdentificationError
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel, frequency_text, synthesize_runs
from lamella_shared import Booleans, Complexes, Reals, figure_of, html_of, html_table

if TYPE_CHECKING:
    import pyvista
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import Event
    from matplotlib.figure import Figure

UNIT = {"receptance": "m/N", "mobility": "m/(N s)", "accelerance": "m/(N s²)"}


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
            at = _thinned(np.abs(value))
            phase.plot(lines.frequency[at], _degrees(value[at]), ".", color=color, markersize=size)
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
    for function, color, width, opacity, label in (
        (value - model, palette.LEFT, 0.5, 0.6, "difference"),
        (value, palette.MEASURED, 1.8, 1.0, "measured"),
        (model, palette.MODES, 1.0, 1.0, "from the modes"),
    ):
        size = np.abs(function)
        at = _thinned(size)
        axes.semilogy(lines.frequency[at], size[at], color=color, linewidth=width, alpha=opacity, label=label)
    axes.set_ylabel(UNIT[lines.quantity])


def _draw_model(magnitude: Axes, phase: Axes, frequency: Reals, model: Complexes, *, found: bool) -> None:
    sparse = 16
    gaps = (0, (1.5, 3.5))  # through which the other curves are seen
    color, name = (palette.FOUND, "with what was identified") if found else (palette.BASE, "fitted model")
    magnitude.semilogy(frequency, np.abs(model), color=color, linewidth=1.4, linestyle=gaps, label=name)
    phase.plot(frequency[::sparse], _degrees(model[::sparse]), ".", color=color, markersize=1.5)


def _degrees(value: Complexes) -> Reals:
    return np.asarray(np.degrees(np.angle(value)))


def stabilization_figure(
    diagram: StabilizationDiagram, figure: Figure | None = None, stability: Stability | None = None
) -> Figure:
    """Draw the poles over the model orders on the mode indicator function.

    The chart is drawn on a figure of its own, or on `figure` where a window holds one. Symbols say what of a pole is
    stable, or, where that was not asked, which poles belong to a cluster.
    """
    from matplotlib.figure import Figure

    if figure is None:
        figure = Figure(figsize=(7.5, 4.0), layout="constrained")
    axes = figure.subplots()
    behind = axes.twinx()
    indicator = diagram.indicator[0]
    at = _thinned(indicator)
    behind.semilogy(diagram.frequency[at], indicator[at], color=palette.QUIET, linewidth=0.7)
    behind.tick_params(which="both", right=False, labelright=False)
    axes.set_zorder(behind.get_zorder() + 1)
    axes.patch.set_visible(False)
    hertz = np.abs(diagram.pole) / (2.0 * np.pi)
    for label, which, style in pole_groups(diagram, stability):
        axes.plot(hertz[which], diagram.order[which], linestyle="none", label=label, **style)
    _mark_poles((axes,), np.abs(diagram.chosen) / (2.0 * np.pi))
    axes.set_xlim(diagram.frequency[0], diagram.frequency[-1])
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("model order")
    figure.legend(
        *axes.get_legend_handles_labels(), loc="outside upper right", ncols=4, fontsize="small", frameon=False
    )
    return figure


def pole_groups(
    diagram: StabilizationDiagram, stability: Stability | None
) -> list[tuple[str, Booleans, dict[str, Any]]]:
    """Return the poles of a chart in groups, each with its name and symbol."""
    if stability is None:
        return [
            ("pole", ~diagram.stable, {"marker": ".", "color": palette.QUIET, "markersize": 2}),
            ("in a cluster", diagram.stable, {"marker": ".", "color": palette.MODES, "markersize": 4}),
        ]
    f, d, s = stability.frequency, stability.damping, stability.shape
    return [
        ("not stable", ~f, {"marker": ".", "color": palette.QUIET, "markersize": 2}),
        ("stable: frequency", f & ~d, {"marker": "x", "color": palette.MEASURED, "markersize": 3.5}),
        ("frequency, damping", d & ~s, {"marker": "^", "color": palette.LEFT, "markersize": 3}),
        ("frequency, damping, shape", s, {"marker": "o", "color": palette.MODES, "markersize": 3}),
    ]


def shape_figure(modal_model: ModalModel, mode: int) -> Figure:
    """Draw a mode shape as a wireframe of the measured points, its real approximation, over the rest shape.

    Parameters
    ----------
    modal_model : ModalModel
    mode : int
        Position of the mode in the model.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 4.0), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    draw_shape(axes, modal_model, mode)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    return figure


def draw_shape(axes: Any, modal_model: ModalModel, mode: int) -> None:
    """Draw a mode shape into three-dimensional axes, over its points at rest."""
    at_rest = modal_model.geometry.coordinate
    displaced = at_rest + shape_displacement(modal_model, mode)
    lines = modal_model.geometry.line_rows(modal_model.geometry.node)
    for points, color in ((at_rest, palette.PALE), (displaced, palette.MEASURED)):
        axes.scatter(*points.T, color=color, s=8)
        ends = np.full((len(lines), 3, 3), np.nan)  # one path with gaps: lines may be many
        ends[:, :2] = points[lines]
        axes.plot(*ends.reshape(-1, 3).T, color=color, linewidth=1.0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"{modal_model.frequency[mode]:.4g} Hz, {100.0 * modal_model.damping[mode]:.3g} %", fontsize="small")


def shape_displacement(modal_model: ModalModel, mode: int) -> Reals:
    """Displacement ``(n_node, 3)`` of the points, m, largest component a sixth of the structure's size."""
    geometry = modal_model.geometry
    displacement = geometry.displacement(modal_model, real_shape(modal_model.shape[:, mode : mode + 1])[:, 0]).real
    size = float(np.max(np.ptp(geometry.coordinate, axis=0), initial=0.0)) or 1.0
    largest = float(np.max(np.linalg.norm(displacement, axis=1), initial=0.0)) or 1.0
    return displacement * size / (6.0 * largest)


def _mark_poles(panels: tuple[Axes, ...], frequency: Reals) -> None:
    for axes in panels:
        for f in frequency:
            axes.axvline(f, color=palette.ACCENT, linewidth=0.7, linestyle="--")


def _thinned(magnitude: Reals, *, max_points: int = 2000) -> NDArray[np.intp]:
    """Choose the smallest and the largest value of every bin, so that no peak is lost.

    `max_points`: lines drawn of one function; wider ones are thinned to the extremes of every bin.
    """
    n = magnitude.size
    if n <= max_points:
        return np.arange(n)
    bins = np.array_split(np.arange(n), max_points // 2)
    extremes = [(b[magnitude[b].argmin()], b[magnitude[b].argmax()]) for b in bins]
    return np.unique(np.array(extremes).ravel())


def comparison_figure(comparison: Comparison, at: Reals, label: str) -> Figure:
    """Draw frequency and damping of every mode over a property of the configurations.

    Parameters
    ----------
    comparison : Comparison
    at : (n_configuration,)
        The property: bolt torque, pressure or simply the number of the configuration.
    label : str
        Its name with its unit, for the axis.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    order = np.argsort(at)
    for r, marker in zip(range(comparison.frequency.shape[1]), cycle("osD^vPX<>"), strict=False):
        name = f"{frequency_text(np.nanmean(comparison.frequency[:, r]), 0)} Hz"
        style: dict[str, Any] = {"marker": marker, "markersize": 4, "linewidth": 1.0, "capsize": 2}
        for axes, value, std, factor in (
            (left, comparison.frequency, comparison.frequency_std, 1.0),
            (right, comparison.damping, comparison.damping_std, 100.0),
        ):
            axes.errorbar(at[order], factor * value[order, r], 2.0 * factor * std[order, r], label=name, **style)
    left.set(xlabel=label, ylabel="natural frequency [Hz]")
    right.set(xlabel=label, ylabel="damping ratio [%]")
    figure.legend(*left.get_legend_handles_labels(), loc="outside right center", title="mode (mean)", frameon=False)
    return figure


def as_png(figure: Figure) -> bytes:
    """Draw a figure as PNG, fine enough to print."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=160, metadata={"Software": None})
    return buffer.getvalue()


def amplitude_figure(dependence: AmplitudeDependence) -> Figure:
    """Draw the frequency of every mode, over that of its smallest amplitude, and its damping, over the motion.

    Parameters
    ----------
    dependence : AmplitudeDependence
        Modes that fewer than two levels have are left out.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    followed = np.flatnonzero(np.isfinite(dependence.softening))
    for r, marker in zip(followed.tolist(), cycle("osD^vPX<>"), strict=False):
        seen = np.isfinite(dependence.frequency[:, r])
        f, motion = dependence.frequency[seen, r], 1e6 * dependence.motion[seen, r]
        style = {
            "marker": marker,
            "markersize": 4,
            "linewidth": 1.0,
            "capsize": 2,
            "label": f"{frequency_text(f[0], 0)} Hz",
        }
        left.errorbar(motion, 100.0 * (f / f[0] - 1.0), 200.0 * dependence.frequency_std[seen, r] / f[0], **style)
        damping, std = dependence.damping[seen, r], dependence.damping_std[seen, r]
        right.errorbar(motion, 100.0 * damping, 200.0 * std, **style)
    label = f"displacement amplitude at {dependence.point} [µm]"
    left.set(xscale="log", xlabel=label, ylabel="change of natural frequency [%]")
    right.set(xscale="log", xlabel=label, ylabel="damping ratio [%]")
    if followed.size:
        handles = left.get_legend_handles_labels()
        figure.legend(*handles, loc="outside right center", title="mode", frameon=False)
    return figure


LEFT, RIGHT = 1, 3


def pick_poles(diagram: StabilizationDiagram) -> Complexes:
    """Show the stabilisation chart, starting from its clusters, and return what is chosen when it is closed.

    A left click adds the nearest pole of the chart, a right click takes the nearest chosen one away.

    Raises
    ------
    IdentificationError
        There is no display to show the chart on.
    """
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    if mpl.get_backend().lower() in ("agg", "pdf", "svg", "ps", "cairo", "template"):
        raise IdentificationError(
            "no display to show the chart on: choose the poles in the browser (lamella open, room Identification), or "
            "edit the poles.txt that lamella ema wrote"
        )
    figure = plt.figure(figsize=(10.0, 6.0), layout="constrained")
    picker = PolePicker(diagram, stabilization_figure(diagram, figure))
    plt.show(block=True)
    return picker.chosen()


class PolePicker:
    """Clicks in a stabilisation chart turned into a choice of poles.

    Parameters
    ----------
    diagram : StabilizationDiagram
    figure : Figure
        Chart of the diagram.
    """

    def __init__(self, diagram: StabilizationDiagram, figure: Figure) -> None:
        self._pole, self._order = diagram.pole, diagram.order
        self._axes = figure.axes[0]
        self._chosen = [complex(p) for p in diagram.chosen]
        self._marks = self._axes.plot([], [], "v", color=palette.ACCENT, transform=self._axes.get_xaxis_transform())[0]
        self._draw()
        figure.canvas.mpl_connect("button_press_event", self._click)

    def chosen(self) -> Complexes:
        """Return the poles chosen so far, rad/s, ascending in frequency."""
        return np.array(sorted(self._chosen, key=abs), dtype=complex)

    def _click(self, event: Event) -> None:
        # The chart's background shares the place of its axes, so the event may name either.
        inside = self._axes.bbox.contains(event.x, event.y)  # type: ignore[attr-defined]
        button = event.button  # type: ignore[attr-defined]
        if not inside:
            return
        position = np.array([event.x, event.y])  # type: ignore[attr-defined]
        if button == LEFT and self._pole.size:
            points = np.stack([np.abs(self._pole) / (2.0 * np.pi), self._order], axis=1)
            pixels = self._axes.transData.transform(points)
            self._chosen.append(complex(self._pole[np.argmin(np.linalg.norm(pixels - position, axis=1))]))
        elif button == RIGHT and self._chosen:
            hertz = np.abs(self._chosen) / (2.0 * np.pi)
            pixels = self._axes.transData.transform(np.stack([hertz, np.zeros(hertz.size)], axis=1))
            del self._chosen[int(np.argmin(np.abs(pixels[:, 0] - position[0])))]
        self._draw()

    def _draw(self) -> None:
        self._marks.set_data(np.abs(self._chosen) / (2.0 * np.pi), np.full(len(self._chosen), 1.01))
        self._marks.set_clip_on(False)
        self._axes.figure.canvas.draw_idle()


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
    rest, line = modal_model.geometry.coordinate, modal_model.geometry.line_rows(modal_model.geometry.node)
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
