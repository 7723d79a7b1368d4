"""Mode shapes that move, as GIF files: what a slide or a message can hold."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from updating.fitting.shape_plot import ShapePair, shape_pair_figure, shape_pairs
from updating.report.results import Results
from updating.results.store import folder_name, write_bytes

_STEPS = 16  # pictures of one period
_PAUSE = 60  # ms between them
_DPI = 140
_COLOURS = 32


def write_gifs(results: Results) -> tuple[Path, ...]:
    """Write one period of every mode shape, measured, modelled and both, to `figures` and return the files.

    Raises
    ------
    StoreError
        The folder cannot be written to.
    """
    paths = []
    for tested in results.tested:
        for number, pair in enumerate(shape_pairs(tested.measured, tested.shown), start=1):
            name = folder_name(f"shape_{tested.name}_{number:02d}")
            paths.append(results.folder / "figures" / f"{name}.gif")
            write_bytes(paths[-1], shape_gif(pair))
    return tuple(paths)


def shape_gif(pair: ShapePair) -> bytes:
    """Draw one period of a shape as a GIF that goes round for ever."""
    from PIL import Image

    pictures = []
    for phase in 2.0 * np.pi * np.arange(_STEPS) / _STEPS:
        moved = replace(
            pair,
            measured=(pair.measured * np.exp(1j * phase)).real.astype(complex),
            model=pair.model * np.cos(phase),
        )
        drawn = io.BytesIO()
        shape_pair_figure(moved).savefig(drawn, format="png", dpi=_DPI)
        pictures.append(Image.open(drawn).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE))
    out = io.BytesIO()
    pictures[0].save(
        out, format="gif", save_all=True, append_images=pictures[1:], duration=_PAUSE, loop=0, disposal=1
    )
    return out.getvalue()
