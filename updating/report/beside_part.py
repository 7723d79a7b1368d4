"""A changed state beside its reference: functions over each other, and every shape beside that of the same mode."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema import Change
from ema.plot import palette
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel
from updating.correlation.frf_plot import within_band
from updating.fitting.shape_plot import ShapePair, beside_shape
from updating.report.chart_part import axis, chart, legend_above, single
from updating.report.frf_chart import CHANGED, REFERENCE, frf_chart
from updating.report.part import Gallery, Picture, Section, as_csv, png
from updating.report.results import Tested
from updating.report.shape_part import gallery_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Vector = NDArray[np.float64]


def beside_section(tested: Tested, found: Change, reference: Tested) -> Section:
    """Show functions and shapes of a state over those of its reference.

    Parameters
    ----------
    tested : Tested
        The state.
    found : Change
        What differs, and which modes are the same.
    reference : Tested
        The first configuration of its reference.
    """
    title = f"{tested.name} beside {reference.name}"
    if not same_points(tested.measured, reference.measured):
        return Section(
            title=title, text=("They were measured at other points: shapes are not laid over each other.",)
        )
    functions = functions_picture(tested, reference)
    shapes = shapes_beside(tested, found, reference)
    return Section(title=title, blocks=tuple(own for own in (functions, shapes) if own is not None))


def same_points(one: ModalModel, other: ModalModel) -> bool:
    """Tell whether two states were measured at the same points in the same directions, in one order."""
    return np.array_equal(one.node, other.node) and np.allclose(one.direction, other.direction)


def shape_pairs_beside(measured: ModalModel, found: Change, reference: ModalModel) -> tuple[ShapePair, ...]:
    """Return the shape of every mode that both states have, with that of the reference."""
    return tuple(
        beside_shape(
            measured,
            int(r),
            (float(reference.frequency[q]), float(found.mac[k]), reference.shape[:, int(q)].real),
        )
        for k, (r, q) in enumerate(zip(found.mode, found.reference_mode, strict=True))
    )


def shapes_beside(tested: Tested, found: Change, reference: Tested) -> Gallery | None:
    """Return the shapes that turn and move; None without a mode that both have, or without coordinates."""
    measured = tested.measured
    if not found.mode.size or not np.isin(measured.node, measured.geometry.node).any():
        return None
    pairs = shape_pairs_beside(measured, found, reference.measured)
    return gallery_of(f"{tested.name}_beside", pairs, None, names=(tested.name, reference.name))


def common_lines(tested: Tested, reference: Tested) -> tuple[FRF, NDArray[np.complex128]] | None:
    """Return the functions of a state within its band and the reference's there; None where lines differ."""
    if not (tested.has_functions and reference.has_functions):
        return None
    own, other = (within_band(one.frf(), tested.measured) for one in (tested, reference))
    if own.frequency.shape != other.frequency.shape or not np.allclose(own.frequency, other.frequency):
        return None
    if own.value.shape != other.value.shape or not np.array_equal(own.output.node, other.output.node):
        return None
    return own, other.value[:, 0]


def functions_picture(tested: Tested, reference: Tested) -> Picture | None:
    """Draw every function of both states; None where they have not the same lines."""
    common = common_lines(tested, reference)
    if common is None:
        return None
    lines, before = common
    curves = {CHANGED: lines.value[:, 0], REFERENCE: before}
    order = range(lines.output.node.size)
    size = np.abs(np.array(list(curves.values())))
    mean = np.sqrt(np.mean(size**2, axis=1))
    return Picture(
        name=f"beside_{tested.name}",
        content=png(_figure(lines.frequency, mean, (tested.name, reference.name))),
        form="png",
        data=as_csv(
            ("frequency [Hz]", tested.name, reference.name), zip(lines.frequency, *mean, strict=True)
        ),
        alt=f"Functions of {tested.name} over those of {reference.name}",
        caption=f"Functions of {tested.name} (changed) over those of {reference.name} (reference), each by itself; a "
        "print shows the root mean square of all.",
        chart=frf_chart(tested.measured, lines, curves, list(order)),
        choices=tuple(f"{lines.output.name(o)} over {lines.input.name(0)}" for o in order),
    )


def mean_chart(tested: Tested, reference: Tested) -> str | None:
    """Return the root mean square of all functions of both states as a chart; None where lines differ."""
    common = common_lines(tested, reference)
    if common is None:
        return None
    lines, before = common
    mean = [np.sqrt(np.mean(np.abs(own) ** 2, axis=0)) for own in (lines.value[:, 0], before)]
    traces = [
        {
            "type": "scatter", "mode": "lines", "name": name, "x": single(lines.frequency), "y": single(value),
            "line": {"color": color},
        }
        for name, value, color in zip(
            (tested.name, reference.name), mean, (palette.MEASURED, palette.BASE), strict=True
        )
    ]  # fmt: skip
    return chart(
        traces,
        {
            "xaxis": axis("frequency [Hz]"),
            "yaxis": axis("root mean square of all functions", type="log", exponentformat="power"),
            "legend": legend_above(),
            "margin": {"r": 8, "t": 30},
        },
    )


def _figure(frequency: Vector, mean: Vector, names: tuple[str, str]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    axes = figure.subplots()
    for line, name, color in zip(mean, names, (palette.MEASURED, palette.BASE), strict=True):
        axes.semilogy(frequency, line, label=name, color=color)
    axes.set(xlabel="frequency [Hz]", ylabel="root mean square of all functions [SI]")
    axes.legend(frameon=False)
    return figure
