"""Mode shapes that turn and move in the page, measured and modelled side by side and over each other."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.types.modal_model import frequency_text
from updating.fitting.fit import ModelFit
from updating.fitting.shape_faces import faces
from updating.fitting.shape_plot import AZIMUTH, ELEVATION, SWELL, ShapePair, shape_pair_figure, shape_pairs
from updating.report.modes_part import by_model
from updating.report.part import Gallery, Picture, Section, as_csv, png
from updating.report.results import Tested

_DIGITS = 1000  # displacements are drawn, so a thousandth of the largest is enough


def shape_section(tested: Tested) -> Section:
    """Show all measured shapes, each with its partner in the model."""
    title = f"Mode shapes of {tested.name}"
    if not np.isin(tested.measured.node, tested.measured.geometry.node).any():
        return Section(title=title, text=("None of the measured points has coordinates.",))
    if tested.fit is None:
        return Section(title=title, blocks=(gallery(tested, None),))
    return Section(title=title, blocks=by_model(tested, lambda fit: (gallery(tested, fit),)))


def gallery(tested: Tested, fit: ModelFit | None) -> Gallery:
    """Show all measured shapes of a configuration with their partners in a model."""
    return gallery_of(tested.name, shape_pairs(tested.measured, fit), None if fit is None else fit.box)


def gallery_of(
    name: str,
    pairs: Sequence[ShapePair],
    box: list[float] | None,
    names: tuple[str, str] = ("measured", "model"),
) -> Gallery:
    """Put shapes into the form that the page's `shapes.js` draws.

    Its JSON holds points (m) with their numbers, trace lines and the triangles between them (rows of points), the box
    of the body (m, or null), and for each pair what `shape_numbers` gives. `names` are those of a pair's shapes.
    """
    data = {
        "point": np.round(pairs[0].coordinate, 5).tolist(),
        "node": [str(n) for n in pairs[0].node],
        "line": pairs[0].line.tolist(),
        "face": faces(pairs[0].line).tolist(),
        "box": box,
        "view": [AZIMUTH, ELEVATION],
        "swell": SWELL,
        "names": names,
        "pair": [shape_numbers(pair) for pair in pairs],
    }
    return Gallery(
        shapes=json.dumps(data, separators=(",", ":")),
        title=tuple(_title(k, pair, names) for k, pair in enumerate(pairs, start=1)),
        paired=tuple(pair.has_model for pair in pairs),
        still=tuple(_still(name, k, pair, names) for k, pair in enumerate(pairs, start=1)),
        note="Drag the shape to turn it, or use the arrow keys; a point says its number and how far it moves. "
        + (f"Red lines are {names[1]}, scaled to fit. " if names[1] != "model" else "")
        + ("" if box is None else "The body is measured, red lines are the model, scaled to fit. ")
        + "Only the directions that were measured are drawn.",
    )


def shape_numbers(pair: ShapePair) -> dict[str, Any]:
    """Return displacements in thousandths of the largest: real and imaginary parts measured, and the model's."""
    return {
        "measured": [_whole(pair.measured.real), _whole(pair.measured.imag)],
        "model": _whole(pair.model) if pair.has_model else None,
    }


def _whole(displacement: NDArray[np.float64]) -> list[int]:
    return [int(v) for v in np.round(_DIGITS * displacement.ravel())]


def _title(number: int, pair: ShapePair, names: tuple[str, str] = ("measured", "model")) -> str:
    measured, model = (frequency_text(f, 1) for f in (pair.measured_frequency, pair.model_frequency))
    if not pair.has_model:
        return f"Mode {number}: {names[0]} {measured} Hz"
    return f"Mode {number}: {names[0]} {measured} Hz, {names[1]} {model} Hz, MAC {pair.mac:.4f}"


def _still(name: str, number: int, pair: ShapePair, names: tuple[str, str]) -> Picture:
    columns = (pair.coordinate, pair.measured.real, pair.measured.imag, pair.model)
    parts = ("", f"{names[0]} real ", f"{names[0]} imaginary ", f"{names[1]} ")
    return Picture(
        name=f"shape_{name}_{number:02d}",
        content=png(shape_pair_figure(pair, names)),
        form="png",
        data=as_csv(
            [f"{n}{axis} [{'m' if not n else 'over the largest'}]" for n in parts for axis in "xyz"],
            np.hstack(columns),
        ),
        alt=_title(number, pair, names),
        caption="",
    )
