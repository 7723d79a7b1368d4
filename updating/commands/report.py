"""The commands that show results: the report, shapes of one configuration, the workbench.

What draws and serves is imported once there is something to show: it takes most of a second to load.
"""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.plot import palette
from ema.types.modal_model import frequency_text
from ema.types.threads import single_threaded
from updating.commands.terminal import OUT
from updating.errors import StoreError
from updating.report.results import Tested, read_results
from updating.results.identified import forget_choices
from updating.results.store import write_bytes

if TYPE_CHECKING:
    import pyvista

    from updating.fitting.plots import ShapePair


@single_threaded
def report_command(
    folder: Path, *, pdf: bool, pptx: bool, gif: bool, only: Sequence[str], keep: bool
) -> None:
    """Make the report of a folder in the forms that are asked for, and say where they are."""
    with OUT.status("drawing"):
        from updating.report.files import find_browser, print_pdf, write_gifs, write_slides
        from updating.report.identified_model import with_models

        page = make_report(folder, keep=keep, only=only)
    results = with_models(read_results(folder, keep=keep))
    for sentence in results.remarks:
        OUT.print(sentence, highlight=False)
    OUT.print(f"Report: {page}")
    if pdf:
        OUT.print(f"PDF: {print_pdf(page)}, printed by {find_browser()}", soft_wrap=True)
    if pptx:
        OUT.print(f"Slides: {write_slides(results)}")
    if gif:
        OUT.print(f"{len(write_gifs(results))} moving shapes: {folder / 'figures'}")


def make_report(folder: Path, *, keep: bool = False, only: Sequence[str] = ()) -> Path:
    """Make the page of a results folder, its configurations in parallel; the rest as in `write_report`."""
    from updating.report.page import write_report
    from updating.workers.workers import workers

    with workers(len(list(folder.glob("*/modal_model.json")))) as executor:
        return write_report(folder, executor, keep=keep, only=only)


_STEPS = 48  # of one period

_PAUSE = 40  # ms between them

_PANELS = (("measured",), ("model",), ("measured", "model"))

_LINE = {"measured": (5, palette.MEASURED), "model": (2, palette.ACCENT)}


@single_threaded
def view_command(folder: Path, configuration: str | None) -> None:
    """Show one configuration, and say where the page is if there is no window."""
    page = show(folder, configuration)
    if page is not None:
        OUT.print(f"No display for a window; page: {page}")


def show(folder: Path, configuration: str | None) -> Path | None:
    """Show mode shapes and stabilisation chart of a configuration, by default the first.

    Parameters
    ----------
    folder : Path
        Results.
    configuration : str, optional
        Name of the configuration.

    Returns
    -------
    Path or None
        The page that was opened in the browser, or None where a window was shown and closed.

    Raises
    ------
    StoreError
        The folder holds no result of that name.
    """
    results = read_results(folder)
    names = [t.name for t in results.tested]
    if not names:
        raise StoreError(
            f"{folder}: a table of modes has no shapes to view; make its page with: lamella report {folder}"
        )
    if configuration is not None and configuration not in names:
        raise StoreError(f"{folder}: no configuration {configuration!r}; there are {', '.join(names)}")
    tested = results.tested[0 if configuration is None else names.index(configuration)]
    if has_display():
        window(tested).show()
        return None
    from updating.report.frf_part import frf_section
    from updating.report.modes_part import shape_section
    from updating.report.page import render

    page = folder / "view.html"
    parts = (shape_section(tested), frf_section(tested))
    write_bytes(page, render(f"{results.name}: {tested.name}", parts).encode())
    webbrowser.open(page.resolve().as_uri())
    return page


def has_display() -> bool:
    """Whether a window can be shown."""
    return sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )


