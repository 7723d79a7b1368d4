"""What was identified and how well: functions with the modes over them, and the stabilisation chart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.identification.stabilization import stabilization
from ema.plot.figures import stabilization_figure
from ema.types.frf import FRF
from ema.types.geometry import Dofs
from updating.correlation.frf_plot import chosen_functions, overlay_figure, synthesized
from updating.errors import PairingError
from updating.fitting.fitted_frf import fitted_frf
from updating.report.part import Picture, Section, as_csv, png
from updating.report.results import Tested


def frf_section(tested: Tested) -> Section:
    """Show functions with the synthesised ones over them and the stabilisation chart."""
    m, frf = tested.measured, tested.frf()
    n_function = m.node.size * m.input.node.size
    text = (
        f"{m.frequency.size} modes between {m.band[0]:g} and {m.band[1]:g} Hz from {n_function} FRFs, without a "
        f"frequency guess. Measured functions and those of the modes correlate (FRAC) by {m.correlation.min():.5f} "
        f"to {m.correlation.max():.5f}, {np.median(m.correlation):.5f} in the middle.",
    )
    return Section(
        title=f"FRFs of {tested.name}",
        text=text,
        blocks=(frf_picture(tested, frf), stabilization_picture(tested, frf)),
    )


def frf_picture(tested: Tested, frf: FRF) -> Picture:
    """Draw the functions that the identified modes meet worst, in the middle and best."""
    lines, fitted = synthesized(frf, tested.measured)
    chosen = chosen_functions(tested.measured)
    model = _modelled(tested, lines, chosen)
    columns, names = [lines.frequency], ["frequency [Hz]"]
    for k, o in enumerate(chosen):
        name = f"{lines.output.name(o)}/{lines.input.name(0)}"
        shown = [("measured", lines.value[o, 0]), ("from the modes", fitted[o, 0])]
        if model is not None:
            shown.append(("fitted model", model[k]))
        for what, value in shown:
            columns += [value.real, value.imag]
            names += [f"{name} {what} {part} [SI {lines.quantity}]" for part in ("real", "imaginary")]
        if lines.coherence is not None:
            columns.append(lines.coherence[o, 0])
            names.append(f"{name} coherence")
    return Picture(
        name=f"frf_{tested.name}",
        content=png(overlay_figure(frf, tested.measured, model)),
        form="png",
        data=as_csv(names, zip(*columns, strict=True)),
        alt="Measured and synthesised FRFs",
        caption="The functions that the identified modes meet worst, in the middle and best. Dashed: natural "
        "frequencies. The difference is what the modes leave; where it is as large as the function, noise governs."
        + (
            ""
            if model is None
            else " Dotted: the fitted model, which knows of the functions only what their modes say."
        )
        + ("" if lines.coherence is not None else " The test system stored no coherence."),
    )


def _modelled(tested: Tested, lines: FRF, chosen: tuple[int, ...]) -> NDArray[np.complex128] | None:
    """Return the fitted model's functions of the chosen outputs, (n_chosen, n_frequency); None where it has none."""
    if tested.fit is None:
        return None
    rows, first = list(chosen), slice(0, 1)
    try:
        value = fitted_frf(
            tested.fit,
            tested.measured.geometry,
            output=Dofs(node=lines.output.node[rows], direction=lines.output.direction[rows]),
            input=Dofs(node=lines.input.node[first], direction=lines.input.direction[first]),
            frequency=lines.frequency,
            quantity=lines.quantity,
        )
    except PairingError:  # where the force acted is not known
        return None
    return value[:, 0]


def stabilization_picture(tested: Tested, frf: FRF) -> Picture:
    """Draw the stabilisation chart of the identified band."""
    diagram = stabilization(frf.band(*tested.measured.band))
    poles = zip(
        diagram.order, np.abs(diagram.pole) / (2.0 * np.pi), -diagram.pole.real / np.abs(diagram.pole),
        diagram.cluster, strict=True,
    )  # fmt: skip
    return Picture(
        name=f"stabilization_{tested.name}",
        content=png(stabilization_figure(diagram)),
        form="png",
        data=as_csv(("order", "frequency [Hz]", "damping ratio [1]", "cluster (-1: none)"), poles),
        alt="Stabilisation chart",
        caption="Poles of all model orders on the mode indicator function. A physical pole comes back at every order "
        "and joins a cluster; dashed lines are the clusters' frequencies, from which the modes are chosen.",
    )
