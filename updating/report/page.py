"""The report: one self-contained HTML page of the results in a folder."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from ema.plot import palette
from updating.errors import StoreError
from updating.fitting.modal_table import TableFit
from updating.report.answer import answer_section, opening_section, overview_section
from updating.report.change_part import errors_with_additions, what_changed_section
from updating.report.chart import Chart, axis, charted, legend_above
from updating.report.frf_part import frf_section
from updating.report.identified_model import with_models
from updating.report.ledger_part import ledger_section, parameter_section, signature_section
from updating.report.location_part import kind_of_answer, location_section
from updating.report.modes_part import mac_section, modes_section, shape_section
from updating.report.part import Section, Table, anchor, as_csv, in_css, packed, renderer, unbroken
from updating.report.pooled_part import pooled_section
from updating.report.results import Results, Tested, read_results
from updating.report.state_part import beside_section, state_section
from updating.results.store import folder_name, write_bytes
from updating.results.text import estimate_text, parameter_text


def provenance_section(results: Results) -> Section:
    """List what each result was made with and from."""
    return Section(title="Provenance", blocks=(result_table(results), input_table(results)))


def result_table(results: Results) -> Table:
    """List versions and options of every result, and a digest over all of its inputs; equal ones together."""
    files: dict[tuple[str, str, str], list[str]] = {}
    for file, origin in results.origin.items():
        row = (
            ", ".join(f"{name} {number}" for name, number in origin["versions"].items()),
            ", ".join(f"{name} = {value}" for name, value in origin["options"].items()) or "none",
            f"{len(origin['inputs'])}, all: {_digest(origin['inputs'])}",
        )
        files.setdefault(row, []).append(file)
    rows = tuple(
        (names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more", *row)
        for row, names in files.items()
    )
    return Table(
        title="",
        header=("result", "versions", "options", "input files and the SHA-256 of their digests"),
        rows=rows,
        note="The numbers of every figure stand beside it as CSV in the folder figures.",
    )


def input_table(results: Results) -> Table:
    """List every input file with its digest."""
    digest = {(name, value) for origin in results.origin.values() for name, value in origin["inputs"].items()}
    return Table(
        title="Input files",
        header=("file", "SHA-256"),
        rows=tuple(sorted(digest)),
        note="Files of the same name are of different configurations.",
        folded=True,
    )


def _digest(inputs: dict[str, str]) -> str:
    """First digits of the digest over the digests of all files."""
    return hashlib.sha256("".join(inputs[name] for name in sorted(inputs)).encode()).hexdigest()[:16]


_PUBLISHED, _OURS = palette.QUIET, palette.BASE


def table_overview(results: Results) -> Section:
    """List all rows, each leading to its section, over a figure of error and contact stiffness."""
    fits = results.table
    table = Table(
        title="Natural frequencies [Hz]: measured | published model | ours",
        header=(
            "stack", *results.shape_class, "error published [%]", "error ours [%]", "G_f published [Pa/Pa]",
            "G_f ours [Pa/Pa]",
        ),
        rows=tuple(
            (
                f.row.name,
                *(
                    f"{a:.0f} | {b:.0f} | {c:.0f}"
                    for a, b, c in zip(f.row.frequency, f.row.published_frequency, f.frequency, strict=True)
                ),
                f"{100 * f.published_error:.1f}",
                f"{100 * f.error:.1f}",
                "" if np.isnan(f.row.published_G_f) else f"{f.row.published_G_f:.0f}",
                estimate_text(f.G_f),
            )
            for f in fits
        ),
        note="Error: mean over the modes of the relative frequency error. ± is half of the 95 % interval and contains "
        "the scatter that the model leaves. A click on a heading sorts, one on a stack leads to it.",
        link=tuple(f"#{anchor(_title(f))}" for f in fits),
    )  # fmt: skip
    picture = charted(
        "all_stacks",
        table_chart(fits),
        as_csv(
            (
                "stack",
                "error published [1]",
                "error ours [1]",
                "G_f published [Pa/Pa]",
                "G_f ours [Pa/Pa]",
                "its std",
            ),
            (
                (f.row.name, f.published_error, f.error, f.row.published_G_f, f.G_f.value, f.G_f.std)
                for f in fits
            ),
        ),
        alt="Error and contact stiffness by stack",
        caption="Mean relative frequency error, and contact stiffness with one standard deviation, of each stack.",
    )
    text = (
        "G_f is fitted to the measured frequencies of each stack by opt_G; modes are paired by shape class."
    )
    return Section(title="All stacks", text=(text,), blocks=(table, picture))


def row_section(fit: TableFit, shape_class: tuple[str, ...]) -> Section:
    """Show one row: its modes measured, published and ours."""
    row = fit.row
    error, published = ((f - row.frequency) / row.frequency for f in (fit.frequency, row.published_frequency))
    table = Table(
        title="",
        header=("mode", "measured [Hz]", "published [Hz]", "its error [%]", "ours [Hz]", "our error [%]"),
        rows=tuple(
            (name, f"{a:.0f}", f"{b:.0f}", f"{100 * e:+.1f}", f"{c:.1f}", f"{100 * d:+.1f}")
            for name, a, b, e, c, d in zip(
                shape_class,
                row.frequency,
                row.published_frequency,
                published,
                fit.frequency,
                error,
                strict=True,
            )
        ),
        note=f"{parameter_text(fit.G_f)}, mean error {100 * fit.error:.1f} % (published: "
        f"{100 * fit.published_error:.1f} %). Error is (model - measured) / measured.",
    )
    picture = charted(
        f"stack_{row.name}",
        row_chart(fit, shape_class),
        as_csv(
            ("mode", "measured [Hz]", "published [Hz]", "ours [Hz]"),
            zip(shape_class, row.frequency, row.published_frequency, fit.frequency, strict=True),
        ),
        alt=f"Errors of stack {row.name} by mode",
        caption="Frequency error by mode.",
        width="half",
    )
    return Section(title=_title(fit), blocks=(table, picture))


def table_chart(fits: tuple[TableFit, ...]) -> Chart:
    """Return the error of eq. (2) and G_f by stack, ours beside the published."""
    names = [f.row.name for f in fits]
    errors = (("published", "published_error", _PUBLISHED), ("ours", "error", _OURS))
    traces: list[dict[str, Any]] = [
        {
            "type": "bar", "name": name, "x": names, "y": [100.0 * getattr(f, key) for f in fits],
            "marker": {"color": color}, "hovertemplate": "%{x}: %{y:.3g} %",
        }
        for name, key, color in errors
    ]  # fmt: skip
    G_f = (
        (
            "published",
            [f.row.published_G_f for f in fits],
            None,
            {"color": _PUBLISHED, "size": 12, "symbol": "square"},
        ),
        ("ours", [f.G_f.value for f in fits], [f.G_f.std for f in fits], {"color": _OURS, "size": 8}),
    )
    for name, value, std, marker in G_f:
        traces.append(
            {
                "type": "scatter", "mode": "markers", "name": name, "x": names, "y": value, "yaxis": "y2",
                "marker": marker, "showlegend": False, "hovertemplate": "%{x}: %{y:.4g} Pa/Pa",
                **({} if std is None else {"error_y": {"type": "data", "array": std}}),
            }
        )  # fmt: skip
    layout = {
        "height": 430,
        "yaxis": axis("mean frequency error [%]", domain=[0.56, 1.0]),
        "yaxis2": axis("G_f [Pa/Pa]", domain=[0.0, 0.44]),
        "xaxis": axis("stack", type="category", anchor="y2"),
        "legend": legend_above(),
        "margin": {"r": 8, "t": 34},
    }
    return Chart(traces=traces, layout=layout)


def row_chart(fit: TableFit, shape_class: tuple[str, ...]) -> Chart:
    """Return the frequency error of every mode, ours beside the published, as bars."""
    row = fit.row
    traces = [
        {
            "type": "bar", "name": name, "x": list(shape_class), "y": (100.0 * (f / row.frequency - 1.0)).tolist(),
            "marker": {"color": color}, "hovertemplate": "%{x}: %{y:+.2f} %",
        }
        for f, color, name in (
            (row.published_frequency, _PUBLISHED, "published"), (fit.frequency, _OURS, "ours"),
        )
    ]  # fmt: skip
    layout = {
        "height": 240, "yaxis": axis("frequency error [%]", zeroline=True), "xaxis": {"automargin": True},
        "legend": legend_above(), "margin": {"r": 8, "t": 34},
    }  # fmt: skip
    return Chart(traces=traces, layout=layout)


def _title(fit: TableFit) -> str:
    return f"Stack {fit.row.name}"


MOST_TOGETHER = 8
"""Configurations that share one page; it then stays below 15 MB. More have a page each, beside their results."""


def write_report(
    folder: Path, executor: Executor | None = None, *, keep: bool = False, only: Sequence[str] = ()
) -> Path:
    """Write `report.html` from the results in a folder, and its figures with their data to `figures`.

    Parameters
    ----------
    folder : Path
        Folder of the results.
    executor : Executor, optional
        Where the sections of the configurations are made, such as `updating.workers.workers.workers`; by default here.

    keep : bool
        Whether results that were changed, or that come from other files than those beside them, are shown, too.
    only : sequence of str
        Titles of the sections that are wanted, in any case, or how they begin; all where there are none.

    Raises
    ------
    StoreError
        The folder holds no result, one that cannot be read, or cannot be written to; or there is no such section.
    """
    results = with_models(read_results(folder, keep=keep), executor)
    apart = len(results.tested) > MOST_TOGETHER
    kind, added = kind_of_answer(results.diagnosis), errors_with_additions(results)
    make = partial(_configuration, folder, results.name, apart, kind, added)
    drawn = (map if executor is None else executor.map)(make, results.tested)
    parts = _chosen(sections(results, [part for part in drawn if part is not None]), only)
    _write_figures(folder, parts)
    page = folder / "report.html"
    write_bytes(page, render(results.name, parts, about=results.about).encode())
    return page


def _chosen(parts: tuple[Section, ...], only: Sequence[str]) -> tuple[Section, ...]:
    """Return the sections whose titles begin with one of the words that are asked for."""
    for word in only:
        if not any(part.title.lower().startswith(word.lower()) for part in parts):
            message = f"no section of the report begins with {word!r}; there are: {', '.join(p.title for p in parts)}"
            raise StoreError(message)
    beginnings = tuple(word.lower() for word in only)
    return tuple(part for part in parts if not beginnings or part.title.lower().startswith(beginnings))


def _configuration(
    folder: Path,
    name: str,
    apart: bool,
    kind: str | None,
    added: Mapping[str, Mapping[int, float]],
    tested: Tested,
) -> Section | None:
    """Make the section of a configuration, or, where they are apart, the page with it."""
    part = configuration_section(tested, kind, added.get(tested.name, {}))
    if not apart:
        return part
    _write_figures(folder, (part,))
    write_bytes(folder / page_of(tested), render(name, (part,), up="../report.html").encode())
    return None


def page_of(tested: Tested) -> str:
    """Return where the page of a configuration stands that has one of its own, from the results' folder."""
    return f"{folder_name(tested.name)}/report.html"