def window(tested: Tested, *, off_screen: bool = False) -> pyvista.Plotter:
    """Put moving shapes, measured, modelled and both, above the stabilisation chart, with a slider for the mode.

    Returns
    -------
    pyvista.Plotter
        Not yet shown; the caller shows or closes it.
    """
    import pyvista as pv

    from updating.fitting.plots import shape_pairs

    pairs = shape_pairs(tested.measured, tested.fit)
    with pv.vtk_verbosity("off"):  # VTK warns when there is no display, though it then renders without one
        plotter: Any = pv.Plotter(
            shape=(2, 3),
            groups=[(1, slice(None))],
            off_screen=off_screen,
            window_size=[1400, 900],
            border=False,
            title=f"Lamella: {tested.name}",
        )
    shapes = _Shapes(plotter, pairs)
    plotter.subplot(1, 0)
    if tested.has_functions:
        from ema.identification.stabilization import stabilization
        from ema.plot.figures import stabilization_figure

        figure = stabilization_figure(stabilization(tested.frf().band(*tested.measured.band)))
        plotter.add_chart(pv.ChartMPL(figure))
    else:
        plotter.add_text(f"No stabilisation chart: {tested.no_functions}.", font_size=10)
    plotter.subplot(0, 0)
    plotter.link_views([0, 1, 2])
    shapes.choose(1.0)
    if len(pairs) > 1:
        plotter.subplot(0, 0)
        plotter.add_slider_widget(
            shapes.choose, [1, len(pairs)], value=1, title="mode", fmt="%.0f", color=palette.INK,
            pointa=(0.05, 0.12), pointb=(0.6, 0.12), title_height=0.03,
        )  # fmt: skip
    if not off_screen:
        plotter.add_timer_event(max_steps=10**9, duration=_PAUSE, callback=shapes.step)
    return plotter


class _Shapes:
    """What moves in the window: the meshes of the panels, which mode they show, and where in its period it is."""

    def __init__(self, plotter: Any, pairs: tuple[ShapePair, ...]) -> None:
        import pyvista as pv

        from updating.fitting.plots import SWELL

        self.plotter, self.pairs, self.mode, self.time = plotter, pairs, 0, 0
        self.rest = pairs[0].coordinate
        self.swell = SWELL * float(np.max(np.ptp(self.rest, axis=0)))
        line = pairs[0].line
        cells = np.column_stack([np.full(len(line), 2), line]).ravel()

        def wire(points: NDArray[np.float64]) -> Any:
            return pv.PolyData(points, lines=cells) if cells.size else pv.PolyData(points)

        self.meshes: list[tuple[str, Any]] = []
        for column, parts in enumerate(_PANELS):
            plotter.subplot(0, column)
            plotter.set_background("white")
            plotter.add_mesh(wire(self.rest.copy()), color=palette.PALE, line_width=1)
            for what in parts:
                mesh = wire(self.rest.copy())
                self.meshes.append((what, mesh))
                width, color = _LINE[what]
                # the wide line must not hide the thin one that lies on it
                style = {
                    "color": color,
                    "lighting": False,
                    "opacity": 0.5 if what == "measured" and len(parts) > 1 else 1.0,
                }
                plotter.add_mesh(mesh, line_width=width, **style)
                plotter.add_points(mesh, point_size=2 * width, **style)
            plotter.camera_position = "iso"
            plotter.camera.azimuth = 25.0

    def choose(self, number: float) -> None:
        """Show a mode, counted from 1."""
        self.mode = round(number) - 1
        pair = self.pairs[self.mode]
        texts = [f"measured {frequency_text(pair.measured_frequency, 1)} Hz", "no partner in the model", ""]
        if pair.has_model:
            texts[1:] = [f"model {frequency_text(pair.model_frequency, 1)} Hz", f"both, MAC {pair.mac:.4f}"]
        for column, text in enumerate(texts):
            self.plotter.subplot(0, column)
            self.plotter.add_text(text, name=f"title {column}", font_size=11, color=palette.INK)
        self.move()

    def step(self, _: int) -> None:
        """Go on by a part of the period."""
        self.time += 1
        self.move()

    def move(self) -> None:
        """Bring all meshes to where they are at this time."""
        pair, turn = self.pairs[self.mode], np.exp(2j * np.pi * self.time / _STEPS)
        for what, mesh in self.meshes:
            mesh.points = self.rest + self.swell * (getattr(pair, what) * turn).real
        self.plotter.render()


@single_threaded
def open_command(path: Path, output: Path | None, port: int, *, browser: bool, identify_anew: bool) -> None:
    """Serve the workbench of a folder, a campaign or its results until Ctrl-C."""

    def make(campaign: Path, folder: Path) -> None:
        from updating.commands.fit import fit_campaign
        from updating.correlation.pairing import LEAST_MAC

        for _ in fit_campaign(campaign, folder, LEAST_MAC, OUT):
            pass

    def ready(address: str) -> None:
        OUT.print(f"Workbench: {address}", soft_wrap=True)
        OUT.print("It shows what others must not see to whoever has this address. Ctrl-C ends it.")

    from updating.workbench.opened import find

    opened = find(path, output, make)
    from updating.workbench.server import serve  # with all of its panels, once there is something to show

    if identify_anew:
        forget_choices(opened.folder)
        make(opened.campaign, opened.folder)
    serve(opened, port=port, ready=ready, show=browser)
