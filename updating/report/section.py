"""One configuration as tables and pictures: the parts that a report page is put together from."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ema.frf import FRF
from ema.modes import ModalModel
from ema.plot import frf_figure, mac_figure
from updating.correlation import correlate
from updating.fit import Fit
from updating.plot import as_png, objective_figure, shape_picture
from updating.quality import Quality
from updating.tables import parameter_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class ReportTable:
    """A table of text cells with a title and a note below."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str


@dataclass(frozen=True, kw_only=True)
class ReportFigure:
    """A picture as a data URI, its text alternative, its caption, and whether it takes the page's width."""

    uri: str
    alt: str
    caption: str
    width: Literal["half", "full"]


@dataclass(frozen=True, kw_only=True)
class Section:
    """One configuration of a report: its name, a sentence that says how it stands, tables and figures."""

    name: str
    summary: str
    tables: tuple[ReportTable, ...]
    figures: tuple[ReportFigure, ...]

    @property
    def anchor(self) -> str:
        """Name for a link within the page."""
        return re.sub(r"[^a-z0-9]+", "-", self.name.lower()).strip("-")


def identification_section(frf: FRF, measured: ModalModel, quality: Quality) -> Section:
    """Show what was identified: the table of modes, the FRFs with the synthesised ones, the checks."""
    rows = zip(
        measured.frequency, measured.frequency_std, measured.damping, measured.damping_std, strict=True
    )
    modes = ReportTable(
        title="Identified modes",
        header=("mode", "frequency [Hz]", "± [Hz]", "damping [%]", "± [%]"),
        rows=tuple(
            (str(r), f"{f:.3f}", f"{fs:.2g}", f"{100 * x:.4g}", f"{100 * xs:.2g}")
            for r, (f, fs, x, xs) in enumerate(rows, start=1)
        ),
        note="± is one standard deviation. Poles were chosen without a frequency guess.",
    )
    return Section(
        name=measured.name,
        summary=(
            f"{measured.frequency.size} modes between {measured.band[0]:g} and {measured.band[1]:g} Hz from "
            f"{frf.output.node.size * frf.input.node.size} FRFs."
        ),
        tables=(modes, quality_table(quality)),
        figures=(
            raster(
                as_png(
                    frf_figure(frf, measured)
                ),  # thousands of points: a picture is smaller than their outlines
                alt="Measured and synthesised FRFs",
                caption="Measured FRFs, the synthesised ones over them; dashed lines mark the identified poles.",
                width="full",
            ),
        ),
    )


def quality_table(quality: Quality) -> ReportTable:
    """List what the checks and the reading found, or say that all is in order."""
    passed = [v.check for v in quality.verdicts if v.level == "pass"]
    return ReportTable(
        title="Quality of the measurement",
        header=("finding",),
        rows=tuple((line,) for line in quality.findings) or (("nothing suspicious",),),
        note=f"Passed: {', '.join(passed)}.",
    )


def fit_section(frf: FRF, measured: ModalModel, quality: Quality, fit: Fit) -> Section:
    """Show the fitted model beside the measurement: modes, MAC, shapes and the objectives."""
    identified = identification_section(frf, measured, quality)
    pairs = correlate(measured, fit.modes, fit.pairing)
    columns = zip(
        fit.pairing.measured, pairs.measured_frequency, measured.frequency_std[fit.pairing.measured],
        pairs.model_frequency, pairs.frequency_error, pairs.measured_damping,
        measured.damping_std[fit.pairing.measured], pairs.model_damping, pairs.mac, strict=True,
    )  # fmt: skip
    left_over = [f"{f:.1f} Hz" for f in measured.frequency[fit.pairing.unpaired_measured]]
    note = "Error is (model - measured) / measured. ± is one standard deviation."
    if left_over:
        note += (
            f" Measured modes without a partner above MAC {fit.pairing.threshold:g}: {', '.join(left_over)}."
        )
    modes = ReportTable(
        title="Modes, measured and modelled",
        header=("mode", "f measured [Hz]", "± [Hz]", "f model [Hz]", "error [%]", "damping measured [%]", "± [%]",
                "damping model [%]", "MAC"),
        rows=tuple(
            (str(m + 1), f"{f:.3f}", f"{fs:.2g}", f"{g:.3f}", f"{100 * e:+.2f}", f"{100 * x:.4g}", f"{100 * xs:.2g}",
             f"{100 * y:.4g}", f"{c:.4f}")
            for m, f, fs, g, e, x, xs, y, c in columns
        ),
        note=note,
    )  # fmt: skip
    parameters = ReportTable(
        title="Fitted contact parameters",
        header=("parameter", "value", "searched between", "objective"),
        rows=(
            ("contact stiffness", parameter_text(fit.G_f), f"{fit.G_f.lower:g} and {fit.G_f.upper:g}",
             f"opt_G = {fit.G_f.objective:.4g} Hz"),
            ("contact damping", parameter_text(fit.d_f), f"{fit.d_f.lower:g} and {fit.d_f.upper:g}",
             f"opt_d = {100 * fit.d_f.objective:.3g} % damping"),
        ),
        note="The standard deviation contains the scatter that the model leaves unexplained.",
    )  # fmt: skip
    shapes = tuple(
        raster(
            shape_picture(measured, fit, i),
            alt=f"Mode at {f:.1f} Hz, measured and modelled",
            caption=(
                f"Measured {f:.1f} Hz (left), modelled {g:.1f} Hz (right), MAC {c:.4f}. "
                "Colour: displacement over the largest."
            ),
            width="half",
        )
        for i, (f, g, c) in enumerate(
            zip(pairs.measured_frequency, pairs.model_frequency, pairs.mac, strict=True)
        )
    )
    matrix = mac_figure(fit.pairing.mac, measured.frequency, fit.modes.frequency)
    matrix.axes[0].set(xlabel="model frequency [Hz]", ylabel="measured frequency [Hz]")
    mac = vector(
        matrix,
        alt="MAC matrix",
        caption="MAC of measured with modelled modes.",
        width="full",
    )
    history = vector(
        objective_figure((fit.G_f, fit.d_f)),
        alt="Objectives over their parameters",
        caption="Every value tried for G_f (opt_G) and d_f (opt_d); the diamond is the estimate.",
        width="full",
    )
    return Section(
        name=fit.name,
        summary=(
            f"{identified.summary} {fit.pairing.measured.size} of them pair with the model, whose natural frequencies "
            f"are off by {100 * fit.error:.2f} % on average. {parameter_text(fit.G_f)}; {parameter_text(fit.d_f)}. "
            f"Measured points lie at most {1e3 * fit.distance.max():.2f} mm from where the model is sampled."
        ),
        tables=(modes, parameters, quality_table(quality)),
        figures=(mac, *identified.figures, *shapes, history),
    )


def vector(figure: Figure, *, alt: str, caption: str, width: Literal["half", "full"]) -> ReportFigure:
    """Embed a matplotlib figure as SVG, the same bytes every time."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "lamella"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return ReportFigure(
        uri=_data_uri("image/svg+xml", buffer.getvalue()), alt=alt, caption=caption, width=width
    )


def raster(png: bytes, *, alt: str, caption: str, width: Literal["half", "full"]) -> ReportFigure:
    """Embed a PNG picture."""
    return ReportFigure(uri=_data_uri("image/png", png), alt=alt, caption=caption, width=width)


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