def sections(results: Results, configurations: Sequence[Section] | None = None) -> tuple[Section, ...]:
    """Make all sections of a report in its order, each by its function.

    Parameters
    ----------
    results : Results
        What to show.
    configurations : sequence of Section, optional
        Sections of the configurations, where they are made already; none where each configuration has its own page,
        to which the list of configurations then links.
    """
    if results.pooled is not None:
        return (pooled_section(results.pooled), provenance_section(results))
    if configurations is None:
        kind, added = kind_of_answer(results.diagnosis), errors_with_additions(results)
        configurations = [
            configuration_section(tested, kind, added.get(tested.name, {})) for tested in results.tested
        ]
    parts = [opening_section(results, configurations), answer_section(results)]
    if results.ledger:
        parts.append(ledger_section(results))
    if results.table:
        parts.append(table_overview(results))
        parts += [row_section(fit, results.shape_class) for fit in results.table]
    if len(results.tested) > 1:
        address = [f"#{part.anchor}" for part in configurations] or [
            page_of(tested) for tested in results.tested
        ]
        parts.append(overview_section(results, address))
    parts += configurations
    if results.diagnosis is not None:
        parts.append(signature_section(results.diagnosis))
    if results.ledger or any(tested.has_parameters for tested in results.tested):
        parts.append(parameter_section(results))
    return (*parts, provenance_section(results))


