"""Figures draw what the model holds, without a display and without leaving state in pyplot.

Poles chosen by hand: file there and back, clicks in the chart, and what the identification makes of them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backend_bases import MouseButton, MouseEvent
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ema.identification.exchange import read_poles, write_poles
from ema.identification.identify import identify_frf
from ema.identification.stabilization import StabilizationDiagram, stabilization
from ema.plot.figures import (
    PolePicker,
    chosen_functions,
    overlay_figure,
    pick_poles,
    shape_figure,
    stabilization_figure,
)
from ema.types.errors import IdentificationError
from ema.types.frf import FRF, Dofs, Geometry
from ema.types.modal_model import ModalModel


@pytest.fixture(scope="module")
def beam() -> tuple[FRF, ModalModel]:
    f = np.arange(1.0, 401.0)
    pole = 2 * np.pi * np.array([60.0, 200.0]) * (-0.02 + 1j)
    phi = np.array([[1.0, 1.0], [0.3, -0.8], [-0.9, 0.7]])
    s = 2j * np.pi * f
    residue = phi * phi[0] / (2j * pole.imag)
    value = s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))
    z = np.tile([0.0, 0.0, 1.0], (3, 1))
    frf = FRF(
        frequency=f,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=[1, 2, 3], direction=z),
        input=Dofs(node=[1], direction=z[:1]),
        run=[0, 0, 0],
        source=("generated",) * 3,
    )
    geometry = Geometry(
        node=[1, 2, 3, 4], coordinate=np.outer(range(4), [0.2, 0.0, 0.0]), line=[[1, 2], [2, 3], [3, 4]]
    )
    return frf, identify_frf(frf, geometry, name="beam", order=20)


def test_functions_are_shown_with_those_of_the_modes_and_every_pole(beam: tuple[FRF, ModalModel]) -> None:
    frf, model = beam
    figure = overlay_figure(frf, model)
    magnitude, worst = figure.axes[0], chosen_functions(model)[0]
    _, measured, fitted, *marks = magnitude.lines
    np.testing.assert_allclose(measured.get_ydata(), np.abs(frf.value[worst, 0]))
    np.testing.assert_allclose(fitted.get_ydata(), np.abs(frf.value[worst, 0]), rtol=1e-6)
    assert [m.get_xdata()[0] for m in marks] == pytest.approx(model.frequency)
    figure.canvas.draw()


def test_stabilization_figure_fills_the_clusters(beam: tuple[FRF, ModalModel]) -> None:
    diagram = stabilization(beam[0], order=20)
    axes = stabilization_figure(diagram).axes[0]
    loose, clustered = axes.lines[:2]
    assert len(clustered.get_xdata()) == np.count_nonzero(diagram.stable)
    assert len(loose.get_xdata()) == np.count_nonzero(~diagram.stable)


def test_shape_figure_moves_measured_points_only(beam: tuple[FRF, ModalModel]) -> None:
    axes = shape_figure(beam[1], 0).axes[0]
    rest, moved = (np.array(c._offsets3d) for c in axes.collections)
    height = moved[2] - rest[2]
    np.testing.assert_allclose(height[:3] / height[0], [1.0, 0.3, -0.9], atol=1e-3)
    assert height[3] == 0.0


def test_long_functions_keep_their_peaks() -> None:
    from ema.plot.figures import _thinned

    magnitude = np.ones(100_000)
    magnitude[54_321] = 7.0
    assert 54_321 in _thinned(magnitude)


def test_plot_module_does_not_import_matplotlib_by_itself() -> None:
    import subprocess

    code = "import sys, ema.plot; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


POLE = 2 * np.pi * np.array([60.0, 200.0]) * (-0.02 + 1j)
DIAGRAM = StabilizationDiagram(
    order=[10, 10, 20],
    pole=[POLE[0], POLE[1], 2 * np.pi * 120.0 * (-0.05 + 1j)],
    cluster=[0, -1, -1],
    chosen=POLE[:1],
    frequency=np.arange(1.0, 400.0),
    indicator=np.ones((1, 399)),
)


def test_file_gives_the_poles_back(tmp_path: Path) -> None:
    write_poles(tmp_path / "poles.txt", POLE)
    np.testing.assert_allclose(read_poles(tmp_path / "poles.txt"), POLE, rtol=1e-5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("100 0.01\n200\n", r"poles.txt, line 2: expected a frequency .* got '200'"),
        ("# a comment\n100 1.5\n", r"line 2: .*damping ratio between 0 and 1 .* 1.5"),
        ("# nothing\n", "holds no pole"),
        ("100 Hz\n", "line 1: expected"),
    ],
)
def test_a_broken_file_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "poles.txt"
    path.write_text(text)
    with pytest.raises(IdentificationError, match=message):
        read_poles(path)


def test_clicks_add_and_take_away() -> None:
    figure = stabilization_figure(DIAGRAM)
    canvas = FigureCanvasAgg(figure)
    picker = PolePicker(DIAGRAM, figure)
    canvas.draw()

    def click(hertz: float, order: float, button: MouseButton) -> None:
        x, y = figure.axes[0].transData.transform((hertz, order))
        canvas.callbacks.process("button_press_event", MouseEvent("button_press_event", canvas, x, y, button))

    click(205.0, 11.0, MouseButton.LEFT)
    np.testing.assert_allclose(picker.chosen(), POLE)
    click(58.0, 15.0, MouseButton.RIGHT)
    np.testing.assert_allclose(picker.chosen(), POLE[1:])
    click(-500.0, 15.0, MouseButton.RIGHT)
    np.testing.assert_allclose(picker.chosen(), POLE[1:])


def test_without_a_display_the_file_is_recommended() -> None:
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.use("agg")
        with pytest.raises(IdentificationError, match=r"edit the poles\.txt"):
            pick_poles(DIAGRAM)


def test_chosen_poles_are_refined_and_none_is_added() -> None:
    f = np.arange(1.0, 401.0, 0.5)
    s = 2j * np.pi * f
    residue = np.array([[1.0, 1.0], [0.3, -0.8]]) / (2j * POLE.imag)
    value = s**2 * (residue @ (1 / (s - POLE[:, None])) + residue.conj() @ (1 / (s - POLE.conj()[:, None])))
    z = np.tile([0.0, 0.0, 1.0], (2, 1))
    frf = FRF(
        frequency=f,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=[1, 2], direction=z),
        input=Dofs(node=[1], direction=z[:1]),
        run=[0, 0],
        source=("generated",) * 2,
    )
    geometry = Geometry(node=[1, 2], coordinate=np.eye(2, 3), line=np.zeros((0, 2)))
    both = identify_frf(frf, geometry, name="by hand", pole=POLE * 1.002)
    np.testing.assert_allclose(both.pole, POLE, rtol=1e-6)
    one = identify_frf(frf, geometry, name="by hand", pole=POLE[:1])
    assert one.frequency.size == 1
    with pytest.raises(IdentificationError, match=r"60\.0\d* Hz are not within 100-400 Hz"):
        identify_frf(frf, geometry, name="by hand", pole=POLE, band=(100.0, 400.0))
