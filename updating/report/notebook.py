"""What a fit and a diagnosis show of themselves in a notebook: the words, tables and pictures of the report."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ema.plot import palette
from ema.types.modal_model import frequency_text
from ema.types.shown import figure_of, html_of, html_table
from updating.diagnosis.answer import Diagnosis
from updating.fitting.fit import Fit
from updating.fitting.fit_plot import draw_objective
from updating.report.change_part import diagnosis_changes, diagnosis_steps, draw_modes, draw_steps
from updating.report.opening import headline
from updating.results.text import interval_text, parameter_text, percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 6  # explanations of a ranking that are listed


@html_of.register(Fit)
def fit_html(own: Fit) -> str:
    """Say G_f, d_f and the error, what contradicts the measurement, and list the pairs."""
    pairing = own.pairing
    rows = [
        (str(r + 1), f"{own.modes.frequency[s]:.2f}", f"{100.0 * own.modes.damping[s]:.3g}", f"{a:.3f}")
        for r, s, a in zip(pairing.measured, pairing.model, pairing.paired_mac, strict=True)
    ]
    fitted = f"{parameter_text(own.G_f)}; {parameter_text(own.d_f)}"
    return html_table(
        f"{own.name}: mean frequency error {percent(own.error)}; {fitted}",
        ("measured mode", "model [Hz]", "damping of the model [%]", "MAC"),
        rows,
        " ".join(own.findings) or "± is half of the 95 % interval.",
    )


@figure_of.register(Fit)
def fit_figure(own: Fit) -> Figure:
    """Draw the objectives over what was tried of G_f and d_f, beside the MAC of measured and modelled modes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.4), layout="constrained")
    *places, right = figure.subplots(1, 3)
    for axes, estimate in zip(places, (own.G_f, own.d_f), strict=True):
        draw_objective(axes, estimate)
    last = int(own.pairing.model.max(initial=0)) + 2
    image = right.imshow(own.pairing.mac[:, :last], cmap=palette.LIKENESS, vmin=0.0, vmax=1.0, aspect="auto")
    shown = own.modes.frequency[:last]
    right.set_xticks(range(shown.size), [frequency_text(f, 0) for f in shown], rotation=90, fontsize="small")
    right.set_yticks(range(own.pairing.mac.shape[0]), [str(r + 1) for r in range(own.pairing.mac.shape[0])])
    right.set(xlabel="model [Hz]", ylabel="measured mode")
    figure.colorbar(image, ax=right, label="MAC")
    return figure


@html_of.register(Diagnosis)
def diagnosis_html(own: Diagnosis) -> str:
    """Say the answer in one sentence, and list the most probable explanations."""
    rows = [
        (
            " and ".join(own.labels.get(e, e) for e in ranked.effects) or "base model",
            percent(ranked.probability),
            percent(ranked.frequency_error),
            percent(ranked.left_out_error) if np.isfinite(ranked.left_out_error) else "",
            "; ".join(interval_text(p) for p in ranked.parameter),
        )
        for ranked in own.shown(_MOST)
    ]
    header = ("explanation", "probability", "frequency error", "of modes left out", "parameters")
    return f"<p><em>{escape(own.verdict)}</em></p>" + html_table(headline(own), header, rows)


@figure_of.register(Diagnosis)
def diagnosis_figure(own: Diagnosis) -> Figure:
    """Draw the error before and after each step over the errors of the modes before and after."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    draw_steps(above.subplots(), diagnosis_steps(own))
    draw_modes(below.subplots(), diagnosis_changes(own))
    for part in (above, below):
        part.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=8)
    return figure
