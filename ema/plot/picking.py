"""Choosing poles by clicks in the stabilisation chart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema.identification.stabilization import StabilizationDiagram
from ema.plot import palette
from ema.plot.figures import stabilization_figure
from ema.types.errors import IdentificationError

if TYPE_CHECKING:
    from matplotlib.backend_bases import Event
    from matplotlib.figure import Figure

LEFT, RIGHT = 1, 3


def pick_poles(diagram: StabilizationDiagram) -> NDArray[np.complex128]:
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
        message = (
            "no display to show the chart on: choose the poles in the browser (lamella open, room Identification), or "
            "edit the poles.txt that lamella ema wrote"
        )
        raise IdentificationError(message)
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
        self._marks = self._axes.plot(
            [], [], "v", color=palette.ACCENT, transform=self._axes.get_xaxis_transform()
        )[0]
        self._draw()
        figure.canvas.mpl_connect("button_press_event", self._click)

    def chosen(self) -> NDArray[np.complex128]:
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
