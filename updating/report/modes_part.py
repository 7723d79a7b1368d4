"""Modes of a configuration, measured and modelled: tables, MAC and shapes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.modal.mac import LEAST_MPC, complexity, mac
from ema.plot import palette
from ema.quality.verdict import NOTES, label, meaning
from ema.types.modal_model import frequency_text
from lamella_shared import Reals, csv_text
from updating.correlation.correlation import PointCorrelation, correlate, correlate_points
from updating.fitting.fit import Fit, ModelFit
from updating.fitting.plots import AZIMUTH, ELEVATION, SWELL, ShapePair, faces, shape_pair_figure, shape_pairs
from updating.report.frf_part import frf_title
from updating.report.part import ByModel, Chart, Gallery, Picture, Section, anchor, axis, charted, of_model, png, single
from updating.report.results import Tested
from updating.results.text import Z95, Table, parameter_text, uncertain

_ADDED, _WITH_ADDED = "with what was identified [%]", " With what was identified:"


def modes_section(tested: Tested, added: Mapping[int, float]) -> Section:
    """Show the table of modes, the fitted parameters, and what the checks found.

    `added` holds of each mode, by its number from 1, the relative frequency error with what was identified.
    """
    modes = (identified_table(tested),) if tested.fit is None else pair_tables(tested, tested.fit, added)
    contact = () if tested.opt is None else (parameter_table(tested.opt),)
    checks = (complexity_table(tested), quality_table(tested), passed_table(tested))
    return Section(title=f"Modes of {tested.name}", blocks=(*modes, *contact, *checks))


def by_model(tested: Tested, make: Callable[[ModelFit], tuple[ByModel, ...]]) -> tuple[ByModel, ...]:
    """Make the blocks of the base model and, where something was identified, those of the identified model."""
    if tested.fit is None:
        return ()
    if tested.identified is None:
        return make(tested.fit)
    blocks = of_model(make(tested.identified.fit), "found")
    blocks += of_model(make(tested.fit), "base")
    return tuple(blocks)


def pair_tables(tested: Tested, fit: ModelFit, added: Mapping[int, float]) -> tuple[Table, ...]:
    """List paired modes of the base model and, where something was identified, of the identified model."""
    base = pair_table(tested, fit, added)
    if tested.identified is None:
        return (base,)
    table = identified_pair_table(tested, fit, tested.identified.fit)
    return *of_model([table], "found"), *of_model([base], "base")


def identified_pair_table(tested: Tested, base: ModelFit, identified: ModelFit) -> Table:
    """List paired modes of the identified model beside the errors of the base model."""
    c = correlate(tested.measured, base.modes, base.pairing)
    before = dict(zip((int(m) + 1 for m in base.pairing.measured), c.frequency_error, strict=True))
    table = pair_table(tested, identified, before)
    header = tuple("error of the base model [%]" if h == _ADDED else h for h in table.header)
    note = table.note.partition(_WITH_ADDED)[0]
    return replace(
        table,
        header=header,
        title="Modes, measured and modelled with what was identified",
        note=f"{note} Effects, contact, steel, sizes and places are those of the answer.",
    )


def identified_table(tested: Tested) -> Table:
    """List identified frequencies and damping ratios with their 95 % intervals."""
    m = tested.measured
    columns = zip(m.frequency, m.frequency_std, 100 * m.damping, 100 * m.damping_std, strict=True)
    return Table(
        title="Identified modes" if tested.has_functions else f"Modes read from {Path(m.read_from).name}",
        header=("mode", "frequency [Hz]", "damping [%]"),
        rows=tuple(
            (str(r), uncertain(f, Z95 * fs), uncertain(x, Z95 * xs))
            for r, (f, fs, x, xs) in enumerate(columns, start=1)
        ),
        note="± is half the 95 % interval that the noise of the measurement leaves."
        if tested.has_functions
        else "± is half the 95 % interval that the file, or the campaign, states; else a usual one (see the notes).",
    )


COMPLEXITY = (
    "A real shape has MPC 1 and MCF 0: all components in phase or against it. MPD and phase scatter are the mean and "
    f"the root mean square of how far phases are off their line. Modes with an MPC below {LEAST_MPC:g} are too complex "
    "(Pappa, Elliott and Schenk, NASA TM-107607, 1992)."
)
"""What the measures of how complex a shape is say."""


def complexity_table(tested: Tested) -> Table:
    """List how complex the shapes are, and which of them cannot be compared as real."""
    of = complexity(tested.measured)
    measures = (of.mpc, of.mpd, of.mcf, of.phase_scatter, of.is_complex)
    return Table(
        title="Complexity of the shapes",
        header=("mode", "frequency [Hz]", "MPC", "MPD [°]", "MCF", "phase scatter [°]", "finding"),
        rows=tuple(
            (
                str(r), frequency_text(f, 2), f"{p:.3f}", f"{d:.1f}", f"{c:.3f}", f"{s:.1f}",
                "too complex to be compared as real" if wrong else "",
            )
            for r, (f, p, d, c, s, wrong) in enumerate(zip(tested.measured.frequency, *measures, strict=True), start=1)
        ),
        note=COMPLEXITY,
        folded=not np.any(of.is_complex),  # a page on a phone is long enough
    ).without_empty_columns()  # fmt: skip


def pair_table(tested: Tested, fit: ModelFit, added: Mapping[int, float]) -> Table:
    """List paired modes: frequency and damping measured and modelled, their differences, and MAC.

    Where something was added to the model, its errors stand beside those of the base model.
    """
    measured = tested.measured
    c = correlate(measured, fit.modes, fit.pairing)
    used = fit.pairing.measured
    left_over = [f"{frequency_text(f, 1)} Hz" for f in measured.frequency[fit.pairing.unpaired_measured]]
    note = (
        "Error is (model - measured) / measured. ± is half the 95 % interval that the noise of the measurement leaves."
    )
    if left_over:
        note += f" Measured modes without a partner above MAC {fit.pairing.threshold:g}: {', '.join(left_over)}."
    if added:
        note += f"{_WITH_ADDED} the error of the model that the answer comes to, with one G_f for all torques."
    after = [f"{round(100.0 * added[m + 1], 2) + 0.0:+.2f}" if m + 1 in added else "" for m in used]
    columns = zip(
        used, c.measured_frequency, Z95 * measured.frequency_std[used], c.model_frequency, 100 * c.frequency_error,
        after, 100 * c.measured_damping, 100 * Z95 * measured.damping_std[used], 100 * c.model_damping, c.mac,
        strict=True,
    )  # fmt: skip
    table = Table(
        title="Modes, measured and modelled",
        header=(
            "mode", "f measured [Hz]", "f model [Hz]", "error [%]", _ADDED, "damping measured [%]",
            "damping model [%]", "MAC",
        ),
        rows=tuple(
            (
                str(m + 1), uncertain(f, fs), f"{g:.2f}", f"{round(e, 2) + 0.0:+.2f}", with_it,
                uncertain(x, xs), "" if np.isnan(y) else f"{y:.3g}", f"{a:.3f}",
            )
            for m, f, fs, g, e, with_it, x, xs, y, a in columns
        ),
        note=note,
    )  # fmt: skip
    return table.without_empty_columns()


def parameter_table(fit: Fit) -> Table:
    """List the contact parameters by the objectives of eq. (1), and these."""
    return Table(
        title="Contact parameters of this configuration alone, by opt_G and opt_d",
        header=("parameter", "value", "searched between", "objective"),
        rows=(
            ("contact stiffness", parameter_text(fit.G_f), f"{fit.G_f.lower:g} and {fit.G_f.upper:g}",
             f"opt_G = {fit.G_f.objective:.4g} Hz"),
            ("contact damping", parameter_text(fit.d_f), f"{fit.d_f.lower:g} and {fit.d_f.upper:g}",
             f"opt_d = {100 * fit.d_f.objective:.3g} % damping"),
        ),
        note="opt_G and opt_d: root of the summed squared differences of frequencies and of damping ratios. ± is half "
        "of the 95 % interval and contains the scatter that the model leaves unexplained. Measured "
        f"points lie at most {1e3 * fit.distance.max():.2f} mm from where the model is sampled.",
    )  # fmt: skip


def quality_table(tested: Tested) -> Table:
    """List what the checks and the reading found, each with the function it is about, or say that all is in order."""
    quality = tested.quality
    not_passed = (v for v in quality.verdicts if v.level != "pass")
    verdicts = sorted(not_passed, key=lambda v: v.level)  # failures first
    nodes = tested.measured.node.tolist()
    rows = [  # the point is the first that has a function in the report
        (next((str(node) for node in v.point if node in nodes), ""), label(v.check), v.finding) for v in verdicts
    ]
    rows += [("", "", note) for note in quality.notes]
    table = Table(
        title="Quality of the measurement",
        header=("point", "check", "finding"),
        rows=tuple(rows) or (("", "", "nothing suspicious"),),
        note="Each finding says what to do about it; the cursor on it shows what its check looks at. What was checked "
        "and is in order stands below.",
        link=tuple(f"#{anchor(frf_title(tested))}" if point else "" for point, *_ in rows),
        chooses=True,
        hint=(*(meaning(v.check) for v in verdicts), *(NOTES for _ in quality.notes)) if rows else (),
    )
    return table.without_empty_columns()


def passed_table(tested: Tested) -> Table:
    """List the checks that a measurement passed, with what each looks at."""
    passed = [v for v in tested.quality.verdicts if v.level == "pass"]
    return Table(
        title=f"{len(passed)} checks of the measurement passed",
        header=("check", "what it looks at", "found"),
        rows=tuple((label(v.check), meaning(v.check), v.message) for v in passed),
        folded=True,
    )


def mac_section(tested: Tested) -> Section:
    """Show the MAC of every two modes and, of a fit, the CoMAC of every point and the objectives."""
    fit = tested.fit
    if fit is None:
        return Section(title=f"MAC of {tested.name}", blocks=(auto_mac_picture(tested),))

    def pictures(model: ModelFit) -> tuple[Picture, ...]:
        comac = (comac_picture(tested, model),) if model.pairing.measured.size else ()
        return pairs_picture(tested, model), *comac

    tried = () if tested.opt is None else (objective_picture(tested.opt),)
    return Section(title=f"MAC and CoMAC of {tested.name}", blocks=(*by_model(tested, pictures), *tried))


def pairs_picture(tested: Tested, fit: ModelFit) -> Picture:
    """Draw the MAC of measured with modelled modes, the latter up to the last that is paired and two more."""
    last = int(fit.pairing.model.max(initial=0)) + 3
    return mac_picture(
        f"mac_{tested.name}",
        fit.pairing.mac[:, :last],
        (tested.measured.frequency, fit.modes.frequency[:last]),
        ("measured", "model"),
        alt="MAC matrix",
        caption="MAC of measured with modelled modes: 1 where two shapes are alike, 0 where they share nothing.",
    )


def mac_picture(
    name: str, value: Reals, frequency: tuple[Reals, Reals], whose: tuple[str, str], *, alt: str, caption: str
) -> Picture:
    """Draw a MAC matrix with the frequencies (Hz) of its rows and columns, and whose these are."""
    shades = 128  # of the scale of MAC
    (rows, columns), (down, across) = frequency, whose
    return charted(
        name,
        mac_chart(value, rows, columns, across, down),
        alt=alt,
        caption=caption,
        width="half",
        size=(1.6 + 0.5 * columns.size, 1.2 + 0.5 * rows.size),
        form="png",
        n_colour=shades,
    )


def mac_chart(value: Reals, rows: Reals | None, columns: Reals, across: str, down: str) -> Chart:
    """Return a MAC matrix as a chart.

    `across` and `down` say whose frequencies its columns and rows are; rows whose frequencies are not given are
    numbered.
    """
    x = [f"{k}: {frequency_text(f, 1)}" for k, f in enumerate(columns, start=1)]
    y = [str(k + 1) if rows is None else f"{k + 1}: {frequency_text(rows[k], 1)}" for k in range(len(value))]
    trace = {
        "type": "heatmap", "x": x, "y": y, "z": single(value), "zmin": 0.0, "zmax": 1.0, "colorscale": palette.LIKENESS,
        "xgap": 1, "ygap": 1, "texttemplate": "%{z:.2f}", "colorbar": {"title": {"text": "MAC"}, "thickness": 12},
        "hovertemplate": f"{across} mode %{{x}} Hz, {down} mode %{{y}} Hz: MAC %{{z:.4f}}<extra></extra>",
    }  # fmt: skip
    kind = {"type": "category", "showgrid": False}
    layout = {
        "height": 430,
        "xaxis": axis(f"{across} mode, frequency [Hz]", **kind),
        "yaxis": axis(f"{down} mode, frequency [Hz]", autorange="reversed", **kind),
    }
    return Chart(traces=[trace], layout=layout)


def auto_mac_picture(tested: Tested) -> Picture:
    """Draw the MAC of the measured modes with each other."""
    frequency = tested.measured.frequency
    return mac_picture(
        f"mac_{tested.name}",
        mac(tested.measured.shape, tested.measured.shape),
        (frequency, frequency),
        ("measured", "measured"),
        alt="MAC matrix of the measured modes",
        caption="MAC of the measured modes with each other: off the diagonal it should be small.",
    )


def comac_picture(tested: Tested, fit: ModelFit) -> Picture:
    """Draw how far measured and modelled shapes differ at every point, beside what noise makes of it."""
    points = correlate_points(tested.measured, fit.modes, fit.pairing)
    return charted(
        f"comac_{tested.name}",
        comac_chart(points),
        data=csv_text(
            ("point", "x", "y", "z", "CoMAC", "S-CoMAC", "eCoMAC", "difference", "difference from noise"),
            zip(points.node, *points.direction.T, points.comac, points.s_comac, points.e_comac, points.error,
                points.error_std, strict=True),
        ),
        alt="CoMAC by point",
        caption="Above: 1 - CoMAC of every point, 0 where shapes agree. Below: their difference over the root mean "
        "square of the shape, beside what the noise of the measurement alone would cause.",
        width="half",
        form="png",
    )  # fmt: skip


def comac_chart(points: PointCorrelation) -> Chart:
    """Return 1 - CoMAC over the difference of the shapes, of every point, as a chart."""
    names = [str(node) for node in points.node]
    noise = {"mode": "markers", "marker": {"color": palette.QUIET, "size": 5}, "name": "from noise alone"}
    return Chart(
        traces=[
            {"type": "bar", "x": names, "y": single(1.0 - points.comac), "yaxis": "y2", "showlegend": False,
             "marker": {"color": palette.LEFT}, "name": "1 - CoMAC"},
            {"type": "bar", "x": names, "y": single(points.error), "marker": {"color": palette.LEFT},
             "name": "measured - model"},
            {"type": "scatter", "x": names, "y": single(points.error_std), **noise},
        ],
        layout={
            "height": 430,
            "xaxis": axis("point", type="category"),
            "yaxis": axis("difference / rms", domain=[0.0, 0.46]),
            "yaxis2": axis("1 - CoMAC", domain=[0.54, 1.0], exponentformat="e"),
        },
    )  # fmt: skip


def objective_picture(fit: Fit) -> Picture:
    """Draw the objectives over every value that was tried of the contact parameters."""
    return charted(
        f"objective_{fit.name}",
        objective_chart(fit),
        alt="Objectives over their parameters",
        caption="Every value tried for G_f (opt_G) and d_f (opt_d) of this configuration alone; the diamond "
        "is the estimate.",
    )


def objective_chart(fit: Fit) -> Chart:
    """Return the objectives over what was tried of G_f, above, and of d_f as a chart."""
    traces: list[dict[str, Any]] = []
    for estimate, factor, place in ((fit.G_f, 1.0, ""), (fit.d_f, 100.0, "2")):
        tried = estimate.history[np.argsort(estimate.history[:, 0])]
        on = {"type": "scatter", "xaxis": f"x{place}", "yaxis": f"y{place}", "showlegend": place == ""}
        traces += [
            {**on, "mode": "lines+markers", "x": tried[:, 0].tolist(), "y": (factor * tried[:, 1]).tolist(),
             "name": "tried", "line": {"color": palette.QUIET, "width": 1}, "marker": {"size": 4}},
            {**on, "mode": "markers", "x": [estimate.value], "y": [factor * estimate.objective], "name": "estimate",
             "marker": {"color": palette.ACCENT, "size": 10, "symbol": "diamond"}},
        ]  # fmt: skip
    return Chart(
        traces=traces,
        layout={
            "height": 520,
            "xaxis": axis(f"G_f [{fit.G_f.unit}]", type="log", anchor="y"),
            "yaxis": axis("opt_G [Hz]", type="log", domain=[0.6, 1.0]),
            "xaxis2": axis(f"d_f [{fit.d_f.unit}]", anchor="y2", exponentformat="e"),
            "yaxis2": axis("opt_d [% damping]", domain=[0.0, 0.38], rangemode="tozero"),
        },
    )


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
    name: str, pairs: Sequence[ShapePair], box: list[float] | None, names: tuple[str, str] = ("measured", "model")
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


def _whole(displacement: Reals) -> list[int]:
    digits = 1000  # displacements are drawn, so a thousandth of the largest is enough
    return [int(v) for v in np.round(digits * displacement.ravel())]


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
        data=csv_text(
            [f"{n}{axis} [{'m' if not n else 'over the largest'}]" for n in parts for axis in "xyz"], np.hstack(columns)
        ),
        alt=_title(number, pair, names),
        caption="",
    )
