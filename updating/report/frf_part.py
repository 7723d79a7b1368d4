"""What was identified and how well: every measured function with the modes over it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.types.frf import FRF
from ema.types.geometry import Dofs
from ema.types.modal_model import ModalModel
from updating.correlation.frf_plot import chosen_functions, overlay_figure, synthesized
from updating.errors import PairingError
from updating.fitting.fitted_frf import fitted_frf
from updating.report.frf_chart import frf_chart
from updating.report.part import Picture, Section, as_csv, png
from updating.report.results import Tested
from updating.report.stabilization_part import stabilization_blocks


def frf_section(tested: Tested) -> Section:
    """Show functions with the synthesised ones over them and the stabilisation chart."""
    if not tested.has_functions:
        return Section(title=frf_title(tested), text=(f"None: {tested.no_functions}.",))
    m, frf = tested.measured, tested.frf()
    n_function = m.node.size * m.input.node.size
    text = (
        f"{m.frequency.size} modes between {m.band[0]:g} and {m.band[1]:g} Hz from {n_function} FRFs, without a "
        f"frequency guess. Measured functions and those of the modes correlate (FRAC) by {m.correlation.min():.5f} "
        f"to {m.correlation.max():.5f}, {np.median(m.correlation):.5f} in the middle.",
    )
    return Section(
        title=frf_title(tested),
        text=text,
        blocks=(frf_picture(tested, frf), *stabilization_blocks(tested, frf)),
    )


def frf_picture(tested: Tested, frf: FRF) -> Picture:
    """Draw the functions that the identified modes meet worst, in the middle and best; the chart shows any of them."""
    lines, fitted = synthesized(frf, tested.measured)
    chosen = chosen_functions(tested.measured)
    model = _modelled(tested, lines)
    columns, names = [lines.frequency], ["frequency [Hz]"]
    for o in chosen:
        name = f"{lines.output.name(o)}/{lines.input.name(0)}"
        shown = [("measured", lines.value[o, 0]), ("from the modes", fitted[o, 0])]
        if model is not None:
            shown.append(("fitted model", model[o]))
        for what, value in shown:
            columns += [value.real, value.imag]
            names += [f"{name} {what} {part} [SI {lines.quantity}]" for part in ("real", "imaginary")]
        if lines.coherence is not None:
            columns.append(lines.coherence[o, 0])
            names.append(f"{name} coherence")
    curves = [lines.value[:, 0], fitted[:, 0], *([] if model is None else [model])]
    functions = frf_functions(tested.measured, lines)
    return Picture(
        name=f"frf_{tested.name}",
        content=png(overlay_figure(frf, tested.measured, None if model is None else model[list(chosen)])),
        form="png",
        data=as_csv(names, zip(*columns, strict=True)),
        alt="Measured and synthesised FRFs",
        caption="Every function; the first ones are those that the identified modes meet worst, in the middle and best "
        "(a print shows these). Dashed: natural frequencies. The difference is what the modes leave; where it is as "
        "large as the function, noise governs."
        + (
            ""
            if model is None
            else " Dotted: the fitted model, which knows of the functions only what their modes say."
        )
        + ("" if lines.coherence is not None else " The test system stored no coherence."),
        chart=frf_chart(tested.measured, lines, curves, [o for o, _ in functions]),
        choices=tuple(name for _, name in functions),
    )


def frf_title(tested: Tested) -> str:
    """Return the heading above the functions of a configuration."""
    return f"FRFs of {tested.name}"


def frf_functions(measured: ModalModel, lines: FRF) -> list[tuple[int, str]]:
    """Return outputs and their names in the order of the list to choose from: the worst, middle and best first."""
    first = dict(zip(chosen_functions(measured), ("worst", "middle", "best"), strict=False))
    order = [*first, *(o for o in range(lines.output.node.size) if o not in first)]
    return [
        (
            o,
            f"{lines.output.name(o)} over {lines.input.name(0)}, FRAC {measured.correlation[o, 0]:.4f}"
            + (f" ({first[o]})" if o in first else ""),
        )
        for o in order
    ]


def _modelled(tested: Tested, lines: FRF) -> NDArray[np.complex128] | None:
    """Return the fitted model's functions at the first input, (n_output, n_frequency); None where it has none."""
    if tested.fit is None:
        return None
    first = slice(0, 1)
    try:
        value = fitted_frf(
            tested.fit,
            tested.measured.geometry,
            output=lines.output,
            input=Dofs(node=lines.input.node[first], direction=lines.input.direction[first]),
            frequency=lines.frequency,
            quantity=lines.quantity,
        )
    except PairingError:  # where the force acted is not known
        return None
    return value[:, 0]
