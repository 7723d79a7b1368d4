"""Choosing poles by hand: in a text file that can be edited, or by clicks in the stabilisation chart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema.errors import IdentificationError
from ema.files import whole
from ema.plot import stabilization_figure
from ema.stabilization import StabilizationDiagram

if TYPE_CHECKING:
    from matplotlib.backend_bases import Event
    from matplotlib.figure import Figure

HEADER = (
    "# Poles, one a line: natural frequency in Hz and damping ratio (0.01 is 1 %).\n"
    "# Add and take away lines and give the file back to the identification.\n"
)
LEFT, RIGHT = 1, 3


def write_poles(path: Path, pole: NDArray[np.complex128]) -> None:
    """Write poles (rad/s) to a text file of natural frequencies and damping ratios."""
    lines = [f"{abs(p) / (2.0 * np.pi):.10g}  {-p.real / abs(p):.6g}\n" for p in pole]
    with whole(path, IdentificationError) as part:
        part.write_text(HEADER + "".join(lines), encoding="utf-8")


def read_poles(path: Path) -> NDArray[np.complex128]:
    """Read poles (rad/s) from a text file of natural frequencies (Hz) and damping ratios, a pole a line.

    Raises
    ------
    IdentificationError
        The file cannot be read or holds no pole, or a line does not hold two numbers in range; the message names file
        and line.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        message = f"{path}: cannot be read: {error}"
        raise IdentificationError(message) from error
    found: list[complex] = []
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        try:
            frequency, damping = (float(w) for w in words)
        except ValueError:
            message = (
                f"{path}, line {number}: expected a frequency in Hz and a damping ratio, got {line.strip()!r}"
            )
            raise IdentificationError(message) from None
        if not (frequency > 0.0 and 0.0 < damping < 1.0):
            message = (
                f"{path}, line {number}: frequency must be above 0 Hz and the damping ratio between 0 and 1 "
                f"(0.01 is 1 %), got {frequency:g} and {damping:g}"
            )
            raise IdentificationError(message)
        found.append(2.0 * np.pi * frequency * complex(-damping, np.sqrt(1.0 - damping**2)))
    if not found:
        message = f"{path}: holds no pole; give one a line, as frequency in Hz and damping ratio"
        raise IdentificationError(message)
    return np.array(sorted(found, key=abs))


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
            "no display to show the chart on: write the poles to a text file with write_poles, edit it and read "
            "it back with read_poles"
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
            [], [], "v", color="#b3341f", transform=self._axes.get_xaxis_transform()
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
