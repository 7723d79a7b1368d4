"""Pictures of mode shapes, drawn off-screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.modes.modes import Modes
from model.modes.surface import Surface, mode_surface
from model.reduction.reduction import ReducedSystem

if TYPE_CHECKING:
    import pyvista

Vector = NDArray[np.float64]

_SWELL = 0.08  # largest drawn displacement, as a share of the stack's length
_SHEETS = 9  # laminas whose edges are drawn


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

    stack = system.stack
    lamina = np.unique(np.linspace(0, stack.n_lamina - 1, _SHEETS).round().astype(int))
    surface = mode_surface(system, modes, mode, lamina=lamina.tolist())
    length = np.linalg.norm(surface.displacement, axis=-1)
    scale = _SWELL * stack.length / length.max()
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


def _add_surface(plotter: Any, surface: Surface, moved: Vector, length: Vector) -> None:
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
            side,
            scalars="displacement",
            clim=(0.0, float(length.max())),
            cmap="viridis",
            show_scalar_bar=False,
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
