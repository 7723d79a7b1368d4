"""The report page: sections put into one self-contained HTML file that opens without a network."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined

from ema.modes import ModalModel
from updating.errors import StoreError
from updating.fit import Fit
from updating.quality import Quality
from updating.report.section import ReportTable, Section, fit_section, identification_section
from updating.report.table_page import read_table_fits, table_section, table_summary
from updating.store import folder_name, read_document, read_frf, read_result, write_bytes
from updating.tables import estimate_text


def write_report(folder: Path) -> Path:
    """Write `report.html` from the results in a folder, one section a configuration, and return its path.

    Raises
    ------
    StoreError
        The folder holds no result, or one that cannot be read.
    """
    if (folder / "modal_table.json").exists():
        return _write_table_report(folder)
    if not (folder / "campaign.json").exists():
        message = (
            f"{folder}: no campaign.json to report on; make results with: lamella fit CAMPAIGN -o {folder}"
        )
        raise StoreError(message)
    campaign = read_document(folder / "campaign.json")["result"]
    names = [c["name"] for c in campaign["configurations"]]
    done = [folder / folder_name(n) for n in names if (folder / folder_name(n) / "modal_model.json").exists()]
    if not done:
        message = (
            f"{folder}: none of its configurations is done; go on with: lamella fit CAMPAIGN -o {folder}"
        )
        raise StoreError(message)
    page = render(
        campaign["name"],
        _summary(done),
        _overview(campaign["configurations"], done),
        tuple(_section(configuration) for configuration in done),
        _provenance(done, "modal_model.json"),
    )
    return _write(folder, page)


def _write_table_report(folder: Path) -> Path:
    table = read_document(folder / "modal_table.json")["result"]
    fits = read_table_fits(folder)
    if not fits:
        message = (
            f"{folder}: none of its configurations is done; go on with: lamella fit CAMPAIGN -o {folder}"
        )
        raise StoreError(message)
    section = table_section(fits, tuple(table["shape_class"]))
    done = [folder / f"stack_{folder_name(f.row.name)}" for f in fits]
    page = render(
        table["name"], table_summary(fits), section.tables[0], (section,), _provenance(done, "fit.json")
    )
    return _write(folder, page)


def _write(folder: Path, page: str) -> Path:
    path = folder / "report.html"
    write_bytes(path, page.encode())
    return path


def render(
    title: str, summary: str, overview: ReportTable, sections: tuple[Section, ...], provenance: ReportTable
) -> str:
    """Put sections into one HTML page."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    here = files("updating.report")
    template = environment.from_string((here / "template.html").read_text(encoding="utf-8"))
    return template.render(
        title=title,
        version=version("lamella"),
        style=(here / "style.css").read_text(encoding="utf-8"),
        summary=summary,
        overview=overview,
        sections=sections,
        provenance=provenance,
    )


def _section(folder: Path) -> Section:
    measured = read_result(folder / "modal_model.json", ModalModel)
    frf = read_frf(folder / "measurement.npz")
    quality = read_result(folder / "quality.json", Quality)
    if (folder / "fit.json").exists():
        return fit_section(frf, measured, quality, read_result(folder / "fit.json", Fit))
    return identification_section(frf, measured, quality)


def _fits(done: list[Path]) -> dict[Path, Fit]:
    return {f: read_result(f / "fit.json", Fit) for f in done if (f / "fit.json").exists()}


def _summary(done: list[Path]) -> str:
    """Say in a sentence or two how the campaign stands."""
    fits = list(_fits(done).values())
    identified = f"{len(done)} configuration{'s' if len(done) > 1 else ''} identified"
    if not fits:
        return f"{identified}; no model was fitted."
    worst = max(fits, key=lambda fit: fit.error)
    left_over = sum(fit.pairing.unpaired_measured.size for fit in fits)
    return (
        f"{identified} and fitted. The model's natural frequencies differ from the measured ones by "
        f"{100 * sum(fit.error for fit in fits) / len(fits):.2f} % on average, most in {worst.name} "
        f"({100 * worst.error:.2f} %). "
        + ("Every measured mode has its partner in the model." if left_over == 0 else
           f"{left_over} measured mode{'s have' if left_over > 1 else ' has'} no partner in the model.")
    )  # fmt: skip


def _overview(configurations: list[dict[str, Any]], done: list[Path]) -> ReportTable:
    """List every configuration that is done with its state and its fitted parameters."""
    fits = _fits(done)
    rows = []
    for c in configurations:
        folder = next((f for f in done if f.name == folder_name(c["name"])), None)
        fit = fits.get(folder) if folder is not None else None
        rows.append(
            (
                c["name"],
                "" if c["torque"] is None else f"{c['torque']:g}",
                "" if c["pressure"] is None else f"{c['pressure'] / 1e3:g}",
                "not done"
                if folder is None
                else "identified"
                if fit is None
                else f"{fit.pairing.measured.size} pairs",
                "" if fit is None else estimate_text(fit.G_f),
                "" if fit is None else estimate_text(fit.d_f),
                "" if fit is None else f"{100 * fit.error:.2f}",
            )
        )
    return ReportTable(
        title="",
        header=("configuration", "torque [N m]", "pressure [kPa]", "state", "G_f [Pa/Pa]", "d_f [s/Pa]",
                "frequency error [%]"),
        rows=tuple(rows),
        note="± is one standard deviation. The frequency error is the mean of |measured - model| / measured, eq. (2).",
    )  # fmt: skip


def _provenance(done: list[Path], result: str) -> ReportTable:
    rows: list[tuple[str, ...]] = []
    for folder in done:
        made: dict[str, Any] = read_document(folder / result)["provenance"]
        versions = ", ".join(f"{name} {number}" for name, number in made["versions"].items())
        options = ", ".join(f"{name} = {value}" for name, value in made["options"].items())
        inputs = f"{len(made['inputs'])} files, all: {_digest(made['inputs'])}"
        rows.append((folder.name, versions, options, inputs))
    if len(rows) > 1 and len({row[1:] for row in rows}) == 1:
        rows = [(f"all {len(rows)}", *rows[0][1:])]
    return ReportTable(
        title="Provenance",
        header=("configuration", "versions", "options", "inputs (SHA-256)"),
        rows=tuple(rows),
        note="The digest of each input file stands in the JSON file of the result.",
    )


def _digest(inputs: dict[str, str]) -> str:
    """First digits of the digest over the digests of all files."""
    return hashlib.sha256("".join(inputs[name] for name in sorted(inputs)).encode()).hexdigest()[:16]
