"""Many specimens on one rig: the answer, all of them at a glance, and each by itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ema.plot import palette
from updating.report.part import Chart, Picture, Section, axis, charted
from updating.results.pooled import SPECIMEN_HEADER, PooledDiagnosis, SpecimenAnswer, contact_cells, specimen_row
from updating.results.text import Table, in_percent, interval_text

Contact = Literal["G_f", "d_f"]

_USUAL = "treatment"
_NO_DAMPING = " A dash: no damping ratio was measured."
_RATIOS = ("d_f",)  # known to a factor
_LABEL = {"G_f": "contact stiffness G_f [1]", "d_f": "contact damping d_f [s/Pa]"}


def pooled_section(diagnosis: PooledDiagnosis) -> Section:
    """Say what all specimens show together, list them, and show each of them."""
    return Section(
        title="Answer",
        text=diagnosis.sentences,
        parts=(_overview(diagnosis), *(_specimen_section(specimen) for specimen in diagnosis.specimens)),
    )


def grouping(specimens: Sequence[SpecimenAnswer]) -> str:
    """Return the column of the notes that colours specimens: the treatment, else the first that some but not all share.

    Empty where there is none.
    """
    columns = _columns(specimens)
    values = {name: [specimen.notes.get(name, "") for specimen in specimens] for name in columns}
    shared = [name for name in columns if 1 < len(set(values[name])) < len(specimens)]
    return _USUAL if _USUAL in columns else next(iter(shared), "")


def _columns(specimens: Sequence[SpecimenAnswer]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for specimen in specimens for name in specimen.notes))


def _overview(diagnosis: PooledDiagnosis) -> Section:
    """List all specimens with their notes, errors and contact; a click on a heading sorts, so notes group."""
    columns, group = _columns(diagnosis.specimens), grouping(diagnosis.specimens)
    table = Table(
        title="All specimens",
        header=(SPECIMEN_HEADER[0], *columns, *SPECIMEN_HEADER[1:]),
        rows=tuple(
            (specimen.name, *(specimen.notes.get(name, "") for name in columns), *specimen_row(specimen)[1:])
            for specimen in diagnosis.specimens
        ),
        note="Frequency errors are means over the modes of a specimen: of the base model, with what was identified, "
        "and where what specimens share is taken from the others. Odd: effects that a specimen has alone. A click on a "
        "heading sorts.",
        link=tuple(f"#{_specimen_section(specimen).anchor}" for specimen in diagnosis.specimens),
    ).without_empty_columns()
    return Section(
        title="All specimens at a glance",
        blocks=(
            error_picture(diagnosis.specimens),
            table,
            *(contact_picture(diagnosis.specimens, name, group) for name in ("G_f", "d_f")),
        ),
    )


def _specimen_section(specimen: SpecimenAnswer) -> Section:
    """Show one specimen: its notes, the effects that it alone has, and its contact at each torque."""
    notes = "; ".join(f"{name}: {value}" for name, value in specimen.notes.items() if value)
    odd = f"It alone has {', '.join(specimen.odd)}." if specimen.odd else "It has nothing that the others lack."
    contact = "; ".join(interval_text(value) for value in (specimen.G_f, specimen.d_f) if value)
    table = Table(
        title="Contact at each torque",
        header=("configuration", "pressure [kPa]", "G_f (95 %)", "d_f (95 %) [s/Pa]"),
        rows=tuple((state.name, f"{1e-3 * state.pressure:g}", *contact_cells(state)) for state in specimen.states),
        note="From the frequencies and damping ratios of one torque alone, all else as it was found."
        + (_NO_DAMPING if any(state.d_f is None for state in specimen.states) else ""),
    )
    text = (*((f"{notes}.",) if notes else ()), odd, *((f"{contact}.",) if contact else ()))
    return Section(title=f"Specimen {specimen.name}", text=text, blocks=(_mode_table(specimen), table))


def _mode_table(specimen: SpecimenAnswer) -> Table:
    """List the measured modes of a specimen beside those of the base model and of the identified model."""
    return Table(
        title="Modes",
        header=(
            "configuration",
            "measured [Hz]",
            "base model [Hz]",
            "error [%]",
            "with what was identified [Hz]",
            "error [%]",
            "damping measured [%]",
            "base model [%]",
            "with what was identified [%]",
        ),
        rows=tuple(
            (
                mode.configuration,
                f"{mode.frequency:.1f}",
                f"{mode.base_frequency:.1f}",
                _error(mode.base_frequency / mode.frequency),
                f"{mode.model_frequency:.1f}",
                _error(mode.model_frequency / mode.frequency),
                in_percent(mode.damping),
                in_percent(mode.base_damping),
                in_percent(mode.model_damping),
            )
            for mode in specimen.modes
        ),
        note="Each mode beside the model's that looks like it; an error is that of the model over what was measured."
        + (_NO_DAMPING if any(np.isnan(mode.damping) for mode in specimen.modes) else ""),
    )


def _error(ratio: float) -> str:
    percent = 100.0 * (ratio - 1.0)
    return f"{percent:+.2f}" if abs(percent) >= 1.0 else f"{percent:+.3f}"


def error_picture(specimens: Sequence[SpecimenAnswer]) -> Picture:
    """Draw the error of each specimen before and after; those that are odd are marked."""
    odd = [specimen.name for specimen in specimens if specimen.odd]
    return charted(
        "specimen_errors",
        _error_chart(specimens),
        alt=f"Frequency errors of {len(specimens)} specimens before and after; odd: {', '.join(odd) or 'none'}",
        caption="Mean frequency error of each specimen with the base model and with what was identified. "
        + ("A diamond marks what is odd." if odd else "No specimen is odd."),
    )


def _error_chart(specimens: Sequence[SpecimenAnswer]) -> Chart:
    series = [
        ("circle", palette.BASE, "base model", specimens, "base_error"),
        ("circle", palette.FOUND, "with what was identified", specimens, "error"),
    ]
    if odd := [specimen for specimen in specimens if specimen.odd]:
        series.append(("diamond", palette.ACCENT, "odd", odd, "error"))
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": name, "x": [specimen.name for specimen in drawn],
            "y": [100.0 * getattr(specimen, key) for specimen in drawn],
            "text": [", ".join(specimen.odd) for specimen in drawn],
            "marker": {"color": color, "symbol": symbol, "size": 9},
            "hovertemplate": "%{x}: %{y:.3g} % %{text}<extra>" + name + "</extra>",
        }
        for symbol, color, name, drawn, key in series
    ]  # fmt: skip
    return Chart(
        traces=traces,
        layout={
            "height": 300,
            "yaxis": axis("mean frequency error [%]", rangemode="tozero"),
            "xaxis": {"automargin": True, "type": "category"},
            "margin": {"r": 8, "t": 66},
        },
    )


def contact_picture(specimens: Sequence[SpecimenAnswer], name: Contact, group: str) -> Picture:
    """Draw a contact parameter over pressure, a line for each specimen, coloured by its group."""
    return charted(
        f"specimen_{name}",
        contact_chart(specimens, name, group),
        alt=f"{_LABEL[name]} of {len(specimens)} specimens over pressure",
        caption=f"{name} at each torque alone, with 95 % intervals; a line is a specimen"
        + (f", its colour the {group}." if group else ".")
        + " A law of pressure that was found is taken out.",
        width="half",
    )


def contact_chart(specimens: Sequence[SpecimenAnswer], name: Contact, group: str) -> Chart:
    """Return a contact parameter over pressure as lines to be zoomed, one a specimen, coloured by a column of notes."""
    groups = list(dict.fromkeys(specimen.notes.get(group, "") for specimen in specimens))
    shown, traces = set[str](), []
    for specimen in specimens:
        states = sorted((s for s in specimen.states if getattr(s, name)), key=lambda state: state.pressure)
        found = [getattr(state, name) for state in states]
        value = specimen.notes.get(group, "")
        traces.append(
            {
                "type": "scatter", "mode": "lines+markers", "name": specimen.name, "legendgroup": value,
                "legendgrouptitle": {"text": value or "not stated"} if group and value not in shown else {},
                "x": [1e-3 * state.pressure for state in states], "y": [p.value for p in found],
                "error_y": {
                    "type": "data", "symmetric": False, "width": 0, "array": [p.upper - p.value for p in found],
                    "arrayminus": [p.value - p.lower for p in found],
                },
                "line": {"color": palette.SERIES[groups.index(value) % len(palette.SERIES)]},
                "hovertemplate": "%{x:g} kPa: %{y:.4g}<extra>" + f"{specimen.name} {value}" + "</extra>",
            }
        )  # fmt: skip
        shown.add(value)
    return Chart(
        traces=traces,
        layout={
            "yaxis": axis(_LABEL[name], **({"type": "log"} if name in _RATIOS else {"rangemode": "tozero"})),
            "xaxis": axis("pressure [kPa]"),
            "legend": {"groupclick": "toggleitem"},
            "margin": {"r": 8, "t": 16},
        },
    )
