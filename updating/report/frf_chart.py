"""All functions of a configuration as one chart that shows one of them at a time."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.plot import palette
from ema.plot.figures import UNIT
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel
from updating.report.chart_part import axis, legend_above

_MOST_NUMBERS = 150_000
"""Functions times lines of a chart, about 1.5 MB of a page; of more, every second, third ... line is shown."""
BASE, FOUND, FITTED_MODEL = "base model", "with what was identified", "fitted model"
"""Names of models' curves: of two, and of one alone."""
CHANGED, REFERENCE = "changed", "reference"
"""Names of the curves of two states."""
_STYLE: dict[str, dict[str, Any]] = {
    "measured": {"line": {"color": palette.MEASURED, "width": 2.5}},
    "from the modes": {"line": {"color": palette.MODES, "width": 1.5}},
    FITTED_MODEL: {"line": {"color": palette.BASE, "width": 1.5, "dash": "dot"}},
    BASE: {"line": {"color": palette.BASE, "width": 1.5, "dash": "dot"}, "of": "base"},
    CHANGED: {"line": {"color": palette.MEASURED, "width": 2.5}},
    REFERENCE: {"line": {"color": palette.BASE, "width": 1.5}},
    FOUND: {"line": {"color": palette.FOUND, "width": 1.5, "dash": "dot"}, "of": "found"},
}
"""How curves are drawn; "of" says by which model of the page's switch a curve is shown."""


def frf_chart(
    measured: ModalModel, lines: FRF, curves: Mapping[str, NDArray[np.complex128]], order: Sequence[int]
) -> str:
    """Return all functions at the first input as the JSON that `charts.js` shows one of.

    Parameters
    ----------
    measured : ModalModel
        Whose frequencies are marked.
    lines : FRF
        The functions within the band.
    curves : mapping of str to (n_output, n_frequency) complex
        By name: measured, from the modes and, where there are any, those of models.
    order : sequence of int
        Outputs in the order of the list to choose from.
    """
    stride = -(-len(order) * lines.frequency.size // _MOST_NUMBERS)
    at = slice(None, None, stride)
    frequency = lines.frequency[at]
    functions = [
        {
            "curves": [{"size": _size(c[o, at]), "phase": _phase(c[o, at])} for c in curves.values()],
            **(
                {}
                if lines.coherence is None
                else {"coherence": _steps(lines.coherence[o, 0, at], 0.005, "u1")}
            ),
        }
        for o in order
    ]
    return json.dumps(
        {
            "lines": {
                "first": float(frequency[0]), "step": float(np.diff(frequency[:2])[0]), "n": int(frequency.size),
            },
            "functions": functions,
            "curves": [{"name": name, **_STYLE[name]} for name in curves],
            "left": {"name": "difference", "line": {"color": palette.LEFT, "width": 1}},
            "layout": _layout(measured, lines),
        },
        separators=(",", ":"),
    )  # fmt: skip


def _layout(measured: ModalModel, lines: FRF) -> dict[str, Any]:
    """Return the axes: magnitude, phase and, where it was stored, coherence."""
    domains = (
        [(0.36, 1.0), (0.0, 0.3)] if lines.coherence is None else [(0.46, 1.0), (0.2, 0.42), (0.0, 0.15)]
    )
    ends = [float(lines.frequency[0]), float(lines.frequency[-1])]
    mark = {
        "type": "line",
        "yref": "paper",
        "y0": 0,
        "y1": 1,
        "line": {"color": palette.ACCENT, "width": 1, "dash": "dash"},
    }
    layout = {
        "height": 460,
        "hovermode": "x unified",
        "xaxis": axis("frequency [Hz]", range=ends, anchor=f"y{len(domains)}"),
        "yaxis": axis(UNIT[lines.quantity], type="log", exponentformat="power", domain=domains[0]),
        "yaxis2": axis("phase [°]", range=[-190, 190], tickvals=[-180, 0, 180], domain=domains[1]),
        "legend": legend_above(),
        "margin": {"r": 12, "t": 66},
        "shapes": [{**mark, "x0": float(f), "x1": float(f)} for f in measured.frequency],
    }
    if lines.coherence is not None:
        layout["yaxis3"] = axis("coh. [1]", range=[0, 1.05], tickvals=[0, 1], domain=domains[-1])
    return layout


def _size(value: NDArray[np.complex128]) -> dict[str, Any]:
    """Pack magnitudes: their decimal logarithms in thousandths, a quarter of a percent."""
    size = np.abs(value)
    return _steps(np.log10(np.maximum(size, 1e-6 * size.max(initial=1e-30))), 1e-3, "i2")


def _phase(value: NDArray[np.complex128]) -> dict[str, Any]:
    return _steps(np.degrees(np.angle(value)), 0.1, "i2")


def _steps(value: NDArray[np.float64], step: float, dtype: str) -> dict[str, Any]:
    """Pack numbers as multiples of a step, in little-endian integers."""
    whole = np.round(value / step).astype(f"<{dtype}")
    return {"dtype": dtype, "step": step, "bdata": base64.b64encode(whole.tobytes()).decode()}
