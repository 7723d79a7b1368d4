"""The report: one self-contained HTML page of the results in a folder."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from updating.errors import StoreError
from updating.report.answer import answer_section, opening_section, overview_section
from updating.report.change_part import errors_with_additions, what_changed_section
from updating.report.frf_part import frf_section
from updating.report.ledger_part import ledger_section, parameter_section, signature_section
from updating.report.modes_part import mac_section, modes_section, shape_section
from updating.report.part import Section, in_css, packed, renderer, unbroken
from updating.report.pooled_part import pooled_section
from updating.report.results import Results, Tested, read_results, with_models
from updating.report.state_part import beside_section, kind_of_answer, location_section, state_section
from updating.results.store import folder_name, write_bytes
from updating.results.text import Table


def provenance_section(results: Results) -> Section:
    """List what each result was made with and from."""
    return Section(title="Provenance", blocks=(result_table(results), input_table(results)))


def result_table(results: Results) -> Table:
    """List versions and options of every result, and a digest over all of its inputs; equal ones together."""
    files: dict[tuple[str, str, str], list[str]] = {}
    for file, origin in results.origin.items():
        digests = [digest for _, digest in sorted(origin["inputs"].items())]
        row = (
            ", ".join(f"{name} {number}" for name, number in origin["versions"].items()),
            ", ".join(f"{name} = {value}" for name, value in origin["options"].items()) or "none",
            f"{len(origin['inputs'])}, all: {hashlib.sha256(''.join(digests).encode()).hexdigest()[:16]}",
        )
        files.setdefault(row, []).append(file)
    rows = tuple(
        (names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more", *row) for row, names in files.items()
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
            raise StoreError(
                f"no section of the report begins with {word!r}; there are: {', '.join(p.title for p in parts)}"
            )
    beginnings = tuple(word.lower() for word in only)
    return tuple(part for part in parts if not beginnings or part.title.lower().startswith(beginnings))


def _configuration(
    folder: Path, name: str, apart: bool, kind: str | None, added: Mapping[str, Mapping[int, float]], tested: Tested
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
        configurations = [configuration_section(tested, kind, added.get(tested.name, {})) for tested in results.tested]
    parts = [opening_section(results, configurations), answer_section(results)]
    if results.ledger:
        parts.append(ledger_section(results))
    if len(results.tested) > 1:
        address = [f"#{part.anchor}" for part in configurations] or [page_of(tested) for tested in results.tested]
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
        for value, unit in ((tested.torque, "N m"), (None if tested.pressure is None else tested.pressure / 1e3, "kPa"))
        if value is not None
    ]
    return Section(
        title=f"Configuration {tested.name}", text=(", ".join(stated),) if stated else (), parts=tuple(parts)
    )


def render(
    title: str, parts: tuple[Section, ...], *, up: str = "", bare: bool = False, about: Sequence[tuple[str, str]] = ()
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

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
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
