"""What the room of the identification draws and computes: the stabilisation chart, chosen poles, and their shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.identification.doubtful_modes import dropped_columns, stability
from ema.identification.maximum_likelihood import linear_fit
from ema.identification.stabilization import stabilization
from ema.modal.mac import mac
from ema.plot import palette
from ema.plot.figures import UNIT
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel, frequency_text
from updating.fitting.shape_plot import lone_shape
from updating.report.chart_part import axis, chart, legend_above, single
from updating.report.modes_part import mac_chart
from updating.report.results import Tested
from updating.report.shape_part import shape_numbers
from updating.report.stabilization_part import stabilization_chart
from updating.results.text import Z95

_SAME = 2e-3  # relative distance of frequencies within which a click is on a pole that is taken already


def diagram_chart(tested: Tested, lines: FRF, order: int) -> str:
    """Draw the stabilisation chart of a band."""
    diagram = stabilization(lines, order=order)
    measured = tested.measured
    return stabilization_chart(
        diagram, stability(diagram, lines), dropped_columns(diagram, lines, measured), measured
    )


def toggled(pole: NDArray[np.complex128], hertz: float, percent: float) -> NDArray[np.complex128]:
    """Return chosen poles (rad/s) with one more, or without the one that is there already."""
    new = pole_of(hertz, percent)
    near = _near(pole, new)
    return pole[~near] if near.any() else np.array(sorted([*pole, new], key=abs))


def pole_of(hertz: float, percent: float) -> complex:
    """Return the pole (rad/s) of a natural frequency (Hz) and a damping ratio (%)."""
    damping = percent / 100.0
    return complex(2.0 * np.pi * hertz * complex(-damping, np.sqrt(1.0 - damping**2)))


def _near(pole: NDArray[np.complex128], new: complex) -> NDArray[np.bool_]:
    return np.abs(np.abs(pole) / abs(new) - 1.0) < _SAME


def fitted_charts(lines: FRF, pole: NDArray[np.complex128], point: int) -> tuple[str, str]:
    """Draw the first function of a point with what the poles make of it, and the MAC of their shapes with each other.

    Residues are fitted at these poles to all functions at the first input (LSFD), as the identification begins.
    """
    value = lines.value[:, 0]
    fit = linear_fit(lines.frequency, value, pole, lines.quantity)
    o = int(np.flatnonzero(lines.output.node == point)[0]) if np.any(lines.output.node == point) else 0
    curves = (
        ("difference", np.abs(fit.residual[o]), {"color": palette.LEFT, "width": 1}),
        ("measured", np.abs(value[o]), {"color": palette.MEASURED, "width": 2.5}),
        ("from the chosen poles", np.abs(value[o] - fit.residual[o]), {"color": palette.MODES, "width": 1.5}),
    )
    traces = [
        {"type": "scatter", "x": single(lines.frequency), "y": single(y), "name": name, "line": style}
        for name, y, style in curves
    ]
    layout = {
        "xaxis": axis("frequency [Hz]"),
        "yaxis": axis(
            f"{lines.output.name(o)} over {lines.input.name(0)} [{UNIT[lines.quantity]}]",
            type="log",
            exponentformat="power",
        ),
        "hovermode": "x unified",
        "legend": legend_above(),
        "margin": {"r": 8, "t": 30},
    }
    frequency = np.abs(pole) / (2.0 * np.pi)
    likeness = mac(fit.residue, fit.residue)
    return chart(traces, layout), mac_chart(likeness, frequency, frequency, "chosen", "chosen")


def shape_of(tested: Tested, lines: FRF, pole: NDArray[np.complex128], own: complex) -> dict[str, Any]:
    """Return the shape that a pole has beside the chosen ones, as the page of moving shapes takes it."""
    others = pole[~_near(pole, own)]
    fit = linear_fit(lines.frequency, lines.value[:, 0], np.array([*others, own]), lines.quantity)
    hertz = abs(own) / (2.0 * np.pi)
    return shape_numbers(lone_shape(tested.measured.geometry, lines.output, fit.residue[:, -1], hertz))


def runs_chart(measured: ModalModel) -> str:
    """Draw how far the frequency of each mode is in each run from its mean over the runs, with 95 % intervals."""
    hertz = np.abs(measured.run_pole) / (2.0 * np.pi)
    mean = hertz.mean(axis=0)
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": f"{r + 1}: {frequency_text(mean[r], 1)} Hz",
            "x": (measured.run + 1).tolist(), "y": single(100.0 * (hertz[:, r] / mean[r] - 1.0)), "marker": {"size": 5},
            "error_y": {
                "type": "data", "array": single(100.0 * Z95 * measured.run_frequency_std[:, r] / mean[r]),
                "thickness": 1, "width": 2,
            },
        }
        for r in range(mean.size)
    ]  # fmt: skip
    return chart(
        traces,
        {
            "xaxis": axis("run"),
            "yaxis": axis("frequency off the mean of the runs [%]", zeroline=True),
            "legend": {"orientation": "v"},
            "margin": {"r": 8, "t": 30},
        },
    )