def titles(results: Results) -> tuple[str, ...]:
    """Return the titles of the sections that `sections` makes of a campaign's results, without making them."""
    planned = (
        ("Answer", True),
        ("In full", True),
        ("Error before and after each effect", bool(results.ledger)),
        ("All configurations", len(results.tested) > 1),
        *((f"Configuration {tested.name}", True) for tested in results.tested),
        ("Effect signatures", results.diagnosis is not None),
        ("Parameters", bool(results.ledger) or any(tested.has_parameters for tested in results.tested)),
        ("Provenance", True),
    )
    return tuple(title for title, shown in planned if shown)


def _write_figures(folder: Path, parts: tuple[Section, ...]) -> None:
    for picture in (p for part in parts for p in part.pictures):
        path = folder / "figures" / folder_name(picture.name)
        write_bytes(path.with_name(f"{path.name}.{picture.form}"), picture.content)
        write_bytes(path.with_name(f"{path.name}.csv"), picture.data.encode())


def configuration_section(tested: Tested, kind: str | None, added: Mapping[int, float]) -> Section:
    """Show everything about one configuration, and where the model fails in one kind of stiffness.

    `added` holds the frequency errors of its modes with what was identified (`errors_with_additions`).
    """
    parts = [] if tested.change is None else [state_section(tested.change)]
    if tested.change is not None and tested.reference is not None:
        parts.append(beside_section(tested, tested.change, tested.reference))
    parts += [] if tested.what_changed is None else [what_changed_section(tested.what_changed)]
    parts += [modes_section(tested, added), mac_section(tested), frf_section(tested), shape_section(tested)]
    if tested.stack_fit is not None and tested.stack_fit.pairing.measured.size:
        parts.append(location_section(tested, tested.stack_fit, kind))
    stated = [
        f"{value:g} {unit}"
        for value, unit in (
            (tested.torque, "N m"),
            (None if tested.pressure is None else tested.pressure / 1e3, "kPa"),
        )
        if value is not None
    ]
    return Section(
        title=f"Configuration {tested.name}", text=(", ".join(stated),) if stated else (), parts=tuple(parts)
    )


def render(
    title: str,
    parts: tuple[Section, ...],
    *,
    up: str = "",
    bare: bool = False,
    about: Sequence[tuple[str, str]] = (),
) -> str:
    """Put sections into one HTML page.

    Parameters
    ----------
    title : str
        Its title, which also stands at the foot of every printed page.
    parts : tuple of Section
        What is in it.
    up : str
        Address of the page above it, where there is one.
    bare : bool
        Whether it has no head.
    about : sequence of (str, str)
        Names and texts of the title block.
    """
    from jinja2 import Environment, StrictUndefined  # slow to import

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["unbroken"] = unbroken
    environment.filters["in_css"] = in_css
    folder = files("updating.report")

    def text(name: str) -> str:
        return (folder / name).read_text(encoding="utf-8")

    return environment.from_string(text("template.html")).render(
        title=title,
        version=version("lamella"),
        style=text("style.css"),
        scripts=(text("rest.js"), text("tables.js"), text("folds.js"), text("charts.js"), text("shapes.js")),
        renderer=packed(renderer()) if any(part.has_charts for part in parts) else "",
        sections=parts,
        up=up,
        bare=bare,
        about=about,
    )
