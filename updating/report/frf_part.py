"""What was identified and how well: every measured function with the modes over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema.types.frf import FRF
from ema.types.modal_model import ModalModel
from updating.correlation.frf_plot import chosen_functions, overlay_figure, synthesized, within_band
from updating.fitting.fit import Fit
from updating.report.frf_chart import BASE, FITTED_MODEL, FOUND, frf_chart
from updating.report.identified_model import fracs, modelled
from updating.report.part import Picture, Section, as_csv, png
from updating.report.results import Tested
from updating.report.stabilization_part import stabilization_blocks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WITH = {BASE: "with the base model", FOUND: "with what was identified"}


def frf_section(tested: Tested) -> Section:
    """Show functions with the synthesised ones over them and the stabilisation chart."""
    if not tested.has_functions:
        return Section(title=frf_title(tested), text=(f"None: {tested.no_functions}.",))
    m, frf = tested.measured, tested.frf()
    lines = within_band(frf, m)
    models = model_functions(tested, lines)
    n_function = m.node.size * m.input.node.size
    text = (
        f"{m.frequency.size} modes between {m.band[0]:g} and {m.band[1]:g} Hz from {n_function} FRFs, without a "
        f"frequency guess. Measured functions and those of the modes correlate (FRAC) by {m.correlation.min():.5f} "
        f"to {m.correlation.max():.5f}, {np.median(m.correlation):.5f} in the middle.",
        *_frac_text({name: float(np.mean(fracs(lines, value))) for name, value in models.items()}),
    )
    return Section(
        title=frf_title(tested),
        text=text,
        blocks=(frf_picture(tested, frf, models), *stabilization_blocks(tested, frf)),
    )


def _frac_text(frac: Mapping[str, float]) -> tuple[str, ...]:
    """Say how well the functions of the models meet the measured ones, in the mean."""
    if not frac:
        return ()
    told = " and ".join(f"{value:.3f} {_WITH[name]}" for name, value in frac.items())
    return (
        f"The model's functions, which know of the measured ones only what their modes say, correlate with them by "
        f"{told} in the mean over all (FRAC: 1 where two functions are equal, 0 where they share nothing).",
    )


def frf_picture(tested: Tested, frf: FRF, models: Mapping[str, NDArray[np.complex128]]) -> Picture:
    """Draw the functions that the identified modes meet worst, in the middle and best; the chart shows any of them.

    `models` holds the functions of each model within the band, see `model_functions`.
    """
    lines, fitted = synthesized(frf, tested.measured)
    chosen = chosen_functions(tested.measured)
    functions = frf_functions(tested.measured, lines)
    curves = {"measured": lines.value[:, 0], "from the modes": fitted[:, 0], **models}
    if len(models) == 1:
        curves = {FITTED_MODEL if name in models else name: value for name, value in curves.items()}
    return Picture(
        name=f"frf_{tested.name}",
        content=png(frf_figure(tested, frf, models)),
        form="png",
        data=_numbers(lines, curves, chosen),
        alt="Measured and synthesised FRFs",
        caption="Every function; the first ones are those that the identified modes meet worst, in the middle and best "
        "(a print shows these). Dashed: natural frequencies. The difference is what the modes leave; where it is as "
        "large as the function, noise governs."
        + (
            ""
            if not models
            else f" Dotted: the model{' with what was identified' if FOUND in models else ''}."
        )
        + ("" if lines.coherence is not None else " The test system stored no coherence."),
        chart=frf_chart(tested.measured, lines, curves, [o for o, _ in functions]),
        choices=tuple(name for _, name in functions),
        model="both" if len(models) > 1 else "",
    )


def frf_figure(
    tested: Tested, frf: FRF, models: Mapping[str, NDArray[np.complex128]], *, beside: bool = False
) -> Figure:
    """Draw the chosen functions with those of the model with what was identified, else of the base model."""
    shown = models.get(FOUND, models.get(BASE))
    drawn = None if shown is None else shown[list(chosen_functions(tested.measured))]
    return overlay_figure(frf, tested.measured, drawn, found=FOUND in models, beside=beside)


def model_functions(tested: Tested, lines: FRF) -> dict[str, NDArray[np.complex128]]:
    """Return functions of the base and of the identified model, (n_output, n_frequency), as they are."""
    fits = {BASE: tested.fit, FOUND: None if tested.identified is None else tested.identified.fit}
    values = {name: modelled(tested, own, lines) for name, own in fits.items() if isinstance(own, Fit)}
    return {name: value for name, value in values.items() if value is not None}


def _numbers(lines: FRF, curves: Mapping[str, NDArray[np.complex128]], chosen: Sequence[int]) -> str:
    """Write the functions that a print shows as CSV."""
    columns, names = [lines.frequency], ["frequency [Hz]"]
    for o in chosen:
        name = f"{lines.output.name(o)}/{lines.input.name(0)}"
        for what, value in curves.items():
            columns += [value[o].real, value[o].imag]
            names += [f"{name} {what} {part} [SI {lines.quantity}]" for part in ("real", "imaginary")]
        if lines.coherence is not None:
            columns.append(lines.coherence[o, 0])
            names.append(f"{name} coherence")
    return as_csv(names, zip(*columns, strict=True))


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
